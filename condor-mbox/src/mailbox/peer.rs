//! [`Peer`]: a processor of the system, and what a mailbox remembers of it in its own memory.

use crate::error::MailboxError;
use crate::id::Processor;
use crate::layout::{JOINING, SLOTS, header};
use crate::mail::{At, Entry, Mail, Pair};
use crate::sync::{AtomicU32, Ordering::Relaxed};
use crate::window::{LoadOrder, MemoryWindow};
use crate::windows::Windows;

/// One word of private memory. Written only inside a section; a look outside may be late.
pub(super) struct Word(AtomicU32);

impl Word {
    pub(super) fn new(value: u32) -> Self {
        Self(AtomicU32::new(value))
    }

    #[inline(always)]
    pub(super) fn get(&self) -> u32 {
        self.0.load(Relaxed)
    }

    #[inline(always)]
    pub(super) fn set(&self, value: u32) {
        self.0.store(value, Relaxed);
    }
}

/// A processor of the system, with the cursors of the two rings between it and this one.
pub(super) struct Peer<W, const N: usize> {
    pub(super) number: Processor,
    pub(super) windows: Windows<W>,
    /// The place where our pair with the peer begins in our `mail`.
    pub(super) ours: Pair<N>,
    /// The place where its pair with us begins in its `mail`.
    pub(super) theirs: Pair<N>,
    /// The incarnation of the peer that everything below belongs to; 0 while it has none.
    pub(super) incarnation: Word,
    /// Not 0 once the peer has acknowledged our incarnation.
    pub(super) connected: Word,
    /// Epoch of requests from here to the peer.
    pub(super) epoch_out: Word,
    /// Epoch of requests from the peer to here; 0 if there never were any.
    pub(super) epoch_in: Word,
    /// Sequence number of the latest request to the peer.
    pub(super) head: Word,
    /// Sequence number of the latest of those requests that is known to have been taken.
    pub(super) taken: Word,
    /// Sequence number of the latest request that was taken from the peer.
    tail: Word,
    /// Bit per reply cell: some call owns it.
    pub(super) busy: Word,
    /// Bit per reply cell: its owner gave up, the reply is still to come.
    pub(super) abandoned: Word,
    /// The request that owns each reply cell.
    pub(super) owner: [Word; SLOTS as usize],
    /// Bit per listener of the peer that is not waited for, because it fell behind.
    pub(super) lagging: Word,
}

impl<W: MemoryWindow, const N: usize> Peer<W, N> {
    /// The peer `number` of `me`.
    ///
    /// # Safety
    /// [`Mail::check_size`] has found its `mail` large enough.
    pub(super) unsafe fn new(me: Processor, number: Processor, windows: Windows<W>) -> Self {
        let zero = || Word::new(0);
        Self {
            number,
            windows,
            ours: Pair::of(number),
            theirs: Pair::of(me),
            incarnation: zero(),
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

    #[inline(always)]
    pub(super) fn mail(&self) -> Mail<'_, W, N> {
        // SAFETY: as `new`'s caller has found.
        unsafe { Mail::large_enough(&self.windows.mail, &self.number) }
    }

    /// The peer's present incarnation, by its own word; 0 also if its memory is gone.
    #[inline(always)]
    pub(super) fn present(&self) -> u32 {
        self.mail().present()
    }

    /// The same, with an error if its memory is gone.
    pub(super) fn load_present(&self) -> Result<u32, MailboxError> {
        self.mail()
            .load(At::header(header::INCARNATION), LoadOrder::Acquire)
    }

    /// Checks that the peer was built for this system.
    pub(super) fn check_layout(&self) -> Result<(), MailboxError> {
        let data_bytes = self.windows.data.size();
        self.mail().check_sizes(data_bytes)?;
        self.mail().check_layout(data_bytes)
    }

    /// Returns true if the peer has joined, as far as its own `mail` says.
    pub(super) fn has_joined(&self) -> bool {
        !matches!(self.present(), 0 | JOINING)
    }

    /// Returns true if the ring from the peer to here seems to hold a request.
    #[inline(always)]
    pub(super) fn has_request(&self) -> bool {
        // Nothing is taken in epoch 0, and most of a large system may never have joined.
        if self.epoch_in.get() == 0 {
            return false;
        }
        let next = self.tail.get().wrapping_add(1);
        self.mail().carries(self.theirs.slot(next), next)
    }

    /// Reads the next request from the peer, of whatever epoch.
    #[inline(always)]
    pub(super) fn next_request(&self) -> Option<(u32, Entry)> {
        let next = self.tail.get().wrapping_add(1);
        Some((next, self.mail().get(self.theirs.slot(next), next)?))
    }

    /// Notes that requests of the peer have been taken up to `tail`.
    #[inline(always)]
    pub(super) fn set_tail(&self, tail: u32) {
        self.tail.set(tail);
    }

    /// Forgets everything of the peer's former incarnation.
    pub(super) fn begin(&self, incarnation: u32, epoch_out: u32, epoch_in: u32) {
        for word in [
            &self.connected,
            &self.head,
            &self.taken,
            &self.busy,
            &self.abandoned,
            &self.lagging,
        ] {
            word.set(0);
        }
        self.set_tail(0);
        self.epoch_out.set(epoch_out);
        self.epoch_in.set(epoch_in);
        self.incarnation.set(incarnation);
    }

    /// The peer's incarnation is over: nothing goes to it any more, and what it had sent is still
    /// taken.
    pub(super) fn end(&self) {
        for word in [&self.incarnation, &self.connected, &self.epoch_out] {
            word.set(0);
        }
    }

    /// Frees reply cell `cell` of a call in the present epoch.
    #[inline(always)]
    pub(super) fn release(&self, cell: u32) {
        let kept = !(1 << (cell % SLOTS));
        self.busy.set(self.busy.get() & kept);
        self.abandoned.set(self.abandoned.get() & kept);
    }

    /// Notes that every request up to `sequence` has been taken.
    #[inline(always)]
    pub(super) fn advance(&self, sequence: u32) {
        if sequence.wrapping_sub(self.taken.get()) <= SLOTS {
            self.taken.set(sequence);
        }
    }
}
