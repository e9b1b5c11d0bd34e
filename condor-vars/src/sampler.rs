//! [`Sampler`]: the loop's end, which latches parameters and writes rows.

use core::array;
use core::fmt;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use condor_mbox::{AccessError, Instant, MemoryWindow, Region, StoreOrder};

use crate::catalog::{Catalog, CatalogError};
use crate::desk::{Desk, Part, Plan};
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
            let header = header(tick, released).map(AtomicU32::new);
            let row = ring.write(&self.table, self.shape, &header, plan, &self.blocks);
            result = result.and(row);
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

    #[inline(never)] // which would make ticks without a row longer
    fn write<W: MemoryWindow, const PIECES: usize>(
        &mut self,
        table: &Region<W>,
        shape: Shape,
        header: &[AtomicU32],
        plan: &Plan<PIECES>,
        blocks: &[&[AtomicU32]],
    ) -> Result<(), AccessError> {
        let place = self.complete & self.last_place;
        let row = row_bytes(self.words);
        let mut at = self.at + shape.rows_at() + place.wrapping_mul(row);
        let next = self.complete.wrapping_add(1);
        table.store(self.at + slot::BEGUN, next, StoreOrder::Relaxed)?;
        // A reader that copies any of the words that follow passes its fence after this one, so that it
        // finds this row begun.
        fence(Ordering::Release);
        let mut put = |from: &[&[AtomicU32]], words: usize| {
            let result = table.write_words(at, 4 * words, from);
            at = at.wrapping_add(4 * words as u32);
            result
        };
        put(&[header], header.len())?;
        for (run, part) in plan.pieces() {
            let blocks = blocks.get(run).unwrap_or_default();
            match part {
                Part::Whole { words } => put(blocks, words)?,
                Part::Words(range) => {
                    let block = blocks.first().and_then(|block| block.get(range));
                    let block = block.unwrap_or_default();
                    put(&[block], block.len())?;
                }
            }
        }
        // Pairs with the reader's look for new rows.
        table.store(self.at + slot::COMPLETE, next, StoreOrder::Release)?;
        self.complete = next;
        Ok(())
    }
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
