//! [`Rows`]: the rows that loops of several processors write for this watcher.

use std::collections::BTreeMap;
use std::time::Duration;

use condor_mbox::linux::LinuxWindow;
use condor_mbox::{Instant, Messenger};
use condor_vars::{TableError, Value, WatchError, Watcher};

use super::clients::{ANSWER, Clients};
use super::known::One;
use crate::error::AnyError;
use crate::view::View;

/// How often rows are fetched.
const LOOK: Duration = Duration::from_millis(5);

/// Slots of all loops that have some of the chosen variables; given back when it is dropped.
pub(super) struct Rows<'s> {
    view: &'s View,
    clients: Clients<'s>,
    pub(super) sources: Vec<Source<'s>>,
    columns: usize,
    /// How far this host's clock is ahead of that of all harts; `None` before the first row of one.
    ahead_ns: Option<u64>,
}

/// A loop.
pub(super) struct Source<'s> {
    /// One of its variables.
    one: &'s One<'s>,
    watcher: Watcher<LinuxWindow>,
    /// The variables of a row, in the order of their values.
    fields: Vec<Field>,
    /// How many rows were read.
    pub(super) rows: u64,
}

/// A value of a row: its type, and the columns that show it.
type Field = (condor_vars::Kind, Vec<usize>);

/// What variables of one loop were in one tick.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Sample {
    pub(super) tick: u64,
    /// When the tick was released, on the clock of this host.
    pub(super) released: Instant,
    /// For each column its value; `None` of variables of other loops.
    pub(super) values: Vec<Option<Value>>,
}

impl<'s> Rows<'s> {
    /// Asks for a row every `every` ticks of each loop; columns without a variable stay empty.
    pub(super) fn of(
        view: &'s View,
        columns: &[Option<&'s One<'s>>],
        every: u32,
    ) -> Result<Self, AnyError> {
        // In the order of rows: by the number of the entry.
        let mut loops = BTreeMap::<_, BTreeMap<u32, (&One<'_>, Vec<usize>)>>::new();
        for (column, one) in columns.iter().enumerate() {
            let Some(one) = one else { continue };
            let of_loop = loops
                .entry((one.member.number, one.table.offset()))
                .or_default();
            let (_, columns) = of_loop.entry(one.entry.number).or_insert((one, Vec::new()));
            columns.push(column);
        }
        let mut rows = Self {
            view,
            clients: Clients::new(view),
            sources: Vec::new(),
            columns: columns.len(),
            ahead_ns: None,
        };
        for of_loop in loops.into_values() {
            rows.add(&of_loop, every)?;
        }
        Ok(rows)
    }

    fn add(
        &mut self,
        chosen: &BTreeMap<u32, (&'s One<'s>, Vec<usize>)>,
        every: u32,
    ) -> Result<(), AnyError> {
        let Some((one, _)) = chosen.values().next() else {
            return Ok(());
        };
        let numbers: Vec<u32> = chosen.keys().copied().collect();
        let fields = chosen
            .values()
            .map(|(one, columns)| (one.of.kind, columns.clone()));
        let failed = |error| format!("{}: {error}", one.place());
        let client = self.clients.of(one)?;
        let mut watcher = client.claim(&one.table, ANSWER).map_err(failed)?;
        let selected = client.select(&mut watcher, &numbers, every, ANSWER);
        self.sources.push(Source {
            one,
            watcher,
            fields: fields.collect(),
            rows: 0,
        });
        Ok(selected.map_err(failed)?)
    }

    /// Hands over all rows that there are, loop by loop, with the number of the source.
    pub(super) fn read(&mut self, mut take: impl FnMut(usize, Sample)) -> Result<(), AnyError> {
        let now = self.view.post().now();
        for (number, source) in self.sources.iter_mut().enumerate() {
            let mut words = vec![0; source.watcher.words()];
            let one = source.one;
            let failed = |error| failure(one, error);
            // More can only come meanwhile.
            for _ in 0..source.watcher.rows() {
                let Some(row) = source.watcher.read(&mut words).map_err(failed)? else {
                    break;
                };
                source.rows += 1;
                let released_ns = row.released.as_ns();
                // What runs here shares this host's clock. All others share another: their first row counts
                // as released now.
                let ahead_ns = if one.member.runs_here {
                    0
                } else {
                    *self
                        .ahead_ns
                        .get_or_insert(now.as_ns().wrapping_sub(released_ns))
                };
                let sample = Sample {
                    tick: row.tick,
                    released: Instant::from_ns(released_ns.wrapping_add(ahead_ns)),
                    values: spread(&source.fields, &words, self.columns),
                };
                take(number, sample);
            }
        }
        Ok(())
    }

    /// Returns the loops of which no row has come yet.
    pub(super) fn silent(&self) -> Vec<String> {
        let silent = self.sources.iter().filter(|source| source.rows == 0);
        silent.map(Source::name).collect()
    }

    /// Waits until there may be more rows.
    pub(super) fn pause(&self) -> Result<(), AnyError> {
        self.view.post().serve(LOOK)?;
        Ok(())
    }
}

impl Drop for Rows<'_> {
    fn drop(&mut self) {
        for source in &mut self.sources {
            // What is not given back belongs to nobody as soon as this process has ended.
            if let Ok(client) = self.clients.of(source.one) {
                let _ = client.release(&mut source.watcher, ANSWER);
            }
        }
    }
}

impl Source<'_> {
    pub(super) fn name(&self) -> String {
        self.one.place()
    }

    /// Returns how many rows were overwritten before they could be read.
    pub(super) const fn lost(&self) -> u64 {
        self.watcher.lost()
    }

    /// Returns the seconds between two rows, without overruns; infinite if the loop has no rate.
    pub(super) fn period_s(&self, every: u32) -> f64 {
        let (ticks, seconds) = self.one.table.rate();
        f64::from(every) * f64::from(seconds) / f64::from(ticks)
    }
}

fn failure(one: &One<'_>, error: WatchError) -> String {
    match error {
        WatchError::Table(TableError::Restarted { .. }) => {
            format!(
                "the program of {} was restarted; run the command again",
                one.member.name
            )
        }
        error => format!("{}: {error}", one.place()),
    }
}

/// Puts the values of a row into their columns.
fn spread(fields: &[Field], words: &[u32], columns: usize) -> Vec<Option<Value>> {
    let (mut values, mut words) = (vec![None; columns], words);
    for (kind, shown_in) in fields {
        let Some((value, rest)) = kind.split(words) else {
            break;
        };
        words = rest;
        for column in shown_in {
            if let Some(place) = values.get_mut(*column) {
                *place = Some(value);
            }
        }
    }
    values
}

#[cfg(test)]
mod tests {
    use condor_vars::Kind;

    use super::*;

    #[test]
    fn values_go_to_the_columns_that_show_them() {
        let fields = [(Kind::U64, vec![3]), (Kind::Bool, vec![0, 2])];
        let values = spread(&fields, &[5, 1, 1], 5);
        let (long, flag) = (Value::Uint(0x1_0000_0005), Value::Bool(true));
        let expected = [Some(flag), None, Some(flag), Some(long), None];
        assert_eq!(values, expected);
    }

    #[test]
    fn a_row_that_is_too_short_has_no_more_values() {
        let fields = [(Kind::U32, vec![0]), (Kind::F64, vec![1])];
        assert_eq!(spread(&fields, &[7, 0], 2), [Some(Value::Uint(7)), None]);
    }
}
