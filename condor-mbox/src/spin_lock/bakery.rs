//! [`Bakery`]: a lock of loads and stores alone.

use crate::exclusion::Exclusion;
use crate::id::Processor;
use crate::layout::LINE;
use crate::sync::{Ordering, fence};
use crate::window::{
    AccessError, LoadOrder, MemoryWindow, StoreOrder, WindowError, WindowErrorKind,
};

use super::owner::{Incarnations, LockOwner};
use super::{Attempt, TestAndSet};

/// Lamport's bakery, a lock of loads and stores alone: each processor that competes draws a ticket
/// larger than all that it sees, and the smallest ticket goes first.
///
/// The lock needs no indivisible read-and-write, and is fair to processors that wait. Taking it
/// costs loads in proportion to the number of processors. The [`Exclusion`] keeps the contexts of
/// one processor, which share an entry, apart for three accesses.
///
/// # In shared memory
///
/// The lock consists of cache lines, so that no two processors write the same line:
///
/// | line, word | meaning | written by |
/// |---|---|---|
/// | 0, 0 | the owner of the lock, or zero | the owner |
/// | 1 + *p*, 0 | processor *p* in its present incarnation if it competes, or zero | *p* |
/// | 1 + *p*, 1 | its ticket; zero while it is drawn | *p* |
///
/// An entry of an incarnation that is over does not count. If that incarnation ended while it held
/// the lock, word 0 still names it; only a processor that has won the bakery changes the word.
///
/// Source: L. Lamport, "A new solution of Dijkstra's concurrent programming problem",
/// CACM 17 (8), 1974.
#[derive(Clone, Copy, Debug)]
pub struct Bakery<W, X> {
    window: W,
    at: u32,
    processors: u8,
    exclusion: X,
}

const ENTRIES: u32 = LINE;
const ENTRY_BYTES: u32 = LINE;
const TICKET: u32 = 4;

impl Bakery<(), ()> {
    /// Returns the size of the lock in shared memory, in bytes, if `processors` processors may take
    /// it.
    #[must_use]
    pub const fn bytes(processors: u8) -> usize {
        (ENTRIES + processors as u32 * ENTRY_BYTES) as usize
    }
}

impl<W: MemoryWindow, X: Exclusion> Bakery<W, X> {
    /// Makes a handle of the lock at `offset` bytes of `window`, which processors 0 to `processors`
    /// − 1 may take. All of them must use the same number of processors.
    ///
    /// # Errors
    /// [`AccessError`] of the kind `OutOfBounds` if the lock is not inside the window, or of the
    /// kind `Misaligned` if `offset` is not a multiple of four.
    pub fn new(window: W, offset: u32, processors: u8, exclusion: X) -> Result<Self, AccessError> {
        AccessError::check(&window, offset, Bakery::bytes(processors))?;
        Ok(Self {
            window,
            at: offset,
            processors,
            exclusion,
        })
    }

    /// Offset of the entry of `owner`'s processor.
    fn entry_of(&self, owner: LockOwner) -> Result<(u8, u32), WindowErrorKind> {
        match owner.processor() {
            Some(Processor(number)) if number < self.processors => Ok((number, self.entry(number))),
            _ => Err(WindowErrorKind::OutOfBounds),
        }
    }

    /// Offset of an entry; inside the window if `number` is below the number of processors.
    fn entry(&self, number: u8) -> u32 {
        self.at
            .wrapping_add(ENTRIES)
            .wrapping_add(u32::from(number).wrapping_mul(ENTRY_BYTES))
    }

    /// Returns the competitor with processor number `number` and its ticket; `None` if there is none,
    /// or if its incarnation is over.
    fn competitor(
        &self,
        number: u8,
        incarnations: &dyn Incarnations,
    ) -> Result<Option<(LockOwner, u32)>, WindowErrorKind> {
        let entry = self.entry(number);
        // Pairs with the stores of the entry's word in `compete`, `withdraw` and `release`:
        // what its processor did inside the lock before is seen.
        let Some(owner) = LockOwner::from_word(self.load(entry, LoadOrder::Acquire)?) else {
            return Ok(None);
        };
        if owner.processor() != Some(Processor(number)) || !incarnations.is_current(owner) {
            return Ok(None);
        }
        // Pairs with the store of the ticket in `compete`; that, too, follows what its
        // processor did inside the lock before.
        let ticket = self.load(entry.wrapping_add(TICKET), LoadOrder::Acquire)?;
        Ok(Some((owner, ticket)))
    }

    /// Draws a ticket for `number`; `false` if there is no larger one.
    fn draw(&self, number: u8, incarnations: &dyn Incarnations) -> Result<bool, WindowErrorKind> {
        // Against the same fence below, of any other processor: either it sees here a ticket drawn before, or
        // that processor sees this entry when it looks for tickets before its own.
        fence(Ordering::SeqCst);
        let mut largest: u32 = 0;
        for other in (0..self.processors).filter(|other| *other != number) {
            if let Some((_, ticket)) = self.competitor(other, incarnations)? {
                largest = largest.max(ticket);
            }
        }
        let Some(ticket) = largest.checked_add(1) else {
            // Tickets begin again once nobody competes for a moment.
            return Ok(false);
        };
        // Pairs with the load of `competitor`.
        let entry = self.entry(number);
        self.store(entry.wrapping_add(TICKET), ticket, StoreOrder::Release)?;
        fence(Ordering::SeqCst);
        Ok(true)
    }

    fn load(&self, offset: u32, order: LoadOrder) -> Result<u32, WindowErrorKind> {
        self.window
            .load(offset, order)
            .map_err(|error| error.kind())
    }

    fn store(&self, offset: u32, word: u32, order: StoreOrder) -> Result<(), WindowErrorKind> {
        self.window
            .store(offset, word, order)
            .map_err(|error| error.kind())
    }
}

impl<W: MemoryWindow, X: Exclusion> TestAndSet for Bakery<W, X> {
    fn compete(
        &self,
        me: LockOwner,
        incarnations: &dyn Incarnations,
    ) -> Result<bool, WindowErrorKind> {
        let (number, entry) = self.entry_of(me)?;
        let word = LockOwner::to_word(Some(me));
        let entered = self.exclusion.with(|| {
            // Written by this processor alone; the exclusion orders its contexts.
            if self.load(entry, LoadOrder::Relaxed)? == word {
                return Ok(false);
            }
            self.store(entry.wrapping_add(TICKET), 0, StoreOrder::Relaxed)?;
            // Pairs with the load of `competitor`: with this incarnation its ticket is zero.
            self.store(entry, word, StoreOrder::Release)?;
            Ok(true)
        })?;
        if !entered {
            return Ok(false);
        }
        let drawn = self.draw(number, incarnations);
        if !matches!(drawn, Ok(true)) {
            self.withdraw(me)?;
        }
        drawn
    }

    fn take(
        &self,
        from: Option<LockOwner>,
        me: LockOwner,
        incarnations: &dyn Incarnations,
    ) -> Result<Attempt, WindowErrorKind> {
        let (number, entry) = self.entry_of(me)?;
        // Written by this processor alone.
        let ticket = self.load(entry.wrapping_add(TICKET), LoadOrder::Relaxed)?;
        for other in (0..self.processors).filter(|other| *other != number) {
            if let Some((owner, drawn)) = self.competitor(other, incarnations)?
                && (drawn == 0 || (drawn, other) < (ticket, number))
            {
                return Ok(Attempt::Behind(Some(owner)));
            }
        }
        // Written inside the bakery alone; `competitor` has ordered it after the last owner.
        let attempt = Attempt::of(
            self.load(self.at, LoadOrder::Relaxed)?,
            LockOwner::to_word(from),
        );
        if attempt == Attempt::Taken {
            // Pairs with the load above, by way of the entry.
            self.store(self.at, LockOwner::to_word(Some(me)), StoreOrder::Relaxed)?;
        }
        Ok(attempt)
    }

    fn withdraw(&self, me: LockOwner) -> Result<(), WindowErrorKind> {
        let (_, entry) = self.entry_of(me)?;
        // Pairs with the load of `competitor`.
        self.store(entry, 0, StoreOrder::Release)
    }

    fn release(&self, me: LockOwner) -> Result<(), WindowErrorKind> {
        // Not its own word only if somebody took it for dead.
        if self.load(self.at, LoadOrder::Relaxed)? == LockOwner::to_word(Some(me)) {
            // Pairs with the load of `take`, by way of the entry.
            self.store(self.at, 0, StoreOrder::Relaxed)?;
        }
        self.withdraw(me)
    }
}
