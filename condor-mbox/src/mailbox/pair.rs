//! What a mailbox remembers of one peer, in its own memory.

use crate::layout::SLOTS;
use crate::sync::{AtomicU32, Ordering::Relaxed};

/// One word of private memory. Written only inside a section; a look outside may be late.
pub(crate) struct Word(AtomicU32);

impl Word {
    pub(crate) fn new(value: u32) -> Self {
        Self(AtomicU32::new(value))
    }

    #[inline(always)]
    pub(crate) fn get(&self) -> u32 {
        self.0.load(Relaxed)
    }

    #[inline(always)]
    pub(crate) fn set(&self, value: u32) {
        self.0.store(value, Relaxed);
    }
}

/// The cursors of the two rings between this processor and one peer.
pub(crate) struct Pair {
    /// The life of the peer that everything below belongs to; 0 while it has none.
    pub(crate) life: Word,
    /// Not 0 once the peer has acknowledged our life.
    pub(crate) connected: Word,
    /// Epoch of requests from here to the peer.
    pub(crate) epoch_out: Word,
    /// Epoch of requests from the peer to here; 0 if there never were any.
    pub(crate) epoch_in: Word,
    /// Sequence of the latest request to the peer.
    pub(crate) head: Word,
    /// Sequence of the latest of those requests that is known to have been taken.
    pub(crate) taken: Word,
    /// Sequence of the latest request that was taken from the peer.
    pub(crate) tail: Word,
    /// Bit per reply cell: some call owns it.
    pub(crate) busy: Word,
    /// Bit per reply cell: its owner gave up, the reply is still to come.
    pub(crate) abandoned: Word,
    /// The request that owns each reply cell.
    pub(crate) owner: [Word; SLOTS as usize],
    /// Bit per listener of the peer that is not waited for, because it fell behind.
    pub(crate) lagging: Word,
}

impl Pair {
    pub(crate) fn new() -> Self {
        let zero = || Word::new(0);
        Self {
            life: zero(),
            connected: zero(),
            epoch_out: zero(),
            epoch_in: zero(),
            head: zero(),
            taken: zero(),
            tail: zero(),
            busy: zero(),
            abandoned: zero(),
            owner: core::array::from_fn(|_| zero()),
            lagging: zero(),
        }
    }

    /// Forgets everything of the peer's former life.
    pub(crate) fn begin(&self, life: u32, epoch_out: u32, epoch_in: u32) {
        for word in [
            &self.connected,
            &self.head,
            &self.taken,
            &self.tail,
            &self.busy,
            &self.abandoned,
            &self.lagging,
        ] {
            word.set(0);
        }
        self.epoch_out.set(epoch_out);
        self.epoch_in.set(epoch_in);
        self.life.set(life);
    }

    /// The peer's life is over: nothing goes to it any more, and what it had sent is still taken.
    pub(crate) fn end(&self) {
        for word in [&self.life, &self.connected, &self.epoch_out] {
            word.set(0);
        }
    }

    /// Gives up reply cell `cell` of a call in epoch `epoch`, unless the epoch is over.
    #[inline]
    pub(crate) fn release(&self, cell: u32, epoch: u32) {
        if self.epoch_out.get() == epoch {
            let kept = !(1 << cell);
            self.busy.set(self.busy.get() & kept);
            self.abandoned.set(self.abandoned.get() & kept);
        }
    }

    /// Notes that every request up to `sequence` has been taken.
    #[inline]
    pub(crate) fn advance(&self, sequence: u32) {
        if sequence.wrapping_sub(self.taken.get()) <= SLOTS {
            self.taken.set(sequence);
        }
    }
}
