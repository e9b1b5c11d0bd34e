//! The layout of tables in shared memory and of requests, in enough detail for other languages.
//!
//! All words are 32 bits, little-endian; offsets are in bytes. A *table* lies in the users' region
//! of its owner's `data` and begins at a cache line. Only the owner writes it, except for the
//! masks.
//!
//! | offset | word | |
//! |---|---|---|
//! | 0 | magic | `CVAR`; 0 while the owner writes the rest of the table |
//! | 4 | version | 1 |
//! | 8 | incarnation | one more whenever a program makes the table anew |
//! | 12 | bytes | size of the whole table |
//! | 16, 20 | rate | a number of ticks, and a number of seconds in which they happen |
//! | 24 | entries | the number of variables and parameters, or of fields of a cell |
//! | 28 | text bytes | size of the texts |
//! | 32 | slots | the greatest number of watchers |
//! | 36 | slot bytes | size of a slot, whole cache lines |
//! | 40 | cell | offset of the described [`Published`](condor_mbox::Published) cell in the users' region |
//! | 44 | cell bytes | size of the cell's value; 0 in the table of a loop |
//! | 64 | entries | 32 bytes each |
//! | | texts | begin after the entries |
//! | | slots | begin with the next cache line after the texts |
//!
//! An *entry* is numbered by its place. Variables come first, then parameters.
//!
//! | offset | word | |
//! |---|---|---|
//! | 0 | text | offset of its text in the texts, a multiple of 4 |
//! | 4 | lengths | bytes of the name, of the unit, of the description, and number of labels: 8 bits each, from the lowest |
//! | 8 | kind | number of the [`ValueKind`](crate::ValueKind); bit 8 is set if it is a parameter |
//! | 12 | position | offset of its value in a row of all variables, or in the value of the cell |
//! | 16 | least | two words: the least value of a parameter |
//! | 24 | greatest | two words: the greatest value of a parameter |
//!
//! Its *text* is its name, unit and description, in UTF-8, one after the other, then the labels of
//! an enum, each after a word with its length. Each of these texts begins at a word.
//!
//! A *slot* belongs to one watcher at a time.
//!
//! | offset | word | |
//! |---|---|---|
//! | 0 | claim | number of the present claim; 0 when the slot is free |
//! | 4 | selection | number of the selection to which the rows belong; 0 while it changes |
//! | 8 | begun | number of rows of the selection that have been begun; wraps |
//! | 12 | complete | number of rows of the selection that are complete; wraps |
//! | 64 | mask | written by the watcher: bit *n* mod 32 of word *n* / 32 selects entry *n*; whole lines |
//! | | rows | begin with the line after the mask |
//!
//! A *row* has the number of the tick and the time of its release in nanoseconds, two words each,
//! lower first, and the words of the selected entries in the order of their numbers. The slot has
//! as many rows as the rest of it has room for, rounded down to a power of two. Row *i* of a
//! selection, counted from 0, is at place *i* modulo that number. The writer stores `begun` before
//! it writes a row and `complete` after. A reader copies a complete row and then reads `begun`
//! again. The copy is valid if `begun` - *i* is at most the number of places, and if `selection` is
//! unchanged.
//!
//! A *request* is eight words in the sender's `data`, sent by [`Exchange`](condor_mbox::Exchange);
//! the response is eight words, too. The first four words of a request are always the operation, the
//! offset of the table in the users' region, its incarnation, and the number of a slot or an entry.
//!
//! | operation | further words | reply after 0 |
//! |---|---|---|
//! | 1 claim | | slot, claim |
//! | 2 select | claim, every how many ticks a row, at least 1 | selection, words of a row's values |
//! | 3 release | claim | |
//! | 4 get | | two words of a parameter |
//! | 5 set | two words expected, two words new | |
//! | 6 initial | | two words of a parameter, with which its program began |
//!
//! | response | further words | meaning |
//! |---|---|---|
//! | 0 | as above | done |
//! | 1 | | busy: ask again |
//! | 2 | | there is no such table |
//! | 3 | incarnation | the table has been made anew |
//! | 4 | operation | there is no such operation |
//! | 5 | slots | all slots are claimed by watchers that are alive |
//! | 6 | | the slot is claimed by another watcher |
//! | 7 | entries | there is no such entry, or the mask selects one that does not exist |
//! | 8 | pieces, most | the selection is in too many pieces |
//! | 9 | | the entry is not a parameter |
//! | 10 | least, greatest | the value is out of bounds |
//! | 11 | present | the parameter does not have the expected value |

use condor_mbox::layout::LINE;

/// The first word of a table in shared memory: "CVAR" in little-endian order.
pub const MAGIC: u32 = u32::from_le_bytes(*b"CVAR");
/// The version of the layout that this module describes.
pub const VERSION: u32 = 1;
/// The greatest length of the name of a variable, parameter or field, in bytes.
pub const NAME_BYTES: usize = 96;
/// The greatest length of a unit, and of a label of an enum, in bytes.
pub const UNIT_BYTES: usize = 32;
/// The greatest length of the description of a variable, parameter or field, in bytes.
pub const ABOUT_BYTES: usize = 128;
/// The greatest number of entries (variables, parameters or fields) of a table, and also of the
/// 32-bit words of their values.
pub const MOST_ENTRIES: u32 = 0xffff;

/// The vector on which a program receives requests about its variables and parameters, unless it
/// chooses another one.
pub const VARS: condor_mbox::Vector = condor_mbox::Vector(42);

/// The words of a request or of a response.
pub(crate) type Block = [u32; 8];

/// Byte offsets in a table.
pub(crate) mod header {
    pub(crate) const MAGIC: u32 = 0;
    pub(crate) const VERSION: u32 = 4;
    pub(crate) const INCARNATION: u32 = 8;
    pub(crate) const BYTES: u32 = 12;
}

pub(crate) const HEADER_WORDS: usize = 12;
pub(crate) const ENTRIES_AT: u32 = 64;
pub(crate) const ENTRY_BYTES: u32 = 32;
/// The bit of an entry's kind that is set if the entry is a parameter.
pub(crate) const IS_PARAM: u32 = 1 << 8;

/// Byte offsets in a slot.
pub(crate) mod slot {
    pub(crate) const CLAIM: u32 = 0;
    pub(crate) const SELECTION: u32 = 4;
    pub(crate) const BEGUN: u32 = 8;
    pub(crate) const COMPLETE: u32 = 12;
    pub(crate) const MASK: u32 = 64;
}

/// The number of words of a row before the values.
pub(crate) const ROW_HEADER: u32 = 4;

pub(crate) mod operation {
    pub(crate) const CLAIM: u32 = 1;
    pub(crate) const SELECT: u32 = 2;
    pub(crate) const RELEASE: u32 = 3;
    pub(crate) const GET: u32 = 4;
    pub(crate) const SET: u32 = 5;
    pub(crate) const INITIAL: u32 = 6;
}

pub(crate) mod response {
    pub(crate) const DONE: u32 = 0;
    pub(crate) const BUSY: u32 = 1;
    pub(crate) const NO_TABLE: u32 = 2;
    pub(crate) const RESTARTED: u32 = 3;
    pub(crate) const NO_OPERATION: u32 = 4;
    pub(crate) const NO_SLOT: u32 = 5;
    pub(crate) const NOT_YOURS: u32 = 6;
    pub(crate) const NO_ENTRY: u32 = 7;
    pub(crate) const SCATTERED: u32 = 8;
    pub(crate) const NO_PARAM: u32 = 9;
    pub(crate) const OUT_OF_BOUNDS: u32 = 10;
    pub(crate) const CONFLICT: u32 = 11;
    pub(crate) const ACCESS: u32 = 12;
}

/// The sizes of the parts of a table, as its header states them; the places of the parts follow from them.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Shape {
    pub(crate) entries: u32,
    pub(crate) text_bytes: u32,
    pub(crate) slots: u32,
    pub(crate) slot_bytes: u32,
}

impl Shape {
    /// Returns the size of the whole table; `None` if no window is that large.
    pub(crate) fn bytes(self) -> Option<u32> {
        let slots = self.slots.checked_mul(self.slot_bytes)?;
        self.texts_end()?.checked_add(slots)
    }

    /// Returns the shape if a table of `bytes` bytes can have it.
    pub(crate) fn checked(self, bytes: u32) -> Option<Self> {
        let is_aligned = self.slot_bytes.is_multiple_of(LINE) && self.text_bytes.is_multiple_of(4);
        let is_possible = self.entries <= MOST_ENTRIES && is_aligned && self.bytes()? <= bytes;
        (is_possible && (self.slots == 0 || self.rows_at() < self.slot_bytes)).then_some(self)
    }

    fn texts_end(self) -> Option<u32> {
        let entries = self.entries.checked_mul(ENTRY_BYTES)?;
        let texts = ENTRIES_AT.checked_add(entries)?;
        let end = texts.checked_add(self.text_bytes)?;
        end.checked_next_multiple_of(LINE)
    }

    // The functions below neither overflow nor leave the table once the shape has been checked.

    pub(crate) const fn texts(self) -> u32 {
        entry_at(self.entries)
    }

    pub(crate) fn slot(self, number: u32) -> u32 {
        let first = self.texts_end().unwrap_or(u32::MAX);
        first.wrapping_add(number.wrapping_mul(self.slot_bytes))
    }

    /// Returns the number of words of a mask.
    pub(crate) const fn mask_words(self) -> u32 {
        self.entries.div_ceil(32)
    }

    /// Returns the offset of the rows in a slot.
    pub(crate) const fn rows_at(self) -> u32 {
        slot::MASK.wrapping_add((4 * self.mask_words()).next_multiple_of(LINE))
    }

    /// Returns the number of rows with `words` words of values for which a slot has room: 0 or a power of two.
    pub(crate) fn rows(self, words: u32) -> u32 {
        let room = self.slot_bytes.saturating_sub(self.rows_at());
        let rows = room / row_bytes(words);
        rows.checked_ilog2().map_or(0, |log| 1 << log)
    }
}

/// Returns the offset of an entry in its table.
pub(crate) const fn entry_at(number: u32) -> u32 {
    ENTRIES_AT.wrapping_add(number.wrapping_mul(ENTRY_BYTES))
}

/// Returns the size in bytes of a row with `words` words of values.
pub(crate) const fn row_bytes(words: u32) -> u32 {
    words.saturating_add(ROW_HEADER).saturating_mul(4)
}
