//! [`VariableTable`]: reads the description of another program's variables from its window.

use condor_mbox::{AccessError, LoadOrder, MemoryWindow, Offset, Region};

use crate::kind::{AnyValue, ValueKind};
use crate::layout::{
    ABOUT_BYTES, ENTRIES_AT, HEADER_WORDS, IS_PARAM, MAGIC, NAME_BYTES, Shape, UNIT_BYTES, VERSION,
    entry_at, header,
};
use crate::sync::{Ordering, fence};

/// A reader of the table that describes the variables and parameters of a loop, or the fields of a
/// published cell.
///
/// Opening and reading a table writes nothing, so the window can be mapped read-only.
///
/// ```
/// use condor_mbox::{MemoryWindow, Region};
/// use condor_vars::{VariableTable, VariableTableError};
///
/// /// Prints the variables and parameters of a table of the processor whose data this is.
/// fn list(data: &Region<impl MemoryWindow + Clone>, offset: u32) -> Result<(), VariableTableError> {
///     for entry in VariableTable::open(data, offset)?.entries() {
///         let entry = entry?;
///         println!("{} in {}: {}", entry.name, entry.unit, entry.about);
///     }
///     Ok(())
/// }
/// ```
#[derive(Clone, Copy, Debug)]
pub struct VariableTable<W> {
    region: Region<W>,
    offset: u32,
    incarnation: u32,
    rate: (u32, u32),
    cell: (u32, u32),
    pub(crate) shape: Shape,
}

/// An entry of a table: the description of a variable, a parameter or a field.
#[derive(Clone, Debug, PartialEq)]
pub struct TableEntry {
    /// The number of the entry in its table, from 0.
    pub number: u32,
    /// The name, by which [`VariableTable::find`] finds the entry.
    pub name: heapless::String<NAME_BYTES>,
    /// The unit; may be empty.
    pub unit: heapless::String<UNIT_BYTES>,
    /// The description; may be empty.
    pub about: heapless::String<ABOUT_BYTES>,
    /// The type of the value.
    pub kind: ValueKind,
    /// The offset of the value in bytes, from the beginning of the values in a row of all
    /// variables, or of the value of a cell.
    pub position: u32,
    /// The least and the greatest value of a parameter; `None` for a variable, which cannot be set.
    pub bounds: Option<[AnyValue; 2]>,
    /// The number of labels of an enum; [`VariableTable::label`] reads them.
    pub labels: u8,
    /// The offset of the labels in the texts, in bytes.
    labels_at: u32,
}

/// The reason why a [`VariableTable`] cannot be opened or read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum VariableTableError {
    /// There is no table of this layout version at the offset, or not yet.
    #[error(
        "there is no table of variables of version {VERSION} and magic {MAGIC:#x}: found version {version} and magic \
         {magic:#x}"
    )]
    NoTable {
        /// The first word found there.
        magic: u32,
        /// The version found there.
        version: u32,
    },
    /// The numbers in the header contradict each other.
    #[error(
        "the header of the table of variables is invalid: its numbers do not fit a table of {bytes} bytes"
    )]
    Header {
        /// The size of the table in bytes, as the header states it.
        bytes: u32,
    },
    /// An entry of the table is invalid.
    #[error(
        "entry {number} of the table of variables, counted from 0, is damaged: a text or the type in it is invalid"
    )]
    Entry {
        /// The number of the entry.
        number: u32,
    },
    /// There is no entry of this number.
    #[error("there is no entry {number}: the table of variables has {entries}, numbered from 0")]
    NoEntry {
        /// The number that was requested.
        number: u32,
        /// The number of entries.
        entries: u32,
    },
    /// The owner has made the table anew: open it again.
    #[error(
        "the program made the table of variables again: its incarnation is {found}, not {expected}; open it again"
    )]
    Restarted {
        /// The number of the table's present [incarnation](VariableTable::incarnation).
        found: u32,
        /// The number of its incarnation when it was opened.
        expected: u32,
    },
    /// The region refused an access.
    #[error(transparent)]
    Access(#[from] AccessError),
}

impl<W: MemoryWindow + Clone> VariableTable<W> {
    /// Opens the table at `offset` bytes in `users`, the users' region of the `data` of the
    /// processor that has the table.
    ///
    /// # Errors
    /// Returns [`VariableTableError::NoTable`] if there is no table, [`VariableTableError::Header`] if the header of
    /// the table is invalid, [`VariableTableError::Restarted`] if the table was made anew meanwhile,
    /// [`VariableTableError::Access`] if the memory cannot be accessed.
    pub fn open(users: &Region<W>, offset: u32) -> Result<Self, VariableTableError> {
        let head = users.part(offset, ENTRIES_AT)?;
        // Pairs with the owner's store before it writes the rest: the magic is not that of an earlier incarnation.
        let incarnation = head.word(header::INCARNATION)?;
        // Pairs with the owner's last store.
        let magic = head.word(header::MAGIC)?;
        let words = head.get(Offset::<[u32; HEADER_WORDS]>::at(0))?;
        let [_, version, _, bytes, rate @ .., _, _, _, _, _, _] = words;
        let [.., entries, text_bytes, slots, slot_bytes, cell, cell_bytes] = words;
        if magic != MAGIC || version != VERSION {
            return Err(VariableTableError::NoTable { magic, version });
        }
        let shape = Shape {
            entries,
            text_bytes,
            slots,
            slot_bytes,
        };
        let shape = shape
            .checked(bytes)
            .ok_or(VariableTableError::Header { bytes })?;
        let region = users.part(offset, bytes)?;
        let table = Self {
            region,
            offset,
            incarnation,
            rate: rate.into(),
            cell: (cell, cell_bytes),
            shape,
        };
        table.check_incarnation()?;
        Ok(table)
    }
}

impl<W: MemoryWindow> VariableTable<W> {
    /// Returns the offset of the table in bytes, from the beginning of the users' region of its
    /// owner's `data`.
    #[must_use]
    pub const fn offset(&self) -> u32 {
        self.offset
    }

    /// Returns the number of the table's incarnation when it was opened. Whenever the owner's program makes the table
    /// anew, the number grows by one; from then on reading this `VariableTable` fails with
    /// [`Restarted`](VariableTableError::Restarted).
    #[must_use]
    pub const fn incarnation(&self) -> u32 {
        self.incarnation
    }

    /// Returns the rate of the loop that the table describes: a number of ticks, and the number of
    /// seconds in which they happen. `(400, 1)` is 400 Hz. Returns `(0, 0)` if the table describes
    /// a cell.
    #[must_use]
    pub const fn rate(&self) -> (u32, u32) {
        self.rate
    }

    /// Returns two numbers of bytes about the published cell that the table describes: the offset
    /// of the cell in the users' region, and the size of its value. Returns `None` if the table
    /// describes a loop.
    #[must_use]
    pub const fn cell(&self) -> Option<(u32, u32)> {
        match self.cell {
            (_, 0) => None,
            cell => Some(cell),
        }
    }

    /// Returns the number of entries: the variables and parameters of a loop, or the fields of a
    /// cell.
    #[must_use]
    pub const fn len(&self) -> u32 {
        self.shape.entries
    }

    /// Returns true if the table has no entries.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the greatest number of watchers that the loop can have at a time.
    #[must_use]
    pub const fn slots(&self) -> u32 {
        self.shape.slots
    }

    /// Reads the entry with the number `number`, counted from 0.
    ///
    /// # Errors
    /// Returns [`VariableTableError::NoEntry`] if there is no entry with this number, [`VariableTableError::Entry`] if
    /// the entry is invalid, [`VariableTableError::Restarted`] if the table was made anew,
    /// [`VariableTableError::Access`] if the memory cannot be accessed.
    pub fn entry(&self, number: u32) -> Result<TableEntry, VariableTableError> {
        let entries = self.shape.entries;
        if number >= entries {
            return Err(VariableTableError::NoEntry { number, entries });
        }
        let entry = self.read_entry(number)?;
        // An entry that was read of another incarnation is not an error of this one.
        self.check_incarnation()?;
        entry.ok_or(VariableTableError::Entry { number })
    }

    /// Finds the entry called `name`; returns `None` if the table has no such entry.
    ///
    /// # Errors
    /// Returns [`VariableTableError::Entry`] if an entry is invalid, [`VariableTableError::Restarted`] if the
    /// table was made anew, [`VariableTableError::Access`] if the memory cannot be accessed.
    pub fn find(&self, name: &str) -> Result<Option<TableEntry>, VariableTableError> {
        for entry in self.entries() {
            let entry = entry?;
            if entry.name == name {
                return Ok(Some(entry));
            }
        }
        Ok(None)
    }

    /// Iterates over all entries in the order of their numbers. If an entry cannot be read, the
    /// item is the error of [`entry`](Self::entry).
    pub fn entries(&self) -> impl Iterator<Item = Result<TableEntry, VariableTableError>> + '_ {
        (0..self.len()).map(|number| self.entry(number))
    }

    /// Reads the label, the name for people, of the value `value` of the enum that `entry`
    /// describes. Returns `None` if `entry` has no such label.
    ///
    /// # Errors
    /// Returns [`VariableTableError::Entry`] if the label is invalid, [`VariableTableError::Restarted`] if the
    /// table was made anew, [`VariableTableError::Access`] if the memory cannot be accessed.
    pub fn label(
        &self,
        entry: &TableEntry,
        value: u32,
    ) -> Result<Option<heapless::String<UNIT_BYTES>>, VariableTableError> {
        if value >= entry.labels.into() {
            return Ok(None);
        }
        let (mut at, mut label) = (entry.labels_at, None);
        for _ in 0..=value {
            let len: Option<heapless::Vec<u8, 4>> = self.bytes(&mut at, 4)?;
            let len = len.and_then(|len| Some(u32::from_le_bytes(len.into_array().ok()?)));
            label = match len {
                Some(len) => self.text(&mut at, len)?,
                None => None,
            };
        }
        self.check_incarnation()?;
        let number = entry.number;
        label.ok_or(VariableTableError::Entry { number }).map(Some)
    }

    /// Reads an entry; `None` if it is impossible.
    fn read_entry(&self, number: u32) -> Result<Option<TableEntry>, AccessError> {
        let words = self.region.get(Offset::<[u32; 8]>::at(entry_at(number)))?;
        let [mut text, lengths, code, position, a, b, c, d] = words;
        let [name, unit, about, labels] = lengths.to_le_bytes();
        let name = self.text(&mut text, name.into())?;
        let unit = self.text(&mut text, unit.into())?;
        let about = self.text(&mut text, about.into())?;
        let kind = ValueKind::from_code(code & !IS_PARAM);
        let (Some(kind), Some(name), Some(unit), Some(about)) = (kind, name, unit, about) else {
            return Ok(None);
        };
        Ok(Some(TableEntry {
            number,
            name,
            unit,
            about,
            kind,
            position,
            bounds: (code & IS_PARAM != 0).then(|| [kind.value([a, b]), kind.value([c, d])]),
            labels,
            labels_at: text,
        }))
    }

    /// Reads a text, and moves `at` past it; `None` if it is too long, not inside of the texts, or not UTF-8.
    fn text<const N: usize>(
        &self,
        at: &mut u32,
        len: u32,
    ) -> Result<Option<heapless::String<N>>, AccessError> {
        let bytes = self.bytes(at, len)?;
        Ok(bytes.and_then(|bytes| heapless::String::from_utf8(bytes).ok()))
    }

    fn bytes<const N: usize>(
        &self,
        at: &mut u32,
        len: u32,
    ) -> Result<Option<heapless::Vec<u8, N>>, AccessError> {
        let mut bytes = heapless::Vec::new();
        let begin = *at;
        *at = begin.saturating_add(len.checked_next_multiple_of(4).unwrap_or(u32::MAX));
        let is_inside = begin.is_multiple_of(4) && *at <= self.shape.text_bytes;
        if !is_inside || bytes.resize_default(len as usize).is_err() {
            return Ok(None);
        }
        self.region.read(self.shape.texts() + begin, &mut bytes)?;
        Ok(Some(bytes))
    }

    pub(crate) const fn region(&self) -> &Region<W> {
        &self.region
    }

    /// Checks that all words read before are of the incarnation in which the table was opened.
    pub(crate) fn check_incarnation(&self) -> Result<(), VariableTableError> {
        // Pairs with the owner's fence after it has begun another incarnation.
        fence(Ordering::Acquire);
        let found = self.region.load(header::INCARNATION, LoadOrder::Relaxed)?;
        let expected = self.incarnation;
        if found == expected {
            return Ok(());
        }
        Err(VariableTableError::Restarted { found, expected })
    }
}
