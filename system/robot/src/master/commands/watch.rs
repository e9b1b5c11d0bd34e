//! The command `watch`: a live table of chosen joints.

use core::fmt::{self, Display, Write as _};
use core::time::Duration;

use condor_hand::decimal::Decimal;
use condor_mbox::{Clock as _, Instant, MemoryWindow, Processor};
use condor_rt::{Background, Machine, ProgramError, users};
use condor_vars::layout::NAME_BYTES;
use condor_vars::{VARS, ValueKind, VariableClient, VariableTable, Watcher};

use super::super::drive::{ALL, OfServos};
use super::super::servos::ANSWER;
use super::super::words::{Problem, Words};
use super::{Commands, FINGERS};
use crate::JOINTS;
use crate::message::ServoStatus;

/// The time between two tables.
const PERIOD: Duration = Duration::from_millis(250);
/// The least number of rows of a loop's variables in a second.
const ROWS_HZ: u32 = 8;
/// The columns of a joint: the variable, its title, and the number of decimals.
const COLUMNS: [(&str, &str, usize); 5] = [
    ("position", "is rad", 4),
    ("target", "wanted", 4),
    ("torque", "N m", 4),
    ("flexor.tension", "flexor N", 2),
    ("extensor.tension", "ext. N", 2),
];
/// The columns of a joint's name, and of a value with the blank before it.
const NAME: usize = 17;
const VALUE: usize = 10;
/// The most variables of a loop from the first to the last that is shown.
const WORDS: usize = 128;

/// The values of a joint's variables.
type Values = [f32; COLUMNS.len()];

/// The table of chosen joints.
pub(in super::super) struct Watching<W> {
    /// A bit for each joint that was chosen last.
    chosen: u32,
    /// The sources of the variables; none while there is no table.
    sources: OfServos<Source<W>>,
    values: [Option<Values>; ALL],
    next: Option<Instant>,
    /// The count of the terminal's output after the last table.
    drawn: Option<u32>,
}

/// The loop of a servo processor.
struct Source<W> {
    to: Processor,
    watcher: Watcher<W>,
    first: u32,
    columns: Columns,
}

/// For each value that the table shows: its joint, its column, and the number of its variable.
type Columns = heapless::Vec<(u8, u8, u32), { ALL * COLUMNS.len() }>;

impl<W> Watching<W> {
    pub(in super::super) const fn new() -> Self {
        Self {
            chosen: 0,
            sources: OfServos::new(),
            values: [None; ALL],
            next: None,
            drawn: None,
        }
    }
}

impl<'r, M: Machine> Commands<'r, '_, M> {
    /// Shows the joints that are named, or else those of the last time, until something is typed.
    pub(super) fn watch_joints<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let mut chosen = 0_u32;
        while let Some(word) = words.peek().next() {
            if word.bytes().any(|byte| byte == b'.') {
                let (finger, joint) = words.joint(self.hand)?;
                chosen |= 1 << self.numbers.number(finger, joint);
            } else if let Some(finger) = words.finger(self.hand)? {
                chosen |= self.numbers.mask(finger);
            }
        }
        if chosen == 0 {
            chosen = self.watching.chosen;
        }
        if chosen == 0 {
            return Err(Problem::Missing("a finger or FINGER.JOINT"));
        }
        self.watching.chosen = chosen;
        let begun = self.begin_watch(chosen);
        if begun.is_err() {
            self.end_watch();
        } else {
            self.say(format_args!("any key ends the table"));
        }
        begun
    }

    fn begin_watch(&mut self, chosen: u32) -> Result<(), Problem<'static>> {
        let mut wanted = OfServos::<(Processor, VariableTable<M::Window>, Columns)>::new();
        for (finger, entry) in self.hand.fingers.iter().enumerate() {
            for (joint, named) in entry.joints.iter().enumerate() {
                let place = self.numbers.number(finger, joint);
                if chosen >> place & 1 == 0 {
                    continue;
                }
                let (to, table) = self.servos.table(finger)?;
                if !wanted.iter().any(|(it, ..)| *it == to) {
                    // At most one for each finger.
                    let _ = wanted.push((to, table.clone(), Columns::new()));
                }
                let known = wanted.iter_mut().find(|(it, ..)| *it == to);
                let Some((_, _, columns)) = known else {
                    continue;
                };
                for (column, (variable, ..)) in COLUMNS.iter().enumerate() {
                    let mut name = heapless::String::<NAME_BYTES>::new();
                    // The names of a configuration are short enough.
                    let _ = write!(name, "{}.{}.{variable}", entry.name, named.name);
                    let found = table.find(&name)?.filter(|it| it.kind == ValueKind::F32);
                    let found = found.ok_or(Problem::Absent(to.0))?;
                    let _ = columns.push((place as u8, column as u8, found.number));
                }
            }
        }
        while let Some((to, table, columns)) = wanted.pop() {
            let numbers = columns.iter().map(|&(_, _, number)| number);
            let first = numbers.clone().min().unwrap_or(0);
            let last = numbers.max().unwrap_or(0);
            // All from the first to the last: that is one piece of the loop's memory.
            let entries: heapless::Vec<u32, WORDS> = (first..=last).take(WORDS).collect();
            let mut client = self.client(to)?;
            let mut watcher = client.claim(&table, ANSWER)?;
            let every = (self.hand.servo_hz / ROWS_HZ).max(1);
            let selected = client.select(&mut watcher, &entries, every, ANSWER);
            let source = Source {
                to,
                watcher,
                first,
                columns,
            };
            // As many as there are; one that is not selected is given back, too.
            let _ = self.watching.sources.push(source);
            selected?;
        }
        self.watching.values = [None; ALL];
        (self.watching.next, self.watching.drawn) = (None, None);
        Ok(())
    }

    /// Makes a client of the variables and parameters of a processor.
    pub(super) fn client(
        &self,
        to: Processor,
    ) -> Result<VariableClient<'r, condor_rt::MailboxOf<'r, M>, M::Window>, ProgramError> {
        let (machine, mailbox) = (self.background.machine(), self.background.mailbox());
        let own = users(machine, machine.number())?;
        Ok(VariableClient::new(
            mailbox,
            own,
            &mut self.tuning.clone(),
            to,
            VARS,
        )?)
    }

    /// Returns true while the table is shown.
    pub(in super::super) fn is_watching(&self) -> bool {
        !self.watching.sources.is_empty()
    }

    /// Ends the table, if there is one.
    pub(in super::super) fn end_watch(&mut self) {
        while let Some(mut source) = self.watching.sources.pop() {
            if let Ok(mut client) = self.client(source.to) {
                // A loop that has ended has no slots any more.
                let _ = client.release(&mut source.watcher, ANSWER);
            }
        }
    }

    /// Shows the table anew when it is time to.
    pub(in super::super) fn show_watched(&mut self) -> Result<(), ProgramError> {
        let now = self.background.machine().doorbell().now();
        let watching = &mut self.watching;
        if watching.sources.is_empty() || watching.next.is_some_and(|next| now < next) {
            return Ok(());
        }
        let is_first = watching.next.is_none();
        watching.next = Some(now.after(PERIOD));
        for source in &mut watching.sources {
            source.read(&mut watching.values);
        }
        if is_first {
            // The loops have not written a row yet.
            return Ok(());
        }
        let rows = watching.chosen.count_ones() + 1;
        let console = self.background.console()?;
        // In the place of the last one, unless something was shown below it.
        if watching.drawn == Some(console.written()) {
            self.background.print(format_args!("\x1b[{rows}A"));
        }
        show(self.background, format_args!("{Titles}"));
        for (place, values) in self.watching.values.iter().enumerate() {
            if self.watching.chosen >> place & 1 == 0 {
                continue;
            }
            let Some((finger, joint)) = self.numbers.place(place) else {
                continue;
            };
            let names = self.hand.fingers.get(finger);
            let names = names.and_then(|it| Some((&*it.name, &*it.joints.get(joint)?.name)));
            let row = Row {
                names: names.unwrap_or_default(),
                values: *values,
                mode: mode(self.servos.status(finger.min(FINGERS)), joint),
            };
            show(self.background, format_args!("{row}"));
        }
        self.watching.drawn = Some(console.written());
        Ok(())
    }
}

/// Shows a line, and nothing of what was there before.
fn show<M: Machine>(background: &Background<'_, M>, line: fmt::Arguments<'_>) {
    background.print(format_args!("{line}\x1b[K\n"));
}

impl<W: MemoryWindow> Source<W> {
    /// Takes over the values of the last row; of a loop that has ended, none.
    fn read(&mut self, values: &mut [Option<Values>; ALL]) {
        let mut words = [0; WORDS];
        let mut last = Ok(false);
        // As many rows as a ring may have at most.
        for _ in 0..WORDS {
            match self.watcher.read(&mut words) {
                Ok(Some(_)) => last = Ok(true),
                Ok(None) => break,
                Err(_) => {
                    last = Err(());
                    break;
                }
            }
        }
        if last == Ok(false) {
            return;
        }
        for &(joint, column, number) in &self.columns {
            let Some(place) = values.get_mut(usize::from(joint)) else {
                continue;
            };
            if last.is_err() {
                *place = None;
                continue;
            }
            let word = words.get(number.wrapping_sub(self.first) as usize);
            let all = place.get_or_insert([f32::NAN; COLUMNS.len()]);
            if let (Some(word), Some(value)) = (word, all.get_mut(usize::from(column))) {
                *value = f32::from_bits(*word);
            }
        }
    }
}

/// Over the rows.
struct Titles;

impl Display for Titles {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:<NAME$}", "joint")?;
        for (_, title, _) in COLUMNS {
            write!(f, "{title:>VALUE$}")?;
        }
        f.write_str("  mode")
    }
}

/// A joint.
struct Row<'h> {
    names: (&'h str, &'h str),
    values: Option<Values>,
    mode: &'static str,
}

impl Display for Row<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut name = heapless::String::<NAME_BYTES>::new();
        let (finger, joint) = self.names;
        // The names of a configuration are short enough.
        let _ = write!(name, "{finger}.{joint}");
        write!(f, "{name:<NAME$}")?;
        let values = self.values.unwrap_or([f32::NAN; COLUMNS.len()]);
        for (value, (_, _, decimals)) in values.iter().zip(COLUMNS) {
            let mut text = heapless::String::<24>::new();
            // A value that is not finite is not known, or not controlled; no other has as many digits.
            let _ = if value.is_finite() {
                write!(text, "{:.decimals$}", Decimal(f64::from(*value)))
            } else {
                text.write_str("-")
            };
            write!(f, "{text:>VALUE$}")?;
        }
        write!(f, "  {}", self.mode)
    }
}

/// Returns the mode of a joint, in a word.
fn mode(status: Option<&ServoStatus<JOINTS>>, joint: usize) -> &'static str {
    let Some(status) = status else {
        return "gone";
    };
    if status.fault.is_some() {
        return "fault";
    }
    status.modes.get(joint).map_or("off", |mode| mode.name())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_stands_below_its_titles_and_fits_a_small_terminal() {
        let row = |values| Row {
            names: ("index", "abduction"),
            values,
            mode: "position",
        };
        let full = row(Some([-1.23456, 0.5, f32::NAN, 12.345, 130.0])).to_string();
        assert_eq!(
            full,
            "index.abduction     -1.2346    0.5000         -     12.35    130.00  position"
        );
        let titles = Titles.to_string();
        assert_eq!(titles.find("  mode"), full.find("  position"));
        assert!(full.len() < 80);
        let none = row(None).to_string();
        assert_eq!(none.matches(" -").count(), COLUMNS.len(), "{none}");
    }
}
