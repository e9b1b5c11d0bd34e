//! [`Catalog`]: the variables and parameters of a loop; and the writing of their table.

use core::fmt;

use condor_mbox::layout::LINE;
use condor_mbox::{AccessError, Allocator, LoadOrder, MemoryWindow, Offset, Region, StoreOrder};

use crate::layout::{
    ABOUT_BYTES, IS_PARAM, MAGIC, MOST_ENTRIES, NAME_BYTES, Shape, UNIT_BYTES, VERSION, entry_at,
    header, row_bytes, slot,
};
use crate::param::Tune;
use crate::sync::{Ordering, fence};
use crate::var::{VarDescription, Watch};

/// The list of the variables and parameters that a loop shows, from which
/// [`Selections::open`](crate::Selections::open) makes the loop's table. They are numbered in the
/// order of the list.
#[derive(Clone, Copy)]
pub struct Catalog<'e> {
    watched: &'e [&'e dyn Watch],
    params: &'e [&'e dyn Tune],
}

/// The labels of an enum, as [`CatalogError::TooLong`] names them.
const LABELS: &str = "the list of labels";

/// The reason why the table of a loop's variables, or of a cell's fields, cannot be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CatalogError {
    /// A text is too long.
    #[error(
        "{what} of entry {entry}, counted from 0, is too long: at most {most} {unit} are possible",
        unit = if *.what == LABELS { "labels" } else { "bytes" }
    )]
    TooLong {
        /// The number of the variable or parameter.
        entry: u32,
        /// The text that is too long, such as "name".
        what: &'static str,
        /// The greatest number of bytes, or of labels, that is allowed.
        most: usize,
    },
    /// The variables that a [`Watch`] describes need more or fewer words than [`Watch::words`] has.
    #[error(
        "the variables of block {block}, counted from 0, do not fill exactly its {words} words; correct their types and counts"
    )]
    Block {
        /// The index of the `Watch` in the catalog: variables first, then parameters.
        block: usize,
        /// The number of words that [`Watch::words`] has.
        words: usize,
    },
    /// The initial value of a parameter, or of one of a block of parameters, is not within its
    /// bounds.
    #[error("the initial value of parameter {parameter}, counted from 0, is out of its bounds")]
    Initial {
        /// The index of the parameter, or block, among all parameters of the catalog.
        parameter: usize,
    },
    /// There are more items of one kind, such as watchers, than the table or
    /// [`Selections`](crate::Selections) can hold.
    #[error("there are {count} {what}, but at most {most} are possible")]
    TooMany {
        /// The kind of item.
        what: &'static str,
        /// The number of items.
        count: usize,
        /// The greatest number that is allowed.
        most: usize,
    },
    /// There is no room in the region, or its memory cannot be accessed.
    #[error(transparent)]
    Access(#[from] AccessError),
}

/// An entry of a table, before it is written.
pub(crate) struct Item<'i> {
    pub(crate) description: VarDescription<'i>,
    /// Writes the name of the entry.
    pub(crate) name: &'i dyn Fn(&mut dyn fmt::Write) -> fmt::Result,
    pub(crate) is_param: bool,
    pub(crate) position: u32,
}

impl Item<'_> {
    /// Returns the name of the entry; `None` if it is too long or cannot be written.
    fn name(&self) -> Option<heapless::String<NAME_BYTES>> {
        let mut name = heapless::String::new();
        (self.name)(&mut name).ok()?;
        Some(name)
    }
}

/// A function that is called with each entry of a table, in order.
pub(crate) type Body<'b> = dyn FnMut(&Item<'_>) -> Result<(), CatalogError> + 'b;

impl<'e> Catalog<'e> {
    /// Makes a catalog of the variables `watched` and the parameters `params`. Entries are numbered
    /// from 0: first those of `watched`, then those of `params`.
    #[must_use]
    pub const fn new(watched: &'e [&'e dyn Watch], params: &'e [&'e dyn Tune]) -> Self {
        Self { watched, params }
    }

    pub(crate) const fn params(&self) -> &'e [&'e dyn Tune] {
        self.params
    }

    /// Iterates over the blocks; a parameter is a block, too.
    pub(crate) fn blocks(&self) -> impl Iterator<Item = &'e dyn Watch> + use<'e> {
        let params = self.params.iter().map(|param| *param as &'e dyn Watch);
        self.watched.iter().copied().chain(params)
    }

    /// Goes through all entries in order.
    pub(crate) fn each(&self, body: &mut Body<'_>) -> Result<(), CatalogError> {
        let mut position = 0;
        for (block, watch) in self.blocks().enumerate() {
            let words = watch.words().len();
            let wrong = CatalogError::Block { block, words };
            let (mut left, mut index) = (words, 0);
            while left > 0 {
                let description = watch.describe(index).ok_or(wrong)?;
                let size = description.kind.words();
                left = left.checked_sub(size).ok_or(wrong)?;
                body(&Item {
                    description,
                    name: &|to| watch.name(index, to),
                    is_param: block >= self.watched.len(),
                    position,
                })?;
                position += 4 * size as u32;
                index += 1;
            }
            if watch.describe(index).is_some() {
                return Err(wrong);
            }
        }
        Ok(())
    }

    /// Returns the shape of a table with `slots` slots, each with room for at least `rows` rows of all
    /// variables, and for half as many that have all parameters, too.
    pub(crate) fn shape(&self, slots: u32, rows: u32) -> Result<Shape, CatalogError> {
        let (shape, bytes) = measure(|body| self.each(body))?;
        let unsound = self.params.iter().position(|param| !param.is_sound());
        if let Some(parameter) = unsound {
            return Err(CatalogError::Initial { parameter });
        }
        // The number of rows is a power of two and at least 2: a reader copies one row while another is
        // written.
        let rows = rows.clamp(2, 1 << 31).next_power_of_two();
        let words = self.watched.iter().map(|watch| watch.words().len());
        let of_watched = row_bytes(words.sum::<usize>() as u32).saturating_mul(rows);
        // Parameters seldom change, and a loop may have many.
        let of_all = row_bytes(bytes.div_ceil(4)).saturating_mul((rows / 2).max(2));
        let rows = of_watched.max(of_all);
        let lines = shape.rows_at().saturating_add(rows).div_ceil(LINE);
        // A slot that is too large for every window is refused when the table is placed.
        let slot_bytes = lines.saturating_mul(LINE).min(u32::MAX - LINE + 1);
        Ok(Shape {
            slots,
            slot_bytes,
            ..shape
        })
    }

    /// Returns the number of bytes of shared memory that a table of this catalog takes. The table
    /// has `slots` slots for watchers, each with room for at least `rows` rows of all variables, and for
    /// half as many, but at least 2, that have all parameters, too.
    /// Returns `u32::MAX` if no memory can be that large.
    ///
    /// # Errors
    /// Returns [`CatalogError::TooLong`] or [`CatalogError::Block`] if an entry is invalid,
    /// [`CatalogError::Initial`] if the initial value of a parameter is out of bounds,
    /// [`CatalogError::TooMany`] if the variables and parameters need too many words.
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

/// Checks the entries of a table; returns its shape without slots, and the end of the last value in bytes.
///
/// `items` calls its argument with every entry, in order.
pub(crate) fn measure(
    items: impl FnOnce(&mut Body<'_>) -> Result<(), CatalogError>,
) -> Result<(Shape, u32), CatalogError> {
    let (mut shape, mut end) = (Shape::default(), 0);
    items(&mut |item| {
        let entry = shape.entries;
        let VarDescription {
            kind,
            unit,
            about,
            labels,
            ..
        } = item.description;
        let (name, mut bytes) = (item.name(), 4 * labels.len());
        let texts = [
            ("the name", name.as_deref(), NAME_BYTES),
            ("the unit", Some(unit), UNIT_BYTES),
            ("the description", Some(about), ABOUT_BYTES),
        ];
        let of_labels = labels.iter().map(|it| ("a label", Some(*it), UNIT_BYTES));
        for (what, text, most) in texts.into_iter().chain(of_labels) {
            let text = text.filter(|text| text.len() <= most);
            let text = text.ok_or(CatalogError::TooLong { entry, what, most })?;
            bytes += text.len().next_multiple_of(4);
        }
        if labels.len() > 255 {
            let (what, most) = (LABELS, 255);
            return Err(CatalogError::TooLong { entry, what, most });
        }
        shape.text_bytes = shape.text_bytes.saturating_add(bytes as u32);
        shape.entries += 1;
        end = end.max(item.position.saturating_add(kind.bytes() as u32));
        let count = shape.entries.max(end.div_ceil(4));
        if count > MOST_ENTRIES {
            return Err(CatalogError::TooMany {
                what: "words of variables",
                count: count as usize,
                most: MOST_ENTRIES as usize,
            });
        }
        Ok(())
    })?;
    Ok((shape, end))
}

/// Writes a table into memory from `allocator`; returns the table's region, its offset and its incarnation.
pub(crate) fn write<W: MemoryWindow + Clone>(
    own: &Region<W>,
    allocator: &mut Allocator,
    shape: Shape,
    rate: (u32, u32),
    cell: (u32, u32),
    items: impl FnOnce(&mut Body<'_>) -> Result<(), CatalogError>,
) -> Result<(Region<W>, u32, u32), CatalogError> {
    let bytes = shape.bytes().unwrap_or(u32::MAX);
    let offset = allocator.bytes(bytes as usize)?;
    let table = own.part(offset, bytes)?;
    let set = |at, word| table.store(at, word, StoreOrder::Relaxed);
    let incarnation = table.load(header::INCARNATION, LoadOrder::Relaxed)?;
    let incarnation = incarnation.wrapping_add(1);
    set(header::MAGIC, 0)?;
    // Pairs with a reader's first load: a reader that sees the new incarnation does not see the magic of the
    // former one.
    table.store(header::INCARNATION, incarnation, StoreOrder::Release)?;
    // A reader of the former incarnation that sees any of the following stores sees the new incarnation
    // afterwards.
    fence(Ordering::Release);
    set(header::VERSION, VERSION)?;
    let Shape {
        entries,
        text_bytes,
        slots,
        slot_bytes,
    } = shape;
    let ((a, b), (c, d)) = (rate, cell);
    let words = [bytes, a, b, entries, text_bytes, slots, slot_bytes, c, d];
    table.set(Offset::at(header::BYTES), &words)?;
    for number in 0..slots {
        for word in [slot::CLAIM, slot::SELECTION, slot::BEGUN, slot::COMPLETE] {
            set(shape.slot(number) + word, 0)?;
        }
    }
    // A name that has become longer since it was measured does not leave the texts.
    let texts = table.part(shape.texts(), shape.text_bytes)?;
    let (mut number, mut end) = (0, 0_u32);
    items(&mut |item| {
        let VarDescription {
            kind,
            unit,
            about,
            labels,
            bounds,
        } = item.description;
        let begin = end;
        let mut put = |text: &[u8]| {
            let result = texts.write(end, text);
            end = end.saturating_add((text.len() as u32).next_multiple_of(4));
            result
        };
        let name = item.name().unwrap_or_default();
        put(name.as_bytes())?;
        put(unit.as_bytes())?;
        put(about.as_bytes())?;
        for label in labels {
            put(&(label.len() as u32).to_le_bytes())?;
            put(label.as_bytes())?;
        }
        let lengths = [name.len(), unit.len(), about.len(), labels.len()].map(|len| len as u8);
        let flags = if item.is_param { IS_PARAM } else { 0 };
        let [[a, b], [c, d]] = bounds;
        let (lengths, kind) = (u32::from_le_bytes(lengths), kind as u32 | flags);
        let words = [begin, lengths, kind, item.position, a, b, c, d];
        table.set(Offset::at(entry_at(number)), &words)?;
        number += 1;
        Ok(())
    })?;
    // Pairs with the reader's load of the magic.
    table.store(header::MAGIC, MAGIC, StoreOrder::Release)?;
    Ok((table, offset, incarnation))
}
