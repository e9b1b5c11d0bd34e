//! [`Catalog`]: what a loop shows and lets set, and how it is written into a table.

use core::fmt;

use condor_mbox::layout::LINE;
use condor_mbox::{AccessError, LoadOrder, MemoryWindow, Region, StoreOrder};

use crate::layout::{
    ABOUT_BYTES, IS_PARAM, MAGIC, MOST_ENTRIES, NAME_BYTES, Shape, UNIT_BYTES, VERSION, entry,
    entry_at, header, row_bytes,
};
use crate::param::Tune;
use crate::sync::{Ordering, fence};
use crate::var::{Description, Watch};

/// The variables and parameters of a loop, in the order in which they are numbered.
#[derive(Clone, Copy)]
pub struct Catalog<'e> {
    watched: &'e [&'e dyn Watch],
    params: &'e [&'e dyn Tune],
}

/// Why the variables of a loop cannot be shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CatalogError {
    /// A text that is too long.
    #[error("{what} of entry {entry} has {len} bytes; {most} is the most")]
    TooLong {
        /// The number of the variable or parameter.
        entry: u32,
        /// Which of its texts.
        what: &'static str,
        /// How many bytes, or labels.
        len: usize,
        /// The most that are allowed.
        most: usize,
    },
    /// The descriptions of a [`Watch`] do not fit its words.
    #[error("block {block} has {words} words, but its variables do not")]
    Block {
        /// The number of the block.
        block: usize,
        /// How many words it has.
        words: usize,
    },
    /// A parameter whose initial value is not within its bounds.
    #[error("the initial value of parameter {parameter} is out of bounds")]
    Initial {
        /// The number of the parameter among all parameters.
        parameter: usize,
    },
    /// More than the layout or the object can hold.
    #[error("{count} {what}; {most} is the most")]
    TooMany {
        /// Of what there are too many.
        what: &'static str,
        /// How many there are.
        count: usize,
        /// The most that are allowed.
        most: usize,
    },
    /// There is no room in the region, or it cannot be reached.
    #[error(transparent)]
    Access(#[from] AccessError),
}

/// What the head of a table says beside its shape.
pub(crate) struct Head {
    pub(crate) rate: (u32, u32),
    pub(crate) cell: (u32, u32),
}

/// Something with a description and a name, as it is given to whoever goes through a catalog.
pub(crate) struct Item<'i> {
    pub(crate) description: Description<'i>,
    pub(crate) name: &'i dyn fmt::Display,
    pub(crate) is_param: bool,
    pub(crate) position: u32,
}

/// A name that its block writes.
struct Name<'n>(&'n dyn Watch, usize);

impl fmt::Display for Name<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.name(self.1, f)
    }
}

impl<'e> Catalog<'e> {
    /// The number of an entry counts these variables first, then the parameters.
    #[must_use]
    pub const fn new(watched: &'e [&'e dyn Watch], params: &'e [&'e dyn Tune]) -> Self {
        Self { watched, params }
    }

    pub(crate) const fn params(&self) -> &'e [&'e dyn Tune] {
        self.params
    }

    /// Returns the number of the first parameter among `entries`.
    pub(crate) fn first_param(&self, entries: u32) -> u32 {
        entries.saturating_sub(self.params.len() as u32)
    }

    /// Iterates over the blocks; a parameter is a block of one variable.
    pub(crate) fn blocks(&self) -> impl Iterator<Item = &'e dyn Watch> + use<'e> {
        let params = self.params.iter().map(|param| *param as &'e dyn Watch);
        self.watched.iter().copied().chain(params)
    }

    /// Goes through all entries in order.
    pub(crate) fn each(
        &self,
        mut body: impl FnMut(&Item<'_>) -> Result<(), CatalogError>,
    ) -> Result<(), CatalogError> {
        let mut position = 0;
        for (block, watch) in self.blocks().enumerate() {
            let words = watch.words().len();
            let mut left = words;
            let mut index = 0;
            while left > 0 {
                let wrong = CatalogError::Block { block, words };
                let description = watch.describe(index).ok_or(wrong)?;
                let size = description.kind.words();
                left = left.checked_sub(size).ok_or(wrong)?;
                body(&Item {
                    description,
                    name: &Name(watch, index),
                    is_param: block >= self.watched.len(),
                    position,
                })?;
                position += 4 * size as u32;
                index += 1;
            }
            if watch.describe(index).is_some() {
                return Err(CatalogError::Block { block, words });
            }
        }
        Ok(())
    }

    /// Returns the shape of a table with so many slots, each for at least so many rows of everything.
    pub(crate) fn shape(&self, slots: u32, rows: u32) -> Result<Shape, CatalogError> {
        let (mut entries, mut text_bytes, mut words) = (0_u32, 0_u32, 0_u32);
        self.each(|item| {
            let bytes = check_texts(entries, item)?.next_multiple_of(4);
            text_bytes = text_bytes.saturating_add(bytes as u32);
            words = words.saturating_add(item.description.kind.words() as u32);
            entries += 1;
            if entries > MOST_ENTRIES || words > MOST_ENTRIES {
                return Err(CatalogError::TooMany {
                    what: "words of variables",
                    count: words as usize,
                    most: MOST_ENTRIES as usize,
                });
            }
            Ok(())
        })?;
        let unsound = self.params.iter().position(|param| !param.is_sound());
        if let Some(parameter) = unsound {
            return Err(CatalogError::Initial { parameter });
        }
        let empty = Shape {
            entries,
            text_bytes,
            slots,
            slot_bytes: 0,
        };
        // A power of two, of two at least: a reader copies one while the other is written.
        let rows = rows.clamp(2, 1 << 31).next_power_of_two();
        let rows = rows.saturating_mul(row_bytes(words));
        let bytes = empty.rows_at().saturating_add(rows).div_ceil(LINE);
        // One that is too large for every window is refused where it is placed.
        Ok(Shape {
            slot_bytes: bytes.saturating_mul(LINE).min(u32::MAX - LINE + 1),
            ..empty
        })
    }

    /// Returns how many bytes of shared memory a table takes, with so many slots for watchers, each for
    /// at least `rows` rows of all variables.
    ///
    /// # Errors
    /// Those of [`Desk::open`](crate::Desk::open).
    pub fn bytes(&self, slots: u32, rows: u32) -> Result<u32, CatalogError> {
        Ok(self.shape(slots, rows)?.bytes().unwrap_or(u32::MAX))
    }
}

impl fmt::Debug for Catalog<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Catalog")
            .field("blocks", &self.watched.len())
            .field("params", &self.params.len())
            .finish()
    }
}

/// Returns how many bytes the texts of an item have.
pub(crate) fn check_texts(entry: u32, item: &Item<'_>) -> Result<usize, CatalogError> {
    let mut counter = Counter(0);
    // A name that cannot be written is found by its length: it is not there when the entry is written.
    let _ = fmt::write(&mut counter, format_args!("{}", item.name));
    let Description {
        unit,
        about,
        labels,
        ..
    } = item.description;
    let mut bytes = 0;
    let mut check = |what, len, most| {
        bytes += len;
        if len <= most {
            return Ok(());
        }
        Err(CatalogError::TooLong {
            entry,
            what,
            len,
            most,
        })
    };
    check("the name", counter.0, NAME_BYTES)?;
    check("the unit", unit.len(), UNIT_BYTES)?;
    check("the description", about.len(), ABOUT_BYTES)?;
    for label in labels {
        check("a label", label.len(), UNIT_BYTES)?;
    }
    check("the list of labels", labels.len(), 255)?;
    Ok(bytes)
}

struct Counter(usize);

impl fmt::Write for Counter {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0 += text.len();
        Ok(())
    }
}

/// Writes a table but for its slots; returns its life.
///
/// `items` calls its argument with every item, in order.
pub(crate) fn write<W: MemoryWindow>(
    table: &Region<W>,
    shape: Shape,
    head: &Head,
    items: impl FnOnce(
        &mut dyn FnMut(&Item<'_>) -> Result<(), CatalogError>,
    ) -> Result<(), CatalogError>,
) -> Result<u32, CatalogError> {
    let set = |at, word| table.store(at, word, StoreOrder::Relaxed);
    let life = table
        .load(header::LIFE, LoadOrder::Relaxed)?
        .wrapping_add(1);
    set(header::MAGIC, 0)?;
    // Pairs with the first look of a reader: who sees the new life sees no magic of the former one.
    table.store(header::LIFE, life, StoreOrder::Release)?;
    // A reader of the former life that sees anything of what follows sees the new life afterwards.
    fence(Ordering::Release);
    for (at, word) in [
        (header::VERSION, VERSION),
        (header::BYTES, table.size()),
        (header::RATE, head.rate.0),
        (header::RATE + 4, head.rate.1),
        (header::ENTRIES, shape.entries),
        (header::TEXT_BYTES, shape.text_bytes),
        (header::SLOTS, shape.slots),
        (header::SLOT_BYTES, shape.slot_bytes),
        (header::CELL, head.cell.0),
        (header::CELL_BYTES, head.cell.1),
    ] {
        set(at, word)?;
    }
    let mut number = 0;
    let mut texts = Packer {
        table,
        at: shape.texts(),
        end: shape.texts().saturating_add(shape.text_bytes),
        word: [0; 4],
        filled: 0,
        result: Ok(()),
    };
    items(&mut |item| {
        let at = entry_at(number);
        let Description {
            kind,
            unit,
            about,
            labels,
            bounds: [least, greatest],
        } = item.description;
        set(at + entry::TEXT, texts.at.wrapping_sub(shape.texts()))?;
        let before = texts.written();
        let _ = fmt::write(&mut texts, format_args!("{}", item.name));
        let name_len = texts.written().wrapping_sub(before);
        texts.put(unit.as_bytes());
        texts.put(about.as_bytes());
        for label in labels {
            texts.put(&[label.len() as u8]);
            texts.put(label.as_bytes());
        }
        texts.finish()?;
        let lengths = [
            name_len as u8,
            unit.len() as u8,
            about.len() as u8,
            labels.len() as u8,
        ];
        set(at + entry::LENGTHS, u32::from_le_bytes(lengths))?;
        let flags = if item.is_param { IS_PARAM } else { 0 };
        set(at + entry::KIND, kind as u32 | flags)?;
        set(at + entry::POSITION, item.position)?;
        for (word, value) in (0..).zip([least, greatest].as_flattened()) {
            set(at + entry::BOUNDS + 4 * word, *value)?;
        }
        number += 1;
        Ok(())
    })?;
    Ok(life)
}

/// Lets readers in: all has been written.
pub(crate) fn finish<W: MemoryWindow>(table: &Region<W>) -> Result<(), AccessError> {
    // Pairs with the reader's first look at the table.
    table.store(header::MAGIC, MAGIC, StoreOrder::Release)
}

/// Packs texts into words.
struct Packer<'t, W> {
    table: &'t Region<W>,
    at: u32,
    /// What follows belongs to somebody else, whatever a name has become since it was counted.
    end: u32,
    word: [u8; 4],
    filled: u32,
    result: Result<(), AccessError>,
}

impl<W: MemoryWindow> Packer<'_, W> {
    fn written(&self) -> u32 {
        self.at.wrapping_add(self.filled)
    }

    fn put(&mut self, bytes: &[u8]) {
        for byte in bytes {
            if let Some(place) = self.word.get_mut(self.filled as usize) {
                *place = *byte;
            }
            self.filled += 1;
            if self.filled == 4 {
                self.flush();
            }
        }
    }

    fn flush(&mut self) {
        if self.at < self.end && self.result.is_ok() {
            let word = u32::from_le_bytes(self.word);
            self.result = self.table.store(self.at, word, StoreOrder::Relaxed);
            self.at += 4;
        }
        self.word = [0; 4];
        self.filled = 0;
    }

    /// Fills the last word; the next text begins with a word.
    fn finish(&mut self) -> Result<(), AccessError> {
        if self.filled > 0 {
            self.flush();
        }
        self.result
    }
}

impl<W: MemoryWindow> fmt::Write for Packer<'_, W> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.put(text.as_bytes());
        Ok(())
    }
}
