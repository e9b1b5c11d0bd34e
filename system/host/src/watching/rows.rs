//! [`Rows`]: the values of chosen variables while programs run.

use core::ops::Range;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{self, Duration};

use condor_mbox::linux::LinuxWindow;
use condor_mbox::published::PublishedReadError;
use condor_mbox::{Instant, Messenger};
use condor_vars::{
    AnyValue, Cell, CellError, RequestError, TableEntry, ValueKind, VariableTable,
    VariableTableError, WatchError, Watcher,
};

use super::catalog::CatalogEntry;
use super::clients::Clients;
use crate::control::Member;
use crate::error::AnyError;
use crate::view::{MailboxState, View, ViewError};

/// The time between two looks for rows.
const LOOK: Duration = Duration::from_millis(5);
/// The time between two attempts to find the variables of a program that was restarted.
const AGAIN: Duration = Duration::from_millis(200);
/// The texts for people when the first rows of a source come, and when rows come again after its program was
/// gone.
const BEGINS: &str = "its rows begin";
const GOES_ON: &str = "its rows go on";
/// The end of the text about a source whose program does not answer yet.
pub(super) const LATER: &str = "; its rows begin when its program answers";
/// The time that a program which comes later has to answer: others lose rows meanwhile.
const QUICK_ANSWER: Duration = Duration::from_millis(100);

/// A reader of the values of chosen variables and fields: row by row, as loops and the writers of published cells write
/// them. It goes on when programs are restarted.
///
/// Each loop has a limited number of slots for readers of rows. This reader uses one slot of each loop, and releases it
/// when it is dropped.
pub struct Rows<'v> {
    view: &'v View,
    clients: Clients<'v>,
    /// The sources, in the order of processors and of their tables.
    pub sources: Vec<RowSource>,
    every: u32,
    /// The time by which this host's clock is ahead of the clock of all harts, in real time; `None` before the
    /// first row of a hart.
    ahead_ns: Option<u64>,
    changes: Vec<Change>,
}

/// A source of rows: a loop whose variables are watched, or a published cell.
pub struct RowSource {
    member: Arc<Member>,
    owner: Arc<str>,
    fields: Vec<RowField>,
    supply: Supply,
    /// The number of rows that were read.
    pub rows: u64,
    /// The number of rows that were lost before the present watcher, and between it and the one before.
    lost_before: u64,
    /// The number of values that were skipped before the present cell.
    skipped_before: u64,
    /// The incarnation of the table of the present watcher.
    incarnation: u32,
    /// The tick of the last row of that incarnation; `None` before the first one.
    last_tick: Option<u64>,
    /// Whether the next row is the first one since the source was gone.
    is_back: bool,
    rate: (u32, u32),
}

/// The origin of the rows of a source.
enum Supply {
    Loop(LoopSupply),
    Cell(CellSupply),
    /// The rows that were read belong to a previous incarnation of the program.
    Gone {
        looked: time::Instant,
        /// The reason why its variables were not found then; empty before the first look.
        why: String,
    },
}

struct LoopSupply {
    watcher: Watcher<LinuxWindow>,
    /// The words of a row that were asked for, if others lie between them; otherwise empty.
    wanted: Vec<Range<usize>>,
}

struct CellSupply {
    cell: Cell<LinuxWindow>,
    /// The fields, in the order of the source's.
    entries: Vec<TableEntry>,
    /// The sequence number of the value that was read last.
    last: Option<u32>,
    /// The number of values that were published between two that were read.
    skipped: u64,
}

/// The description of one value in each row of a source: its name, its type, and the columns that show it.
#[derive(Clone, Debug, PartialEq)]
pub struct RowField {
    /// The name of the variable in its loop, or of the field in its cell.
    pub name: String,
    /// The type of the value.
    pub kind: ValueKind,
    /// The columns that show it.
    pub columns: Vec<usize>,
}

/// A row: the values of all watched variables of a source at one tick.
#[derive(Clone, Copy, Debug)]
pub struct SourceRow<'r> {
    /// The number of the tick; the sequence number of the value of a cell.
    pub tick: u64,
    /// The time at which the tick was released, on the clock of the system; for a cell, the time at which the
    /// value was read.
    pub released: Instant,
    /// The number of rows that were lost between the previous row and this one; 0 for a cell, which is sampled.
    pub lost: u32,
    /// The fields of the values, in their order.
    pub fields: &'r [RowField],
    /// The values of the fields, one after the other.
    pub words: &'r [u32],
}

impl<'r> SourceRow<'r> {
    /// Iterates over the values of the row in the order of its fields, each with its field.
    pub fn values(&self) -> impl Iterator<Item = (&'r RowField, AnyValue)> {
        let mut words = self.words;
        self.fields.iter().map_while(move |field| {
            let (value, rest) = field.kind.split(words)?;
            words = rest;
            Some((field, value))
        })
    }
}

/// A change of a source of rows: its program has ended, is back, or cannot be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Change {
    /// The number of the source.
    pub source: usize,
    /// The description of the change, with the name of the source.
    pub text: String,
}

impl<'v> Rows<'v> {
    /// Begins to read the variables in `columns`: asks each loop that has some of them for a row every `every` ticks.
    /// Loops have 2 s to answer.
    ///
    /// # Errors
    /// Returns an error if a loop or a cell cannot have rows for this visitor; the text names it and says why.
    /// A loop that does not answer in time is not an error: [`changes`](Self::changes) names it, and its rows
    /// begin when it answers.
    pub fn of(view: &'v View, columns: &[&CatalogEntry], every: u32) -> Result<Self, AnyError> {
        Self::with(Clients::new(view), columns, every)
    }

    /// Begins to read the variables in `columns`, as [`of`](Self::of) does, by `clients` that exist already. Their
    /// timeout is the time that a loop has to answer.
    ///
    /// # Errors
    /// Returns an error if a loop or a cell cannot have rows for this visitor, as [`of`](Self::of) does.
    pub fn with(
        clients: Clients<'v>,
        columns: &[&CatalogEntry],
        every: u32,
    ) -> Result<Self, AnyError> {
        let mut rows = Self {
            view: clients.view(),
            clients,
            sources: Vec::new(),
            every,
            ahead_ns: None,
            changes: Vec::new(),
        };
        let answer = rows.clients.timeout();
        for of_source in by_source(columns) {
            if let Err(error) = rows.add(&of_source, answer)
                && !error.may_end()
            {
                let place = rows.name(rows.sources.len().saturating_sub(1));
                let source = error.inner();
                return Err(SourceError { place, source }.into());
            }
        }
        Ok(rows)
    }

    /// Begins to read the variables in `columns`, too. They must belong to loops and cells that are not read yet. Each
    /// of these becomes a new source; [`RowField::columns`] of its fields are indices into `columns`.
    /// [`changes`](Self::changes) says whether its rows begin.
    pub fn extend(&mut self, columns: &[&CatalogEntry]) {
        for of_source in by_source(columns) {
            let number = self.sources.len();
            // A source that is refused is told by `add`.
            if self.add(&of_source, QUICK_ANSWER).is_ok() {
                self.tell(number, BEGINS);
            }
        }
    }

    /// Adds a source of these variables, which are sorted by number. It has no rows yet if it is refused.
    fn add(
        &mut self,
        chosen: &BTreeMap<u32, (&CatalogEntry, Vec<usize>)>,
        answer: Duration,
    ) -> Result<(), SupplyError> {
        let Some((one, _)) = chosen.values().next() else {
            return Ok(());
        };
        let (member, owner, table) = (&one.member, &one.owner, &one.table);
        let entries: Vec<_> = chosen.values().map(|(one, _)| one.entry.clone()).collect();
        let fields = chosen.values().map(|(one, columns)| RowField {
            name: one.entry.name.to_string(),
            kind: one.entry.kind,
            columns: columns.clone(),
        });
        let (supply, refused) = match self.supply(member, table, entries, answer) {
            Ok(supply) => (supply, None),
            Err(error) => (Supply::gone(error.to_string()), Some(error)),
        };
        self.sources.push(RowSource {
            member: member.clone(),
            owner: owner.clone(),
            fields: fields.collect(),
            supply,
            rows: 0,
            lost_before: 0,
            skipped_before: 0,
            incarnation: table.incarnation(),
            last_tick: None,
            is_back: false,
            rate: table.rate(),
        });
        let Some(error) = refused else {
            return Ok(());
        };
        let number = self.sources.len() - 1;
        self.tell(number, &format!("{error}{LATER}"));
        Err(error)
    }

    /// Claims and selects what delivers the values of `entries`, which are sorted by number.
    fn supply(
        &mut self,
        member: &Member,
        table: &VariableTable<LinuxWindow>,
        entries: Vec<TableEntry>,
        answer: Duration,
    ) -> Result<Supply, SupplyError> {
        if table.cell().is_some() {
            let region = self.view.region(member.processor())?;
            return Ok(Supply::Cell(CellSupply {
                cell: Cell::open(&region, table.offset())?,
                entries,
                last: None,
                skipped: 0,
            }));
        }
        let numbers: Vec<u32> = entries.iter().map(|entry| entry.number).collect();
        let client = self.clients.of(member)?;
        let mut watcher = client.claim(table, answer)?;
        let mut wanted = Vec::new();
        let mut selected = client.select(&mut watcher, &numbers, self.every, answer);
        if let Err(RequestError::Scattered { .. }) = selected
            && let (Some(first), Some(last)) = (numbers.first(), numbers.last())
        {
            // With all that lies between them, they are one piece.
            let all = (*first..=*last).map(|it| Ok((it, table.entry(it)?.kind.words())));
            let all = all.collect::<Result<Vec<_>, VariableTableError>>()?;
            wanted = words_of(&all, &numbers);
            let all: Vec<u32> = all.into_iter().map(|(number, _)| number).collect();
            selected = client.select(&mut watcher, &all, self.every, answer);
        }
        if let Err(error) = selected {
            // Its slot goes to another claimer if this message is lost, too.
            let _ = client.release(&mut watcher, answer);
            return Err(error.into());
        }
        Ok(Supply::Loop(LoopSupply { watcher, wanted }))
    }

    /// Passes all rows that have come since the last call to `take`, source by source: the index of the source in
    /// [`sources`](Self::sources), and the row.
    ///
    /// After the program of a source was restarted, no rows of it come until its variables are found again.
    /// [`changes`](Self::changes) reports both the end and the return of its rows.
    ///
    /// # Errors
    /// Returns an error if the memory of a source cannot be read; the text names the source.
    pub fn read(&mut self, mut take: impl FnMut(usize, &SourceRow<'_>)) -> Result<(), AnyError> {
        for number in 0..self.sources.len() {
            self.read_source(number, &mut take)?;
        }
        Ok(())
    }

    fn read_source(
        &mut self,
        number: usize,
        take: &mut impl FnMut(usize, &SourceRow<'_>),
    ) -> Result<(), AnyError> {
        let Some(source) = self.sources.get_mut(number) else {
            return Ok(());
        };
        let now = self.view.now();
        let shares_clock = source.member.runs_here || self.view.is_simulated();
        let (ahead_ns, every) = (&mut self.ahead_ns, u64::from(self.every));
        let (rows, fields) = (&mut source.rows, &source.fields);
        let mut take = |row: SourceRow<'_>| {
            *rows += 1;
            take(number, &row);
        };
        let (last_tick, is_back) = (&mut source.last_tick, &mut source.is_back);
        let lost_before = &mut source.lost_before;
        let read = match &mut source.supply {
            Supply::Loop(supply) => supply.read(fields, |row| {
                // Programs that run here share this host's clock, and all share a simulated one. Others share
                // another clock: their first row counts as released now.
                let released_ns = row.released.as_ns();
                let ahead_ns = if shares_clock {
                    0
                } else {
                    *ahead_ns.get_or_insert(now.as_ns().wrapping_sub(released_ns))
                };
                let released = Instant::from_ns(released_ns.wrapping_add(ahead_ns));
                let before = last_tick.replace(row.tick);
                let mut lost = row.lost;
                if core::mem::take(is_back) {
                    let missed = missed(before, row.tick, every);
                    *lost_before += missed;
                    lost = lost.saturating_add(u32::try_from(missed).unwrap_or(u32::MAX));
                }
                take(SourceRow {
                    released,
                    lost,
                    ..row
                });
            }),
            Supply::Cell(cell) => cell.read(fields, now, take),
            Supply::Gone { looked, .. } if looked.elapsed() < AGAIN => Ok(()),
            Supply::Gone { .. } => {
                self.look_again(number);
                Ok(())
            }
        };
        match read {
            Err(error) if error.is_of_former_incarnation() => {
                if let Some(source) = self.sources.get_mut(number) {
                    source.lost_before = source.lost();
                    source.skipped_before = source.skipped();
                    source.supply = Supply::gone(String::new());
                }
                self.tell(
                    number,
                    "the program was restarted, or gave its slot to another",
                );
                Ok(())
            }
            Err(error) => Err(format!("{}: {error}", self.name(number)).into()),
            Ok(()) => Ok(()),
        }
    }

    /// Looks for the variables of a source whose program was restarted.
    fn look_again(&mut self, number: usize) {
        let found = self.sources.get(number).map(|source| self.find(source));
        let (Some(found), Some(source)) = (found, self.sources.get(number)) else {
            return;
        };
        let member = source.member.clone();
        let incarnation = found
            .as_ref()
            .map_or(source.incarnation, |(table, _)| table.incarnation());
        let supply =
            found.and_then(|(table, entries)| self.supply(&member, &table, entries, QUICK_ANSWER));
        let told = match supply {
            Ok(supply) => {
                if let Some(source) = self.sources.get_mut(number) {
                    // Ticks of the same program before it answered for the first time were never to be read.
                    source.is_back =
                        source.last_tick.is_some() || incarnation != source.incarnation;
                    if incarnation != source.incarnation {
                        (source.incarnation, source.last_tick) = (incarnation, None);
                    }
                    source.supply = supply;
                }
                // The clock of harts begins anew if their machine was restarted.
                if !member.runs_here {
                    self.ahead_ns = None;
                }
                let has_rows = self.sources.get(number).is_some_and(|it| it.rows > 0);
                Some(if has_rows { GOES_ON } else { BEGINS }.to_owned())
            }
            Err(error) => {
                let why = error.to_string();
                let source = self.sources.get_mut(number);
                let before = source.map(|source| {
                    core::mem::replace(&mut source.supply, Supply::gone(why.clone()))
                });
                let is_new =
                    !matches!(before, Some(Supply::Gone { why: before, .. }) if before == why);
                // A program that is about to begin does not answer yet.
                (is_new && error.stays()).then_some(why)
            }
        };
        if let Some(told) = told {
            self.tell(number, &told);
        }
    }

    /// Finds the table of a source anew, and the entries of its fields.
    fn find(
        &self,
        source: &RowSource,
    ) -> Result<(VariableTable<LinuxWindow>, Vec<TableEntry>), SupplyError> {
        let processor = source.member.processor();
        if self.view.heart(processor)?.presence != MailboxState::Up {
            return Err(SupplyError::Absent);
        }
        let all = self.view.variables(processor)?.into_iter();
        let mut all = all.filter(|variables| *variables.name == *source.owner);
        let table = all.next().ok_or(SupplyError::Absent)?.table?;
        let mut all = BTreeMap::new();
        for entry in table.entries() {
            let entry = entry?;
            all.entry(entry.name.to_string()).or_insert(entry);
        }
        let mut entries = Vec::new();
        for field in &source.fields {
            let entry = all.remove(&field.name);
            let entry = entry.filter(|entry| entry.kind == field.kind);
            let entry = entry.ok_or_else(|| SupplyError::Changed(field.name.clone()))?;
            entries.push(entry);
        }
        let mut pairs = source.fields.iter().zip(entries.windows(2));
        match pairs.find(|(_, pair)| matches!(pair, [one, next] if one.number >= next.number)) {
            Some((field, _)) => Err(SupplyError::Changed(field.name.clone())),
            None => Ok((table, entries)),
        }
    }

    fn tell(&mut self, source: usize, what: &str) {
        let text = format!("{}: {what}", self.name(source));
        self.changes.push(Change { source, text });
    }

    fn name(&self, source: usize) -> String {
        self.sources
            .get(source)
            .map(RowSource::name)
            .unwrap_or_default()
    }

    /// Returns the changes of sources since the last call, oldest first: programs that have ended, are back, or cannot
    /// be read.
    pub fn changes(&mut self) -> Vec<Change> {
        core::mem::take(&mut self.changes)
    }

    /// Returns the names of the sources whose programs have answered the request for rows, but have not written a row
    /// yet.
    #[must_use]
    pub fn silent(&self) -> Vec<String> {
        let is_silent = |it: &&RowSource| it.rows == 0 && !matches!(it.supply, Supply::Gone { .. });
        let silent = self.sources.iter().filter(is_silent);
        silent.map(RowSource::name).collect()
    }

    /// Waits until there may be more rows, for some milliseconds at most.
    ///
    /// # Errors
    /// Returns the mailbox's error if the mailbox of the visitor fails.
    pub fn pause(&self) -> Result<(), AnyError> {
        self.view.post().serve(LOOK)?;
        Ok(())
    }
}

impl<'v> Rows<'v> {
    /// Stops reading: releases the slots of the loops. Returns the clients, which should be used again, since each has
    /// a block of the visitor's memory that is never returned.
    #[must_use]
    pub fn end(mut self) -> Clients<'v> {
        self.release();
        self.clients.take()
    }

    fn release(&mut self) {
        let answer = self.clients.timeout();
        for mut source in self.sources.drain(..) {
            // Slots that are not released are free as soon as this process has ended.
            if let Supply::Loop(supply) = &mut source.supply
                && let Ok(client) = self.clients.of(&source.member)
            {
                let _ = client.release(&mut supply.watcher, answer);
            }
        }
    }
}

impl Drop for Rows<'_> {
    fn drop(&mut self) {
        self.release();
    }
}

impl RowSource {
    /// Returns the name of the source: `processor:loop` or `processor:cell`.
    #[must_use]
    pub fn name(&self) -> String {
        format!("{}:{}", self.member.name, self.owner)
    }

    /// Returns the name of the processor, and the name of its loop or cell.
    #[must_use]
    pub fn place(&self) -> (&str, &str) {
        (&self.member.name, &self.owner)
    }

    /// Returns the descriptions of the values in a row of this source, in the order of the values.
    #[must_use]
    pub fn fields(&self) -> &[RowField] {
        &self.fields
    }

    /// Returns the index in [`fields`](Self::fields) of the value that the column with the index `column` shows; `None`
    /// if this source does not have it.
    #[must_use]
    pub fn field_of(&self, column: usize) -> Option<usize> {
        let mut fields = self.fields.iter();
        fields.position(|field| field.columns.contains(&column))
    }

    /// Returns the number of rows of a loop that were overwritten before they could be read; 0 for a published cell.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.lost_before
            + match &self.supply {
                Supply::Loop(supply) => supply.watcher.lost(),
                Supply::Cell(_) | Supply::Gone { .. } => 0,
            }
    }

    /// Returns the number of values that a published cell had between two values that were read; 0 for a loop. They do
    /// not count as lost, since a cell is only sampled.
    #[must_use]
    pub fn skipped(&self) -> u64 {
        self.skipped_before
            + match &self.supply {
                Supply::Cell(cell) => cell.skipped,
                Supply::Loop(_) | Supply::Gone { .. } => 0,
            }
    }

    /// Returns a phrase for people, such as `100 rows, 2 lost`: `rows` is the number of rows that were kept, and the
    /// source adds the number that were lost or, for a cell, the share that was kept.
    #[must_use]
    pub fn kept(&self, rows: u64) -> String {
        kept(rows, self.lost(), self.skipped())
    }

    /// Returns the seconds between two rows, without overruns; infinite if the source has no rate.
    pub(crate) fn period_s(&self, every: u32) -> f64 {
        let (ticks, seconds) = self.rate;
        f64::from(every) * f64::from(seconds) / f64::from(ticks)
    }
}

impl Supply {
    fn gone(why: String) -> Self {
        let looked = time::Instant::now();
        Self::Gone { looked, why }
    }
}

/// Sorts variables, each with the columns that show it, by their sources, and by their numbers there.
fn by_source<'o>(
    columns: &[&'o CatalogEntry],
) -> Vec<BTreeMap<u32, (&'o CatalogEntry, Vec<usize>)>> {
    // In the order of rows: by the number of the entry.
    let mut chosen = BTreeMap::<_, BTreeMap<u32, (&CatalogEntry, Vec<usize>)>>::new();
    for (column, one) in columns.iter().enumerate() {
        let key = (one.member.number, one.table.offset());
        let of_source = chosen.entry(key).or_default();
        let field = of_source
            .entry(one.entry.number)
            .or_insert((one, Vec::new()));
        field.1.push(column);
    }
    chosen.into_values().collect()
}

/// Returns the number of rows between the tick `before`, or the beginning of a program, and `tick`, if
/// there is one every `every` ticks.
fn missed(before: Option<u64>, tick: u64, every: u64) -> u64 {
    let rows = |ticks: u64| ticks / every.max(1);
    match before {
        Some(before) => rows(tick.saturating_sub(before)).saturating_sub(1),
        None => rows(tick),
    }
}

/// Says how many rows were kept, and how many were lost or skipped.
fn kept(rows: u64, lost: u64, skipped: u64) -> String {
    let lost = match (lost, skipped) {
        (0, 1..) => String::new(),
        (lost, _) => format!(", {lost} lost"),
    };
    let all = rows + skipped;
    match all.checked_div(rows) {
        Some(whole @ 1..) if skipped > 0 => {
            // To the nearest.
            let every = whole + u64::from(2 * (all % rows) >= rows);
            let every = match every {
                1 => "nearly every one".to_owned(),
                every => format!("about one of {every}"),
            };
            format!("kept {rows}, {every}{lost}")
        }
        _ => format!("{rows} rows{lost}"),
    }
}

/// Returns where the values of the entries `wanted`, which are sorted, are in a row of entries, of which
/// `all` has the numbers and the words.
fn words_of(all: &[(u32, usize)], wanted: &[u32]) -> Vec<Range<usize>> {
    let mut at = 0;
    let ranges = all.iter().map(|(number, words)| {
        at += words;
        (number, at - words..at)
    });
    let wanted = ranges.filter(|(number, _)| wanted.binary_search(number).is_ok());
    wanted.map(|(_, range)| range).collect()
}

impl LoopSupply {
    /// Hands over the rows that the loop has written, with times on its own clock.
    fn read(
        &mut self,
        fields: &[RowField],
        mut take: impl FnMut(SourceRow<'_>),
    ) -> Result<(), SupplyError> {
        let mut words = vec![0; self.watcher.words()];
        let mut wanted = Vec::new();
        // More can only come meanwhile.
        for _ in 0..self.watcher.rows() {
            let Some(row) = self.watcher.read(&mut words)? else {
                break;
            };
            wanted.clear();
            let ranges = self
                .wanted
                .iter()
                .filter_map(|range| words.get(range.clone()));
            wanted.extend(ranges.flatten());
            take(SourceRow {
                tick: row.tick,
                released: row.released,
                lost: row.lost,
                fields,
                words: if self.wanted.is_empty() {
                    &words
                } else {
                    &wanted
                },
            });
        }
        Ok(())
    }
}

impl CellSupply {
    /// Hands over the present value, if it is another one than that before.
    fn read(
        &mut self,
        fields: &[RowField],
        now: Instant,
        mut take: impl FnMut(SourceRow<'_>),
    ) -> Result<(), SupplyError> {
        let mut bytes = vec![0; self.cell.bytes()];
        let sequence = match self.cell.read(&mut bytes) {
            Ok(sequence) if Some(sequence) == self.last => return Ok(()),
            Ok(sequence) => sequence,
            Err(CellError::Read(
                PublishedReadError::Unpublished | PublishedReadError::Contended { .. },
            )) => {
                return Ok(());
            }
            Err(error) => return Err(error.into()),
        };
        let before = self.last.replace(sequence);
        // The numbers are not those of a writer that has begun anew, if they are less.
        let missed = before.map_or(0, |before| {
            sequence.saturating_sub(before).saturating_sub(1)
        });
        self.skipped += u64::from(missed);
        let mut words = Vec::new();
        for entry in &self.entries {
            let value = entry.of_cell(&bytes);
            let of_value = value.and_then(|value| entry.kind.words_of(value));
            let of_value = of_value.unwrap_or_default().into_iter();
            words.extend(of_value.take(entry.kind.words()));
        }
        take(SourceRow {
            tick: sequence.into(),
            released: now,
            lost: 0,
            fields,
            words: &words,
        });
        Ok(())
    }
}

/// The error of a source, which names it.
#[derive(Debug, thiserror::Error)]
#[error("{place}: {source}")]
struct SourceError {
    place: String,
    source: AnyError,
}

/// The reason why a source has no rows.
#[derive(Debug, thiserror::Error)]
enum SupplyError {
    #[error("the program does not run")]
    Absent,
    #[error(
        "the program was restarted, and its new version has no `{0}` of the same type at the same place"
    )]
    Changed(String),
    #[error(transparent)]
    View(#[from] ViewError),
    #[error(transparent)]
    Table(#[from] VariableTableError),
    #[error(transparent)]
    Request(#[from] RequestError),
    #[error(transparent)]
    Watch(#[from] WatchError),
    #[error(transparent)]
    Cell(#[from] CellError),
}

impl SupplyError {
    /// Returns the error that it has come from.
    fn inner(self) -> AnyError {
        match self {
            Self::Request(error) => error.into(),
            Self::View(error) => error.into(),
            other => other.into(),
        }
    }

    /// Returns true if what is read belongs to a former incarnation of the program, or to another watcher now.
    const fn is_of_former_incarnation(&self) -> bool {
        matches!(
            self,
            Self::Watch(
                WatchError::Displaced { .. }
                    | WatchError::Table(
                        VariableTableError::Restarted { .. } | VariableTableError::NoTable { .. }
                    )
            ) | Self::Cell(CellError::Table(
                VariableTableError::Restarted { .. } | VariableTableError::NoTable { .. }
            ))
        )
    }

    /// Returns true if the error may end by itself, for instance when the program is started.
    const fn may_end(&self) -> bool {
        !self.stays() && !matches!(self, Self::View(_))
    }

    /// Returns true if the error stays until somebody changes something.
    const fn stays(&self) -> bool {
        matches!(
            self,
            Self::Changed(_)
                | Self::Request(RequestError::NoSlot { .. } | RequestError::Scattered { .. })
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values(fields: &[(ValueKind, &[usize])], words: &[u32]) -> Vec<(Vec<usize>, AnyValue)> {
        let fields: Vec<_> = fields
            .iter()
            .map(|(kind, columns)| RowField {
                name: String::new(),
                kind: *kind,
                columns: columns.to_vec(),
            })
            .collect();
        let row = SourceRow {
            tick: 0,
            released: Instant::from_ns(0),
            lost: 0,
            fields: &fields,
            words,
        };
        let values = row.values();
        values
            .map(|(field, value)| (field.columns.clone(), value))
            .collect()
    }

    #[test]
    fn values_go_to_the_columns_that_show_them() {
        let fields: [(_, &[usize]); 2] = [(ValueKind::U64, &[3]), (ValueKind::Bool, &[0, 2])];
        let (long, flag) = (AnyValue::Uint(0x1_0000_0005), AnyValue::Bool(true));
        let expected = [(vec![3], long), (vec![0, 2], flag)];
        assert_eq!(values(&fields, &[5, 1, 1]), expected);
    }

    #[test]
    fn rows_are_missed_since_the_last_tick_or_the_beginning() {
        assert_eq!([missed(Some(40), 41, 1), missed(Some(40), 50, 1)], [0, 9]);
        assert_eq!([missed(None, 0, 1), missed(None, 230, 1)], [0, 230]);
        assert_eq!([missed(Some(40), 60, 5), missed(None, 60, 5)], [3, 12]);
    }

    #[test]
    fn what_is_sampled_is_not_lost() {
        assert_eq!(kept(716, 0, 2900), "kept 716, about one of 5");
        assert_eq!(kept(716, 3, 1), "kept 716, nearly every one, 3 lost");
        assert_eq!(kept(716, 7, 0), "716 rows, 7 lost");
        assert_eq!(kept(0, 0, 0), "0 rows, 0 lost");
    }

    #[test]
    fn what_lies_between_is_left_out() {
        let all = [(3, 2), (4, 1), (5, 1), (6, 2), (7, 1)];
        assert_eq!(words_of(&all, &[3, 5, 7]), [0..2, 3..4, 6..7]);
    }

    #[test]
    fn a_row_that_is_too_short_has_no_more_values() {
        let fields: [(_, &[usize]); 2] = [(ValueKind::U32, &[0]), (ValueKind::F64, &[1])];
        assert_eq!(values(&fields, &[7, 0]), [(vec![0], AnyValue::Uint(7))]);
    }
}
