//! [`Sampler`]: takes over parameters and writes rows, in the loop.

use core::fmt;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use condor_mbox::{AccessError, Instant, MemoryWindow, Region, StoreOrder};

use crate::catalog::Catalog;
use crate::kind::split;
use crate::layout::{Shape, row_bytes, slot};
use crate::param::Tune;
use crate::selections::{MOST_WATCHERS, Part, Plan, Selections};
use crate::sync::{Ordering, fence};

/// The part of a [`Selections`] that a loop calls in each tick: it takes over parameters that were
/// set, and writes rows of variables for watchers. Call [`begin`](Self::begin) before the body of
/// the loop and [`end`](Self::end) after it.
///
/// A sampler neither waits nor locks. A tick costs some instructions for each slot and each parameter, and one
/// copy of the selected values for each watcher.
pub struct Sampler<'e, W, const N: usize> {
    selections: &'e Selections<N>,
    rows: Rows<'e, W, N>,
    params: &'e [&'e dyn Tune],
    /// The rings of the watchers, one for each slot of the table.
    rings: heapless::Vec<Ring, MOST_WATCHERS>,
}

/// The sources of the rows, and the table into which they are written.
struct Rows<'e, W, const N: usize> {
    table: Region<W>,
    shape: Shape,
    /// The words of each block of the catalog; empty slices fill the rest.
    blocks: [[&'e [AtomicU32]; 3]; N],
}

/// The ring of one watcher, as its writer knows it.
#[derive(Clone, Copy, Debug, Default)]
struct Ring {
    /// The offset of the slot in the table.
    at: u32,
    /// The selection in force.
    selection: u32,
    /// The number of words of values in a row; 0 if nothing is selected.
    words: u32,
    /// One less than the number of rows.
    last_place: u32,
    /// The number of complete rows; wraps.
    complete: u32,
    every: u32,
    /// The number of ticks before the next row.
    wait: u32,
}

impl<'e, W: MemoryWindow, const N: usize> Sampler<'e, W, N> {
    pub(crate) fn new(
        selections: &'e Selections<N>,
        table: Region<W>,
        shape: Shape,
        catalog: &Catalog<'e>,
    ) -> Self {
        let rings = (0..shape.slots).take(MOST_WATCHERS).map(|number| Ring {
            at: shape.slot(number),
            ..Ring::default()
        });
        let rings = rings.collect();
        let mut blocks: [[&[AtomicU32]; 3]; N] = [[&[]; 3]; N];
        for (place, block) in blocks.as_flattened_mut().iter_mut().zip(catalog.blocks()) {
            *place = block.words();
        }
        let rows = Rows {
            table,
            shape,
            blocks,
        };
        Self {
            selections,
            rows,
            params: catalog.params(),
            rings,
        }
    }

    /// Begins a tick: takes over parameters that were set and selections that watchers have made.
    ///
    /// # Errors
    /// Returns [`AccessError`] if the window cannot be accessed; the body may run all the same.
    #[inline]
    pub fn begin(&mut self) -> Result<(), AccessError> {
        for param in self.params {
            param.latch();
        }
        let mut result = Ok(());
        for (slot, ring) in self.selections.slots.iter().zip(&mut self.rings) {
            // Pairs with the handler's store, after the plan.
            let asked = slot.asked.load(Ordering::Acquire);
            if asked != ring.selection {
                result = result.and(self.rows.take(ring, asked, slot.plan(asked)));
                // Pairs with the handler's load of `taken` before it writes the former plan: the fence in
                // `take` comes after all loads of that plan.
                slot.taken.store(asked, Ordering::Relaxed);
            }
        }
        result
    }

    /// Ends a tick: writes a row for each watcher that is due for one. The row has the number of
    /// the tick, `tick`, the time of its release, `released`, and the values of the variables that
    /// the watcher has selected.
    ///
    /// # Errors
    /// Returns [`AccessError`] if the window cannot be accessed; some watchers then have no row of this tick.
    #[inline]
    pub fn end(&mut self, tick: u64, released: Instant) -> Result<(), AccessError> {
        let mut result = Ok(());
        for (slot, ring) in self.selections.slots.iter().zip(&mut self.rings) {
            if ring.words == 0 {
                continue;
            }
            if let Some(wait) = ring.wait.checked_sub(1) {
                ring.wait = wait;
                continue;
            }
            ring.wait = ring.every.wrapping_sub(1);
            let plan = slot.plan(ring.selection);
            result = result.and(self.rows.write(ring, plan, tick, released));
        }
        result
    }
}

impl<W: MemoryWindow, const N: usize> Rows<'_, W, N> {
    /// Takes over a selection, of which there are no rows yet.
    #[cold]
    fn take(&self, ring: &mut Ring, selection: u32, plan: &Plan<N>) -> Result<(), AccessError> {
        let words = plan.words.load(Relaxed);
        let rows = self.shape.rows(words);
        *ring = Ring {
            at: ring.at,
            selection,
            words: if rows == 0 { 0 } else { words },
            last_place: rows.wrapping_sub(1),
            every: plan.every.load(Relaxed),
            ..Ring::default()
        };
        let left = (self.table).store(ring.at + slot::SELECTION, 0, StoreOrder::Relaxed);
        // A reader of the former selection that sees any of the following stores sees that its selection has
        // ended.
        fence(Ordering::Release);
        left?;
        for word in [slot::BEGUN, slot::COMPLETE] {
            self.table.store(ring.at + word, 0, StoreOrder::Relaxed)?;
        }
        // Pairs with the reader's first load of the slot.
        self.table
            .store(ring.at + slot::SELECTION, selection, StoreOrder::Release)
    }

    // Inlined, it would make ticks without a row longer.
    #[inline(never)]
    fn write(
        &self,
        ring: &mut Ring,
        plan: &Plan<N>,
        tick: u64,
        released: Instant,
    ) -> Result<(), AccessError> {
        let place = ring.complete & ring.last_place;
        let mut at = ring.at + self.shape.rows_at() + place.wrapping_mul(row_bytes(ring.words));
        let next = ring.complete.wrapping_add(1);
        let begun = ring.at + slot::BEGUN;
        self.table.store(begun, next, StoreOrder::Relaxed)?;
        // A reader that copies any of the words that follow passes its fence after this one, so that it
        // finds this row begun.
        fence(Ordering::Release);
        let mut put = |from: &[&[AtomicU32]], words: usize| {
            let result = self.table.write_words(at, 4 * words, from);
            at = at.wrapping_add(4 * words as u32);
            result
        };
        let ([a, b], [c, d]) = (split(tick), split(released.as_ns()));
        put(&[&[a, b, c, d].map(AtomicU32::new)], 4)?;
        for (run, part) in plan.pieces() {
            let blocks = self.blocks.as_flattened().get(run).unwrap_or_default();
            match part {
                Part::Whole { words } => put(blocks, words)?,
                Part::Words(range) => {
                    let block = blocks.first().and_then(|block| block.get(range));
                    let block = block.unwrap_or_default();
                    put(&[block], block.len())?;
                }
            }
        }
        // Pairs with the reader's load of `complete`.
        self.table
            .store(ring.at + slot::COMPLETE, next, StoreOrder::Release)?;
        ring.complete = next;
        Ok(())
    }
}

impl<W, const N: usize> fmt::Debug for Sampler<'_, W, N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Sampler")
            .field("blocks", &(3 * N))
            .field("params", &self.params.len())
            .field("rings", &self.rings)
            .finish()
    }
}
