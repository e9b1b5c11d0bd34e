//! The command `gains`: it shows and sets the parameters of a joint.

use core::fmt::Write as _;

use condor_hand::decimal::Decimal;
use condor_mbox::{MemoryWindow, Messenger};
use condor_rt::Machine;
use condor_vars::layout::NAME_BYTES;
use condor_vars::{AnyValue, TableEntry, VariableClient, VariableTable};

use super::super::servos::ANSWER;
use super::super::words::{Problem, Words};
use super::Commands;

/// The columns of a line.
const LINE: usize = 79;
/// A text that is shorter than a line.
type Text = heapless::String<LINE>;
const LAW: &str = "a law: pd or decoupled";

impl<M: Machine> Commands<'_, '_, M> {
    pub(super) fn gains<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let (finger, part) = words.joint_or_actuator(self.hand)?;
        let (to, table) = self.servos.table(finger)?;
        let client = self.client(to)?;
        let mut prefix = heapless::String::new();
        if let Some(finger) = self.hand.fingers.get(finger) {
            // The names of a configuration are short enough.
            let _ = write!(prefix, "{}.{part}.", finger.name);
        }
        let mut gains = Gains {
            client,
            table,
            prefix,
        };
        if words.peek().next().is_none() {
            return gains.show(|line| self.say(format_args!("{line}")));
        }
        while let Some(name) = words.next() {
            let value = words.peek().next().unwrap_or_default();
            let former = gains.set(name, words)?;
            self.say(format_args!("{}{name}: {former} -> {value}", gains.prefix));
        }
        Ok(())
    }
}

/// The parameters of a joint or an actuator.
struct Gains<'m, C: Messenger + ?Sized, W> {
    client: VariableClient<'m, C, W>,
    table: VariableTable<W>,
    /// The prefix of their names.
    prefix: heapless::String<NAME_BYTES>,
}

impl<C: Messenger + ?Sized, W: MemoryWindow> Gains<'_, C, W> {
    /// Returns its name without that of the joint or actuator; `None` if it is none of these.
    fn name<'e>(&self, entry: &'e TableEntry) -> Option<&'e str> {
        let name = entry.name.strip_prefix(self.prefix.as_str());
        name.filter(|_| entry.bounds.is_some())
    }

    /// Sets a gain to the value that is the next word; returns the text of the former one.
    fn set<'l>(&mut self, name: &'l str, words: &mut Words<'l>) -> Result<Text, Problem<'l>> {
        let mut found = None;
        for entry in self.table.entries() {
            found = found.or(Some(entry?).filter(|entry| self.name(entry) == Some(name)));
        }
        let entry = found.ok_or(Problem::Gain(name))?;
        let value = if let Some([AnyValue::F64(low), AnyValue::F64(high)]) = entry.bounds {
            let what = "the value of a gain";
            let word = words.peek().next().ok_or(Problem::Missing(what))?;
            let value = words.number(what)?;
            if !(low..=high).contains(&value) {
                return Err(Problem::Bounds {
                    word,
                    name,
                    value,
                    low,
                    high,
                });
            }
            AnyValue::F64(value)
        } else {
            let word = words.word(LAW)?;
            let is_it = |number: &u32| {
                let label = self.table.label(&entry, *number);
                matches!(label, Ok(Some(label)) if label == word)
            };
            let number = (0..entry.labels.into()).find(is_it);
            AnyValue::Choice(number.ok_or(Problem::Not { word, what: LAW })?)
        };
        let former = self.client.get(&self.table, &entry, ANSWER)?;
        self.client
            .set(&self.table, &entry, former, value, ANSWER)?;
        self.text(&entry, former)
    }

    /// Returns a value as a text; an empty one if a gain cannot have it.
    fn text(&self, entry: &TableEntry, value: AnyValue) -> Result<Text, Problem<'static>> {
        let mut text = Text::new();
        // A value is shorter than a line.
        let _ = match value {
            AnyValue::F64(value) => write!(text, "{}", Decimal(value)),
            AnyValue::Choice(number) => {
                let label = self.table.label(entry, number)?;
                text.write_str(label.as_deref().unwrap_or("?"))
            }
            _ => Ok(()),
        };
        Ok(text)
    }

    /// Shows all, as many in a line as it has room for.
    fn show(&mut self, say: impl Fn(&str)) -> Result<(), Problem<'static>> {
        let mut line = heapless::String::<LINE>::new();
        for entry in self.table.entries() {
            let entry = entry?;
            let Some(name) = self.name(&entry) else {
                continue;
            };
            let value = self.client.get(&self.table, &entry, ANSWER)?;
            let mut text = Text::new();
            // A gain and its value are shorter than a line.
            let _ = write!(text, "{name} {}", self.text(&entry, value)?);
            if line.len() + 2 + text.len() > LINE {
                say(&line);
                line.clear();
            }
            let gap = if line.is_empty() { "" } else { "  " };
            let _ = write!(line, "{gap}{text}");
        }
        say(&line);
        Ok(())
    }
}
