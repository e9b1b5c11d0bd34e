//! [`Watcher`]: a claimed slot, and the reading of its rows.

use condor_mbox::{AccessError, Instant, LoadOrder, MemoryWindow, StoreOrder};

use crate::layout::{ROW_HEADER, row_bytes, slot};
use crate::sync::{Ordering, fence};
use crate::table::{VariableTable, VariableTableError};

/// A slot of a loop, claimed by [`VariableClient::claim`](crate::VariableClient::claim), through which a program
/// watches variables. Select variables, then read rows.
///
/// Dropping a watcher keeps the slot claimed: release it with
/// [`VariableClient::release`](crate::VariableClient::release). If a program ends without doing so, its slot
/// goes to the next program that claims one.
///
/// ```
/// use condor_mbox::MemoryWindow;
/// use condor_vars::{ValueKind, WatchError, Watcher};
///
/// /// Prints the rows that have come, of a selection of one variable of 64 bits.
/// fn show(watcher: &mut Watcher<impl MemoryWindow>) -> Result<(), WatchError> {
///     let mut words = [0; 2];
///     while let Some(row) = watcher.read(&mut words)? {
///         println!("tick {}: {:?}, {} rows lost", row.tick, ValueKind::F64.value(words), row.lost);
///     }
///     Ok(())
/// }
/// ```
#[derive(Debug)]
pub struct Watcher<W> {
    table: VariableTable<W>,
    number: u32,
    claim: u32,
    /// `None` before the first selection, and if it is not known whether the last was accepted.
    selection: Option<Selection>,
    lost: u64,
}

/// A selection of which the owner has accepted the mask.
#[derive(Clone, Copy, Debug)]
struct Selection {
    number: u32,
    /// The number of words of values in a row.
    words: u32,
    /// The number of rows for which the ring has room, a power of two.
    rows: u32,
    /// The next row to read.
    next: u32,
    /// The number of lost rows that no returned row has reported yet.
    untold: u32,
}

/// All that a row has besides the values: the number and time of its tick, and the number of rows
/// lost before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RowHead {
    /// The number of the tick.
    pub tick: u64,
    /// The instant at which the tick was released, on the clock of its processor.
    pub released: Instant,
    /// The number of rows of the selection that were lost between the row read before and this one.
    pub lost: u32,
    /// The number of words of values that were copied.
    pub words: usize,
}

/// The reason why a [`Watcher`] cannot read a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum WatchError {
    /// The owner has restarted, or its memory cannot be reached.
    #[error(transparent)]
    Table(#[from] VariableTableError),
    /// The owner considered this watcher dead, and another watcher has claimed its slot.
    #[error("slot {slot} of this watcher was given to another watcher; claim a slot again")]
    Displaced {
        /// The number of the slot.
        slot: u32,
    },
    /// Nothing is selected, or the last selection was not acknowledged.
    #[error("no variable is selected")]
    Unselected,
    /// The buffer is too short for the values.
    #[error("a row has {words} words, but the buffer has {room}; pass a longer one")]
    Room {
        /// The number of words of a row's values.
        words: usize,
        /// The length of the buffer, in words.
        room: usize,
    },
}

impl From<AccessError> for WatchError {
    fn from(error: AccessError) -> Self {
        Self::Table(error.into())
    }
}

/// The number of times that one call tries to copy a row. A row that is overwritten meanwhile is given up for a
/// later one.
const ATTEMPTS: u32 = 4;

impl<W: MemoryWindow> Watcher<W> {
    /// Makes a watcher of the slot `number` of `table`, which was claimed with the claim number
    /// `claim`. Returns `None` if the table has no such slot.
    ///
    /// [`VariableClient`](crate::VariableClient) does this for most programs. This function,
    /// [`choose`](Self::choose) and [`follow`](Self::follow) are for programs that bring requests
    /// to the owner in another way.
    #[must_use]
    pub fn new(table: VariableTable<W>, number: u32, claim: u32) -> Option<Self> {
        (number < table.slots()).then_some(Self {
            table,
            number,
            claim,
            selection: None,
            lost: 0,
        })
    }

    /// Returns the table of the loop to which the slot belongs.
    #[must_use]
    pub const fn table(&self) -> &VariableTable<W> {
        &self.table
    }

    /// Returns the number of the claimed slot in its table, counted from 0.
    #[must_use]
    pub const fn slot(&self) -> u32 {
        self.number
    }

    /// Returns the number of the claim, which differs each time that the slot is claimed.
    #[must_use]
    pub const fn claim(&self) -> u32 {
        self.claim
    }

    /// Returns the number of rows that were overwritten before this watcher could read them, summed
    /// over all selections.
    #[must_use]
    pub const fn lost(&self) -> u64 {
        self.lost
    }

    /// Returns the number of 32-bit words that the values of a row take: the least length of a
    /// buffer for [`read`](Self::read). Returns 0 if nothing is selected.
    #[must_use]
    pub fn words(&self) -> usize {
        self.selection.map_or(0, |it| it.words as usize)
    }

    /// Returns the number of unread rows of the present selection that the slot can keep before rows are lost; 0 if
    /// nothing is selected.
    #[must_use]
    pub fn rows(&self) -> u32 {
        self.selection.map_or(0, |it| it.rows)
    }

    /// Writes the mask that selects the entries with the numbers `entries`, and stops reading rows
    /// of the present selection. Call it before you send the request for the selection. Returns the
    /// number of 32-bit words that the values of a row will take.
    ///
    /// # Errors
    /// Returns [`VariableTableError::NoEntry`] if an entry does not exist, [`VariableTableError::Restarted`] if
    /// the table was made anew, [`VariableTableError::Access`] if the memory cannot be accessed.
    pub fn choose(&mut self, entries: &[u32]) -> Result<u32, VariableTableError> {
        self.end();
        if let Some(last) = entries.iter().max() {
            self.table.entry(*last)?;
        }
        let shape = self.table.shape;
        let mask = shape.slot(self.number) + slot::MASK;
        let mut words = 0;
        for index in 0..shape.mask_words() {
            let mut bits = 0;
            for number in entries.iter().filter(|number| **number / 32 == index) {
                let bit = 1 << (number % 32);
                if bits & bit == 0 {
                    words += self.table.entry(*number)?.kind.words() as u32;
                }
                bits |= bit;
            }
            let region = self.table.region();
            region.store(mask + 4 * index, bits, StoreOrder::Relaxed)?;
        }
        self.table.check_incarnation()?;
        Ok(words)
    }

    /// Reads no more rows of the present selection.
    pub(crate) const fn end(&mut self) {
        self.selection = None;
    }

    /// Begins to read rows of the selection `number`, whose rows have `words` 32-bit words of
    /// values. Both numbers are in the owner's response to the request.
    pub fn follow(&mut self, number: u32, words: u32) {
        self.selection = Some(Selection {
            number,
            words,
            rows: self.table.shape.rows(words),
            next: 0,
            untold: 0,
        });
    }

    /// Copies the values of the next unread row into the beginning of `values`, and returns the
    /// rest of the row; returns `None` if the loop has written no further row.
    ///
    /// The values are in the order of the numbers of the selected entries;
    /// [`ValueKind::split`](crate::ValueKind::split) takes them apart. If a reader misses 2³² rows or more,
    /// the count of lost rows is wrong.
    ///
    /// # Errors
    /// Returns [`WatchError::Unselected`] if nothing is selected, [`WatchError::Room`] if `values` is too
    /// short, [`WatchError::Displaced`] if the slot has gone to another watcher, [`WatchError::Table`] if the
    /// owner has made the table anew or its memory cannot be accessed.
    pub fn read(&mut self, values: &mut [u32]) -> Result<Option<RowHead>, WatchError> {
        let Some(mut selection) = self.selection else {
            return Err(WatchError::Unselected);
        };
        let (words, room) = (selection.words as usize, values.len());
        let values = values
            .get_mut(..words)
            .ok_or(WatchError::Room { words, room })?;
        let at = self.table.shape.slot(self.number);
        // Pairs with the writer's store when it takes a selection over.
        if self.table.region().word(at + slot::SELECTION)? != selection.number {
            // The loop has not taken the selection over yet, unless the slot has gone to another watcher.
            self.check_claim()?;
            return Ok(None);
        }
        let before = selection;
        let row = selection.read(&self.table, at, values)?;
        // The fence in `check_claim` pairs with that of the writer when it leaves a selection: if any word
        // above is of another selection, the load below shows it.
        self.check_claim()?;
        let region = self.table.region();
        let present = region.load(at + slot::SELECTION, LoadOrder::Relaxed)?;
        if present != selection.number {
            return Ok(None);
        }
        let lost = selection.next.wrapping_sub(before.next);
        self.lost += u64::from(lost.wrapping_sub(row.is_some().into()));
        self.selection = Some(selection);
        Ok(row)
    }

    fn check_claim(&self) -> Result<(), WatchError> {
        self.table.check_incarnation()?;
        let slot = self.number;
        let at = self.table.shape.slot(slot) + slot::CLAIM;
        if self.table.region().word(at)? == self.claim {
            return Ok(());
        }
        Err(WatchError::Displaced { slot })
    }
}

impl Selection {
    fn read<W: MemoryWindow>(
        &mut self,
        table: &VariableTable<W>,
        at: u32,
        values: &mut [u32],
    ) -> Result<Option<RowHead>, AccessError> {
        let region = table.region();
        for _ in 0..ATTEMPTS {
            // Pairs with the writer's store after a complete row.
            let complete = region.word(at + slot::COMPLETE)?;
            self.skip_to(complete);
            if complete == self.next {
                return Ok(None);
            }
            let place = self.next & self.rows.wrapping_sub(1);
            let row = at + table.shape.rows_at() + place * row_bytes(self.words);
            let mut header = [0; ROW_HEADER as usize];
            let words = header.iter_mut().chain(values.iter_mut());
            for (to, at) in words.zip((row..).step_by(4)) {
                *to = region.load(at, LoadOrder::Relaxed)?;
            }
            // Pairs with the writer's fence: if any word was of a later row, `begun` counts that row.
            fence(Ordering::Acquire);
            let begun = region.load(at + slot::BEGUN, LoadOrder::Relaxed)?;
            if begun.wrapping_sub(self.next) <= self.rows {
                self.next = self.next.wrapping_add(1);
                let [tick, tick_high, ns, ns_high] = header.map(u64::from);
                return Ok(Some(RowHead {
                    tick: tick_high << 32 | tick,
                    released: Instant::from_ns(ns_high << 32 | ns),
                    lost: core::mem::take(&mut self.untold),
                    words: values.len(),
                }));
            }
            self.skip_to(begun);
        }
        Ok(None)
    }

    /// Skips the rows that are overwritten once `begun` rows have been begun, and counts them as lost.
    fn skip_to(&mut self, begun: u32) {
        let ahead = begun.wrapping_sub(self.next);
        if let Some(lost) = ahead.checked_sub(self.rows) {
            self.next = self.next.wrapping_add(lost);
            self.untold = self.untold.wrapping_add(lost);
        }
    }
}
