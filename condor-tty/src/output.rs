//! [`Output`]: the processor's half of a terminal's ring in shared memory.

use core::time::Duration;

use condor_mbox::{
    AccessError, Exclusion, Instant, LoadOrder, MemoryWindow, Processor, Region, StoreOrder,
};

use crate::error::TerminalError;
use crate::layout::{
    ALIGNMENT, BLOCK_BYTES, MAGIC, VERSION, host, is_capacity, is_offset, policy,
    processor as words,
};
use crate::policy::Policy;
use crate::sync::{Ordering, Word, fence};

/// The ring as its processor sees it; what the processor needs to know again is not in shared
/// memory but here.
///
/// Contexts that interrupt each other write at the same time: each reserves its bytes in one
/// exclusive section, copies them with interrupts on, and the last of those that overlap
/// publishes what all have written.
#[derive(Debug)]
pub(crate) struct Output<W, X> {
    region: Region<W>,
    offset: u32,
    capacity: u32,
    incarnation: u32,
    exclusion: X,
    reserved: Word,
    head: Word,
    /// Writers between their reservation and their end.
    writers: Word,
    /// The last valid tail of the host.
    tail: Word,
    /// The last invalid tail of the host.
    disbelieved: Word,
    ignored: Word,
    lost: Word,
    typed: Word,
    waiting: Word,
    policy: Word,
    /// Nanoseconds of [`Policy::Block`], low word and high word.
    timeout: [Word; 2],
}

impl<W: MemoryWindow, X: Exclusion> Output<W, X> {
    pub(crate) fn new(
        region: Region<W>,
        offset: u32,
        capacity: u32,
        exclusion: X,
    ) -> Result<Self, TerminalError> {
        if !is_capacity(capacity) {
            return Err(TerminalError::Capacity { capacity });
        }
        if !is_offset(offset) {
            return Err(TerminalError::Offset { offset });
        }
        region.check(offset, (BLOCK_BYTES + capacity) as usize)?;
        let zero = || Word::new(0);
        let mut this = Self {
            region,
            offset,
            capacity,
            incarnation: 0,
            exclusion,
            reserved: zero(),
            head: zero(),
            writers: zero(),
            tail: zero(),
            disbelieved: zero(),
            ignored: zero(),
            lost: zero(),
            typed: zero(),
            waiting: zero(),
            policy: Word::new(policy::DROP_NEW),
            timeout: [zero(), zero()],
        };
        this.format()?;
        Ok(this)
    }

    /// Puts the block in order and begins a new incarnation.
    ///
    /// A host of the former incarnation may go on writing its words: they name that incarnation.
    fn format(&mut self) -> Result<(), AccessError> {
        let former = self
            .load(words::INCARNATION, LoadOrder::Relaxed)?
            .max(self.first_incarnation());
        self.store(words::INCARNATION, 0, StoreOrder::Relaxed)?;
        fence(Ordering::Release);
        for word in (0..BLOCK_BYTES)
            .step_by(4)
            .filter(|at| *at != words::INCARNATION)
        {
            self.store(word, 0, StoreOrder::Relaxed)?;
        }
        self.store(words::MAGIC, MAGIC, StoreOrder::Relaxed)?;
        self.store(words::VERSION, VERSION, StoreOrder::Relaxed)?;
        self.store(words::CAPACITY, self.capacity, StoreOrder::Relaxed)?;
        self.store(words::POLICY, self.policy.get(), StoreOrder::Relaxed)?;
        self.incarnation = former.wrapping_add(1).max(1);
        // Release: pairs with the Acquire load in `TerminalReader::attach`; the block is in order.
        self.store(words::INCARNATION, self.incarnation, StoreOrder::Release)
    }

    /// The number from which incarnations are counted: a program that makes its terminal at another place than
    /// before begins another incarnation there, too.
    const fn first_incarnation(&self) -> u32 {
        (self.offset / ALIGNMENT) << 8
    }

    pub(crate) const fn offset(&self) -> u32 {
        self.offset
    }

    pub(crate) const fn exclusion(&self) -> &X {
        &self.exclusion
    }

    pub(crate) fn policy(&self) -> Policy {
        self.exclusion.with(|| match self.policy.get() {
            policy::BLOCK => {
                let [low, high] = self.timeout.each_ref().map(Word::get);
                let timeout = Duration::from_nanos(u64::from(high) << 32 | u64::from(low));
                Policy::Block { timeout }
            }
            policy::DROP_OLD => Policy::DropOld,
            _ => Policy::DropNew,
        })
    }

    pub(crate) fn set_policy(&self, policy: Policy) -> Result<(), AccessError> {
        self.exclusion.with(|| {
            if let Policy::Block { timeout } = policy {
                let ns = Instant::from_ns(0).after(timeout).as_ns();
                self.timeout[0].set(ns as u32);
                self.timeout[1].set((ns >> 32) as u32);
            }
            self.policy.set(policy.word());
            self.store(words::POLICY, policy.word(), StoreOrder::Relaxed)
        })
    }

    /// Tells the host of the mode.
    pub(crate) fn set_mode(&self, mode: u32) -> Result<(), AccessError> {
        self.store(words::MODE, mode, StoreOrder::Relaxed)
    }

    /// The host that is attached to this incarnation of the terminal; it may be dead.
    pub(crate) fn attached(&self) -> Result<Option<Processor>, AccessError> {
        // Acquire: pairs with the Release store in `TerminalReader::attach`.
        if self.load(host::INCARNATION, LoadOrder::Acquire)? != self.incarnation {
            return Ok(None);
        }
        let [number, ..] = self.load(host::ATTACHED, LoadOrder::Relaxed)?.to_le_bytes();
        Ok(number.checked_sub(1).map(Processor))
    }

    /// Writes as many of `bytes` as there is room for now, and says how many; with `whole`, all of
    /// them or none.
    pub(crate) fn put(&self, bytes: &[u8], whole: bool) -> Result<usize, AccessError> {
        let Some((position, count)) = self.exclusion.with(|| self.reserve(bytes, whole))? else {
            return Ok(0);
        };
        let taken = bytes.get(..count).unwrap_or(bytes);
        let copied = self.copy_middle(position, taken);
        self.exclusion.with(|| self.publish())?;
        copied.map(|()| count)
    }

    /// Takes positions for a prefix of `bytes`, and writes those that share a word with others.
    fn reserve(&self, bytes: &[u8], whole: bool) -> Result<Option<(u32, usize)>, AccessError> {
        let room = self.room_alone()? as usize;
        let count = room.min(bytes.len());
        if count == 0 || whole && count < bytes.len() {
            return Ok(None);
        }
        let position = self.reserved.get();
        let end = position.wrapping_add(count as u32);
        // A reader that copied any of the bytes that follow passes its fence after this one, and
        // finds this mark or a later one. Release: pairs with the Acquire load in
        // `TerminalReader::skip_overwritten`; the head before is seen with it.
        self.store(words::RESERVED, end, StoreOrder::Release)?;
        fence(Ordering::Release);
        let taken = bytes.get(..count).unwrap_or(bytes);
        let (first, _, last) = split(position, taken);
        self.write_partly(position, first)?;
        self.write_partly(end.wrapping_sub(last.len() as u32), last)?;
        self.reserved.set(end);
        self.writers.set(self.writers.get().wrapping_add(1));
        // Bytes that the host will never see again are no longer waited for.
        if end.wrapping_sub(self.tail.get()) > self.capacity {
            self.tail.set(end.wrapping_sub(self.capacity));
        }
        Ok(Some((position, count)))
    }

    /// Copies the words that are this writer's alone, with nothing masked.
    fn copy_middle(&self, position: u32, bytes: &[u8]) -> Result<(), AccessError> {
        let (first, middle, _) = split(position, bytes);
        if middle.is_empty() {
            return Ok(());
        }
        let at = self.index(position.wrapping_add(first.len() as u32));
        let until_end = self.capacity.wrapping_sub(at) as usize;
        let (before_end, from_beginning) =
            middle.split_at_checked(until_end).unwrap_or((middle, &[]));
        self.region.write(self.ring_offset(at), before_end)?;
        self.region.write(self.ring_offset(0), from_beginning)
    }

    /// Writes bytes that lie inside of one word and leaves the rest of it as it is.
    fn write_partly(&self, position: u32, bytes: &[u8]) -> Result<(), AccessError> {
        if bytes.is_empty() {
            return Ok(());
        }
        let at = self.ring_offset(self.index(position) & !3);
        let mut word = self.region.load(at, LoadOrder::Relaxed)?.to_le_bytes();
        for (place, byte) in word.iter_mut().skip(position as usize % 4).zip(bytes) {
            *place = *byte;
        }
        self.region
            .store(at, u32::from_le_bytes(word), StoreOrder::Relaxed)
    }

    /// Ends a writer; the last one publishes.
    fn publish(&self) -> Result<(), AccessError> {
        let writers = self.writers.get().wrapping_sub(1);
        self.writers.set(writers);
        if writers != 0 {
            return Ok(());
        }
        let head = self.reserved.get();
        self.head.set(head);
        // Release: pairs with the Acquire load in `TerminalReader::fetch`; the bytes are there.
        self.store(words::HEAD, head, StoreOrder::Release)
    }

    /// Bytes that there is room for, at this moment.
    pub(crate) fn room(&self) -> Result<u32, AccessError> {
        self.exclusion.with(|| self.room_alone())
    }

    fn room_alone(&self) -> Result<u32, AccessError> {
        let oldest = if self.policy.get() == policy::DROP_OLD {
            // The space that interrupted contexts are writing stays theirs.
            self.head.get()
        } else {
            self.tail_alone()?
        };
        let used = self.reserved.get().wrapping_sub(oldest);
        Ok(self.capacity.saturating_sub(used))
    }

    /// Bytes that the host has not dealt with, as far as they are still there.
    pub(crate) fn unread(&self) -> Result<u32, AccessError> {
        self.exclusion
            .with(|| Ok(self.reserved.get().wrapping_sub(self.tail_alone()?)))
    }

    /// Bytes that have been written; wraps.
    pub(crate) fn written(&self) -> u32 {
        self.reserved.get()
    }

    /// The host's cursor, as far as it can be believed.
    fn tail_alone(&self) -> Result<u32, AccessError> {
        let believed = self.tail.get();
        // Acquire: pairs with the Release store in `TerminalReader::attach`.
        if self.load(host::INCARNATION, LoadOrder::Acquire)? != self.incarnation {
            return Ok(believed);
        }
        // Acquire: pairs with the Release store in `TerminalReader::commit`; the host has copied what is
        // overwritten from now on.
        let tail = self.load(host::TAIL, LoadOrder::Acquire)?;
        let most = self.head.get().wrapping_sub(believed);
        if tail.wrapping_sub(believed) <= most {
            self.tail.set(tail);
            return Ok(tail);
        }
        if tail != self.disbelieved.get() {
            self.disbelieved.set(tail);
            self.count(words::IGNORED, &self.ignored, 1)?;
        }
        Ok(believed)
    }

    /// Bytes that found no room.
    pub(crate) fn lost(&self) -> u32 {
        self.lost.get()
    }

    pub(crate) fn ignored(&self) -> u32 {
        self.ignored.get()
    }

    pub(crate) fn count_lost(&self, bytes: usize) -> Result<(), AccessError> {
        if bytes == 0 {
            return Ok(());
        }
        self.exclusion
            .with(|| self.count(words::LOST, &self.lost, bytes as u32))
    }

    /// Counts a character of the host's that has been taken.
    pub(crate) fn count_typed(&self) -> Result<(), AccessError> {
        self.exclusion
            .with(|| self.count(words::TYPED, &self.typed, 1))
    }

    /// Says that one more context waits for the host, or one less.
    pub(crate) fn set_waiting(&self, waits: bool) -> Result<(), AccessError> {
        let stored = self.exclusion.with(|| {
            let change = if waits { 1 } else { u32::MAX };
            self.count(words::WAITING, &self.waiting, change)
        });
        // Pairs with the fence in `TerminalReader::acknowledge`: either the host sees that somebody
        // waits, or the next look here sees what it has dealt with.
        fence(Ordering::SeqCst);
        stored
    }

    /// Adds to a count here and in shared memory.
    fn count(&self, word: u32, count: &Word, more: u32) -> Result<(), AccessError> {
        count.set(count.get().wrapping_add(more));
        self.store(word, count.get(), StoreOrder::Relaxed)
    }

    fn load(&self, word: u32, order: LoadOrder) -> Result<u32, AccessError> {
        self.region.load(self.offset.wrapping_add(word), order)
    }

    fn store(&self, word: u32, value: u32, order: StoreOrder) -> Result<(), AccessError> {
        self.region
            .store(self.offset.wrapping_add(word), value, order)
    }

    const fn index(&self, position: u32) -> u32 {
        position & (self.capacity - 1)
    }

    const fn ring_offset(&self, index: u32) -> u32 {
        self.offset.wrapping_add(BLOCK_BYTES).wrapping_add(index)
    }
}

/// `bytes` that begin at `position`: those in the rest of a word, whole words, those in the
/// beginning of a word.
fn split(position: u32, bytes: &[u8]) -> (&[u8], &[u8], &[u8]) {
    let first = (position.wrapping_neg() as usize % 4).min(bytes.len());
    let (first, rest) = bytes.split_at_checked(first).unwrap_or((bytes, &[]));
    let (middle, last) = rest
        .split_at_checked(rest.len() / 4 * 4)
        .unwrap_or((rest, &[]));
    (first, middle, last)
}
