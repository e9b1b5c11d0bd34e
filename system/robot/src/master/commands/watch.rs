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
use crate::message::ServoStatus;
use crate::{ACTUATORS, JOINTS};

/// The time between two tables.
const PERIOD: Duration = Duration::from_millis(250);
/// The least number of rows of a loop's variables in a second.
const ROWS_HZ: u32 = 8;
/// The columns of a joint, and those of an actuator: the variable, its title, and the number of decimals.
const JOINT: [Column; 3] = [
    ("position", "is rad", 4),
    ("target", "wanted", 4),
    ("torque", "N m", 4),
];
const ACTUATOR: [Column; 3] = [
    ("effort", "effort", 4),
    ("desired", "wanted", 4),
    ("command", "command", 4),
];
/// The most rows: joints, and then the actuators of each finger.
const ROWS: usize = ALL + FINGERS * ACTUATORS;
/// The columns of a joint's name, and of a value with the blank before it.
const NAME: usize = 24;
const VALUE: usize = 10;
/// The most variables of a loop from the first to the last that is shown.
const WORDS: usize = 192;

type Column = (&'static str, &'static str, u8);
/// The values of a row's variables.
type Values = [f32; JOINT.len()];

/// The table of chosen joints and actuators.
pub(in super::super) struct Watching<W> {
    /// A bit for each row that was chosen last.
    chosen: u64,
    /// The sources of the variables; none while there is no table.
    sources: OfServos<Source<W>>,
    values: [Option<Values>; ROWS],
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

/// For each value that the table shows: its row, its column, and the number of its variable.
type Columns = heapless::Vec<(u8, u8, u32), { ROWS * JOINT.len() }>;

impl<W> Watching<W> {
    pub(in super::super) const fn new() -> Self {
        Self {
            chosen: 0,
            sources: OfServos::new(),
            values: [None; ROWS],
            next: None,
            drawn: None,
        }
    }
}

impl<'r, M: Machine> Commands<'r, '_, M> {
    /// Shows the joints that are named, each with its actuators, and those of fingers that are named, or else those of the
    /// last time, until something is typed.
    pub(super) fn watch_joints<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let mut chosen = 0_u64;
        while let Some(word) = words.peek().next() {
            if word.bytes().any(|byte| byte == b'.') {
                let (finger, joint) = words.joint(self.hand)?;
                chosen |= 1 << self.numbers.number(finger, joint);
                let entry = self.hand.fingers.get(finger);
                let actuators = 0..entry.map_or(0, |entry| entry.actuators.len());
                let own = |actuator: &usize| {
                    entry.and_then(|entry| entry.joint_of(*actuator)) == Some(joint)
                };
                for actuator in actuators.filter(own) {
                    chosen |= 1 << row_of(finger, actuator);
                }
            } else if let Some(finger) = words.finger(self.hand)? {
                chosen |= u64::from(self.numbers.mask(finger));
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

    fn begin_watch(&mut self, chosen: u64) -> Result<(), Problem<'static>> {
        let mut wanted = OfServos::<(Processor, VariableTable<M::Window>, Columns)>::new();
        for (finger, entry) in self.hand.fingers.iter().enumerate() {
            let joints = entry.joints.iter().enumerate();
            let joints = joints.map(|(joint, named)| {
                let row = self.numbers.number(finger, joint);
                (row, &named.name, &JOINT)
            });
            let actuators = entry.actuators.iter().enumerate();
            let actuators = actuators
                .map(|(actuator, named)| (row_of(finger, actuator), &named.name, &ACTUATOR));
            for (place, part, shown) in joints.chain(actuators) {
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
                for (column, (variable, ..)) in shown.iter().enumerate() {
                    let mut name = heapless::String::<NAME_BYTES>::new();
                    // The names of a configuration are short enough.
                    let _ = write!(name, "{}.{part}.{variable}", entry.name);
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
        self.watching.values = [None; ROWS];
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
        let chosen = watching.chosen;
        let has_actuators = chosen >> ALL != 0;
        let rows = chosen.count_ones() + 1 + u32::from(has_actuators);
        let console = self.background.console()?;
        // In the place of the last one, unless something was shown below it.
        if watching.drawn == Some(console.written()) {
            self.background.print(format_args!("\x1b[{rows}A"));
        }
        let titles = Titles("joint", &JOINT, "  mode");
        show(self.background, format_args!("{titles}"));
        for (place, values) in self.watching.values.iter().enumerate() {
            if place == ALL && has_actuators {
                let titles = Titles("actuator", &ACTUATOR, "");
                show(self.background, format_args!("{titles}"));
            }
            if chosen >> place & 1 == 0 {
                continue;
            }
            let (finger, names, mode) = match place.checked_sub(ALL) {
                None => {
                    let place = self.numbers.place(place);
                    let (finger, joint) = place.unwrap_or((FINGERS, JOINTS));
                    let name = self.hand.joint(finger, joint).map(|it| &it.name);
                    let mode = mode(self.servos.status(finger.min(FINGERS)), joint);
                    (finger, name, mode)
                }
                Some(place) => {
                    let (finger, actuator) = (place / ACTUATORS, place % ACTUATORS);
                    let name = self.hand.actuator(finger, actuator).map(|it| &it.name);
                    (finger, name, "")
                }
            };
            let finger = self.hand.fingers.get(finger).map(|it| &*it.name);
            let row = Row {
                names: finger.zip(names.map(|it| &**it)).unwrap_or_default(),
                values: *values,
                columns: if place < ALL { &JOINT } else { &ACTUATOR },
                mode,
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
    fn read(&mut self, values: &mut [Option<Values>; ROWS]) {
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
        for &(row, column, number) in &self.columns {
            let Some(place) = values.get_mut(usize::from(row)) else {
                continue;
            };
            if last.is_err() {
                *place = None;
                continue;
            }
            let word = words.get(number.wrapping_sub(self.first) as usize);
            let all = place.get_or_insert([f32::NAN; JOINT.len()]);
            if let (Some(word), Some(value)) = (word, all.get_mut(usize::from(column))) {
                *value = f32::from_bits(*word);
            }
        }
    }
}

/// The row of an actuator.
const fn row_of(finger: usize, actuator: usize) -> usize {
    ALL + finger * ACTUATORS + actuator
}

/// Over the rows: the title of the names, the columns, and the title behind them.
struct Titles(&'static str, &'static [Column], &'static str);

impl Display for Titles {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(names, columns, last) = self;
        write!(f, "{names:<NAME$}")?;
        for (_, title, _) in *columns {
            write!(f, "{title:>VALUE$}")?;
        }
        f.write_str(last)
    }
}

/// A joint or an actuator.
struct Row<'h> {
    names: (&'h str, &'h str),
    values: Option<Values>,
    columns: &'static [Column],
    mode: &'static str,
}

impl Display for Row<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut name = heapless::String::<NAME_BYTES>::new();
        let (finger, part) = self.names;
        // The names of a configuration are short enough.
        let _ = write!(name, "{finger}.{part}");
        write!(f, "{name:<NAME$}")?;
        let values = self.values.unwrap_or([f32::NAN; JOINT.len()]);
        for (value, &(_, _, decimals)) in values.iter().zip(self.columns) {
            let mut text = heapless::String::<24>::new();
            // A value that is not finite is not known, or not controlled; no other has as many digits.
            let decimals = usize::from(decimals);
            let _ = if value.is_finite() {
                write!(text, "{:.decimals$}", Decimal(f64::from(*value)))
            } else {
                text.write_str("-")
            };
            write!(f, "{text:>VALUE$}")?;
        }
        if !self.mode.is_empty() {
            write!(f, "  {}", self.mode)?;
        }
        Ok(())
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
            columns: &JOINT,
            mode: "position",
        };
        let full = row(Some([-1.23456, 0.5, f32::NAN])).to_string();
        assert_eq!(
            full,
            "index.abduction            -1.2346    0.5000         -  position"
        );
        let titles = Titles("joint", &JOINT, "  mode").to_string();
        assert_eq!(titles.find("  mode"), full.find("  position"));
        assert!(full.len() < 80);
        let none = row(None).to_string();
        assert_eq!(none.matches(" -").count(), JOINT.len(), "{none}");
        let actuator = Row {
            names: ("index", "abduction-flexor"),
            values: Some([12.345, 130.0, f32::NAN]),
            columns: &ACTUATOR,
            mode: "",
        };
        let titles = Titles("actuator", &ACTUATOR, "").to_string();
        assert_eq!(titles.len(), actuator.to_string().len());
        assert_eq!(
            actuator.to_string(),
            "index.abduction-flexor     12.3450  130.0000         -"
        );
    }
}
