//! [`Sampler`]: the loop's end, which latches parameters and writes rows.

use core::array;
use core::fmt;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use condor_mbox::window::Words;
use condor_mbox::{AccessError, Instant, MemoryWindow, Region, StoreOrder};

use crate::catalog::{Catalog, CatalogError};
use crate::desk::{Desk, Plan};
use crate::layout::{ROW_HEADER, Shape, row_bytes, slot};
use crate::param::Tune;
use crate::sync::{Ordering, fence};

/// The end of a [`Desk`] in the loop: call [`begin`](Self::begin) before the body of a tick and
/// [`end`](Self::end) after it.
///
/// It neither waits nor locks. A tick costs some instructions for each slot and each parameter, and what
/// is selected is copied once for each watcher.
pub struct Sampler<'e, W, const BLOCKS: usize, const PIECES: usize, const SLOTS: usize> {
    desk: &'e Desk<PIECES, SLOTS>,
    table: Region<W>,
    shape: Shape,
    blocks: heapless::Vec<&'e [AtomicU32], BLOCKS>,
    params: &'e [&'e dyn Tune],
    rings: [Ring; SLOTS],
}

/// The ring of one watcher, as its writer knows it.
#[derive(Clone, Copy, Debug, Default)]
struct Ring {
    /// Where the slot begins.
    at: u32,
    /// The selection in force.
    selection: u32,
    /// Words of a row's values; 0 if nothing is selected.
    words: u32,
    /// One less than the number of rows.
    last_place: u32,
    /// How many rows there have been.
    complete: u32,
    every: u32,
    /// Ticks until the next row.
    wait: u32,
}

impl<'e, W: MemoryWindow, const BLOCKS: usize, const PIECES: usize, const SLOTS: usize>
    Sampler<'e, W, BLOCKS, PIECES, SLOTS>
{
    pub(crate) fn new(
        desk: &'e Desk<PIECES, SLOTS>,
        table: Region<W>,
        shape: Shape,
        catalog: Catalog<'e>,
    ) -> Result<Self, CatalogError> {
        let mut blocks = heapless::Vec::new();
        for block in catalog.blocks() {
            if blocks.push(block.words()).is_err() {
                return Err(CatalogError::TooMany {
                    what: "blocks of variables",
                    count: catalog.blocks().count(),
                    most: BLOCKS,
                });
            }
        }
        Ok(Self {
            desk,
            table,
            shape,
            blocks,
            params: catalog.params(),
            rings: array::from_fn(|number| Ring {
                at: shape.slot(number as u32),
                ..Ring::default()
            }),
        })
    }

    /// Begins a tick: takes over parameters that were set, and selections.
    ///
    /// # Errors
    /// As [`MemoryWindow::store`]; the body may run all the same.
    #[inline]
    pub fn begin(&mut self) -> Result<(), AccessError> {
        for param in self.params {
            param.latch();
        }
        let mut result = Ok(());
        for (slot, ring) in self.desk.slots.iter().zip(&mut self.rings) {
            // Pairs with the handler's store, after the plan.
            let asked = slot.asked.load(Ordering::Acquire);
            if asked != ring.selection {
                let plan = slot.plan(asked);
                result = result.and(ring.take(asked, plan, self.shape, &self.table));
                // Pairs with the handler's look at it, before it writes the former plan.
                slot.taken.store(asked, Ordering::Release);
            }
        }
        result
    }

    /// Ends a tick: writes a row for each watcher that is to have one, with the number of the tick and
    /// the time of its release.
    ///
    /// # Errors
    /// As [`MemoryWindow::store`]; then some watchers have no row.
    #[inline]
    pub fn end(&mut self, tick: u64, released: Instant) -> Result<(), AccessError> {
        let mut result = Ok(());
        for (slot, ring) in self.desk.slots.iter().zip(&mut self.rings) {
            if ring.words == 0 {
                continue;
            }
            if let Some(wait) = ring.wait.checked_sub(1) {
                ring.wait = wait;
                continue;
            }
            ring.wait = ring.every.saturating_sub(1);
            let plan = slot.plan(ring.selection);
            let source = Source {
                blocks: &self.blocks,
                plan,
                header: header(tick, released),
            };
            result = result.and(ring.write(&self.table, self.shape, &source));
        }
        result
    }
}

impl Ring {
    /// Takes over a selection, of which there are no rows yet.
    #[cold]
    fn take<W: MemoryWindow, const PIECES: usize>(
        &mut self,
        selection: u32,
        plan: &Plan<PIECES>,
        shape: Shape,
        table: &Region<W>,
    ) -> Result<(), AccessError> {
        let words = plan.words.load(Relaxed);
        let rows = shape.rows(words);
        *self = Self {
            at: self.at,
            selection,
            words: if rows == 0 { 0 } else { words },
            last_place: rows.wrapping_sub(1),
            complete: 0,
            every: plan.every.load(Relaxed),
            wait: 0,
        };
        table.store(self.at + slot::SELECTION, 0, StoreOrder::Relaxed)?;
        // A reader of the former selection that sees anything of what follows sees the end of that one.
        fence(Ordering::Release);
        table.store(self.at + slot::BEGUN, 0, StoreOrder::Relaxed)?;
        table.store(self.at + slot::COMPLETE, 0, StoreOrder::Relaxed)?;
        // Pairs with the reader's first look at the slot.
        table.store(self.at + slot::SELECTION, selection, StoreOrder::Release)
    }

    fn write<W: MemoryWindow, const PIECES: usize>(
        &mut self,
        table: &Region<W>,
        shape: Shape,
        source: &Source<'_, PIECES>,
    ) -> Result<(), AccessError> {
        let place = self.complete & self.last_place;
        let row = row_bytes(self.words);
        let at = self.at + shape.rows_at() + place.wrapping_mul(row);
        let next = self.complete.wrapping_add(1);
        table.store(self.at + slot::BEGUN, next, StoreOrder::Relaxed)?;
        // A reader that copies any of the words that follow passes its fence after this one, so that it
        // finds this row begun.
        fence(Ordering::Release);
        source.write(table, at, row)?;
        // Pairs with the reader's look for new rows.
        table.store(self.at + slot::COMPLETE, next, StoreOrder::Release)?;
        self.complete = next;
        Ok(())
    }
}

/// What becomes a row.
struct Source<'s, const PIECES: usize> {
    blocks: &'s [&'s [AtomicU32]],
    plan: &'s Plan<PIECES>,
    header: [u32; ROW_HEADER as usize],
}

impl<'s, const PIECES: usize> Source<'s, PIECES> {
    /// Iterates over the pieces: some whole blocks, or a part of one.
    #[inline(always)]
    fn pieces(&self) -> impl Iterator<Item = (&'s [&'s [AtomicU32]], Option<(usize, usize)>)> {
        let blocks = self.blocks;
        let count = self.plan.count.load(Relaxed) as usize;
        let pieces = self.plan.blocks.iter().zip(&self.plan.parts);
        pieces.take(count).map(move |(whole, part)| {
            let (first, end) = unpack(whole.load(Relaxed));
            let part = unpack(part.load(Relaxed));
            let blocks = blocks.get(first..end).unwrap_or_default();
            (blocks, (part.1 != 0).then_some(part))
        })
    }

    /// Writes a row of so many bytes; what finds no room is left out.
    #[inline(always)]
    fn write<W: MemoryWindow>(
        &self,
        table: &Region<W>,
        at: u32,
        bytes: u32,
    ) -> Result<(), AccessError> {
        let end = at.saturating_add(bytes);
        let all = table.words().map(Words::get);
        let mut row = Row {
            table,
            plain: all.and_then(|words| words.get((at / 4) as usize..(end / 4) as usize)),
            at,
            end,
        };
        for word in self.header {
            row.put([&AtomicU32::new(word)])?;
        }
        for (blocks, part) in self.pieces() {
            if let Some((first, end)) = part {
                let block = blocks.first().and_then(|block| block.get(first..end));
                row.put_block(block.unwrap_or_default())?;
                continue;
            }
            row.put_blocks(blocks)?;
        }
        Ok(())
    }
}

/// From how many words on a block is copied by the window, which may have a faster way.
const LONG: usize = 32;

/// The part of a row that is still to be written.
struct Row<'t, W> {
    table: &'t Region<W>,
    /// Its words, if plain stores reach them; then `at` stands still.
    plain: Option<&'t [AtomicU32]>,
    at: u32,
    end: u32,
}

impl<W: MemoryWindow> Row<'_, W> {
    /// Writes blocks; of single variables four at a time, without a loop for each.
    #[inline(always)]
    fn put_blocks(&mut self, blocks: &[&[AtomicU32]]) -> Result<(), AccessError> {
        let (fours, others) = blocks.as_chunks::<4>();
        for four in fours {
            // What is left of the row is kept in a register from one four to the next.
            let mut to = self.plain.unwrap_or_default();
            let is_put = match four {
                [[a], [b], [c], [d]] => put(&mut to, [a, b, c, d]),
                [[a, a2], [b, b2], [c, c2], [d, d2]] => put(&mut to, [a, a2, b, b2, c, c2, d, d2]),
                _ => false,
            };
            if is_put {
                self.plain = Some(to);
            } else {
                four.iter().try_for_each(|block| self.put_block(block))?;
            }
        }
        others.iter().try_for_each(|block| self.put_block(block))
    }

    #[inline(always)]
    fn put_block(&mut self, block: &[AtomicU32]) -> Result<(), AccessError> {
        if block.len() < LONG {
            let (eights, others) = block.as_chunks::<8>();
            for eight in eights {
                self.put(eight.each_ref())?;
            }
            return others.iter().try_for_each(|word| self.put([word]));
        }
        let at = match self.plain {
            Some(to) => self.end.wrapping_sub((4 * to.len()) as u32),
            None => self.at,
        };
        let bytes = (4 * block.len()) as u32;
        if bytes > self.end.wrapping_sub(at) {
            return Ok(());
        }
        self.table.write_words(at, block)?;
        match &mut self.plain {
            Some(to) => *to = to.get(block.len()..).unwrap_or_default(),
            None => self.at = at.wrapping_add(bytes),
        }
        Ok(())
    }

    #[inline(always)]
    fn put<const N: usize>(&mut self, from: [&AtomicU32; N]) -> Result<(), AccessError> {
        match &mut self.plain {
            Some(to) => {
                put(to, from);
                Ok(())
            }
            None => self.put_slowly(&from),
        }
    }

    fn put_slowly(&mut self, from: &[&AtomicU32]) -> Result<(), AccessError> {
        for word in from {
            if self.at < self.end {
                let value = word.load(Relaxed);
                self.table.store(self.at, value, StoreOrder::Relaxed)?;
                self.at = self.at.wrapping_add(4);
            }
        }
        Ok(())
    }
}

/// Copies some words to the first of `to` and leaves the others there, if there are as many. All are loaded
/// before the first is stored.
#[inline(always)]
fn put<const N: usize>(to: &mut &[AtomicU32], from: [&AtomicU32; N]) -> bool {
    let Some((head, rest)) = to.split_first_chunk::<N>() else {
        return false;
    };
    let values = from.map(|word| word.load(Relaxed));
    for (to, value) in head.iter().zip(values) {
        to.store(value, Relaxed);
    }
    *to = rest;
    true
}

const fn header(tick: u64, released: Instant) -> [u32; ROW_HEADER as usize] {
    let ns = released.as_ns();
    [
        tick as u32,
        (tick >> 32) as u32,
        ns as u32,
        (ns >> 32) as u32,
    ]
}

/// Packs a range of numbers below 2^16.
pub(crate) const fn pack(first: usize, end: usize) -> u32 {
    (end as u32) << 16 | first as u32
}

const fn unpack(range: u32) -> (usize, usize) {
    ((range & 0xffff) as usize, (range >> 16) as usize)
}

impl<W, const BLOCKS: usize, const PIECES: usize, const SLOTS: usize> fmt::Debug
    for Sampler<'_, W, BLOCKS, PIECES, SLOTS>
{
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Sampler")
            .field("blocks", &self.blocks.len())
            .field("params", &self.params.len())
            .field("rings", &self.rings)
            .finish()
    }
}
