//! Joining and leaving the system, and noticing that others did.

use super::peer::{Peer, Word};
use super::{Mailbox, Waiting, listen, vectors};
use crate::backend::Backend;
use crate::error::MailboxError;
use crate::exclusion::Exclusion as _;
use crate::id::Processor;
use crate::layout::{self, JOINING, SLOTS, entry, header};
use crate::mail::{At, Mail};
use crate::sync::{Ordering, fence};
use crate::window::{LoadOrder, MemoryWindow, StoreOrder};
use crate::windows::Windows;

impl<B: Backend, const N: usize> Mailbox<'_, B, N> {
    /// Makes the mailbox of the processor `number`, without joining the system yet. The caller must
    /// be the only program with this number; on Linux, a claim ensures this.
    ///
    /// * `windows`: the memory of all processors; the index is the processor's number. It must hold
    ///   zeros, or what earlier programs left behind.
    /// * `doorbell`: the doorbell of this processor.
    /// * `exclusion`: the critical sections of this processor.
    ///
    /// Set the vectors next, and then [`join`](Self::join).
    ///
    /// # Errors
    /// [`MailboxError::NoSuchProcessor`] if `number` is too large; [`MailboxError::Layout`] if the
    /// memory belongs to something else, was laid out by another version or for another system, or
    /// some `mail` is too small; [`MailboxError::Window`] if the memory cannot be accessed.
    pub fn new(
        number: Processor,
        windows: [Windows<B::Window>; N],
        doorbell: B::Doorbell,
        exclusion: B::Exclusion,
    ) -> Result<Self, MailboxError> {
        const {
            assert!(
                N >= 1 && N <= Processor::MAX_COUNT,
                "a system has 1 to 32 processors"
            );
        };
        let this = Self {
            me: number,
            doorbell,
            exclusion,
            waiting: Waiting::default(),
            handlers: [None; layout::VECTORS],
            peers: each(number, windows)?,
            incarnation: Word::new(0),
            depth: Word::new(0),
            waiters: Word::new(0),
            turn: Word::new(0),
            last: Word::new(0),
            beats: Word::new(0),
            served: Word::new(0),
            always: false,
            listening: listen::Listening::new(),
            listener: None,
            #[cfg(feature = "async")]
            tasks: super::tasks::Tasks::new(),
        };
        let data_bytes = this.peer(number)?.windows.data.size();
        let own = this.own()?;
        own.check_sizes(data_bytes)?;
        if own.load(At::header(header::MAGIC), LoadOrder::Acquire)? == 0 {
            own.format(data_bytes)?;
        } else {
            own.check_layout(data_bytes)?;
        }
        // From here on nobody believes the former incarnation.
        own.store(
            At::header(header::INCARNATION),
            JOINING,
            StoreOrder::Release,
        )?;
        vectors::clear(&own)?;
        Ok(this)
    }

    /// Joins the system: from now on messages arrive. The mailbox gets a new incarnation, a number
    /// by which peers see that the processor has joined anew.
    ///
    /// # Errors
    /// [`MailboxError::Window`] if this mailbox's own memory cannot be accessed.
    pub fn join(&mut self) -> Result<(), MailboxError> {
        let own = self.own()?;
        own.store(
            At::header(header::INCARNATION),
            JOINING,
            StoreOrder::Release,
        )?;
        // Pairs with the Acquire load in `refresh_taken`: whoever sees a count that was reset
        // below sees that the former incarnation is over.
        fence(Ordering::Release);
        let last = own.load(At::header(header::LAST_INCARNATION), LoadOrder::Relaxed)?;
        let incarnation = self.unknown_incarnation(last);
        own.store(
            At::header(header::LAST_INCARNATION),
            incarnation,
            StoreOrder::Relaxed,
        )?;
        self.clear(&own)?;
        for peer in &self.peers {
            peer.begin(0, 0, 0);
        }
        let to_self = layout::epoch(incarnation, incarnation);
        self.peer(self.me)?.begin(incarnation, to_self, to_self);
        own.store(
            self.peer(self.me)?.ours.acknowledged(),
            incarnation,
            StoreOrder::Relaxed,
        )?;
        self.incarnation.set(incarnation);
        // Release: whoever sees this incarnation sees empty rings. Pairs with the Acquire load in
        // `Peer::present`.
        own.store(
            At::header(header::INCARNATION),
            incarnation,
            StoreOrder::Release,
        )?;
        self.notify_all();
        Ok(())
    }

    /// Leaves the system; the mailbox can [`join`](Self::join) it again.
    ///
    /// Calls to this processor that it has not answered end with [`MailboxError::PeerLeft`] at
    /// their senders. Listening to another number ends.
    ///
    /// # Errors
    /// [`MailboxError::Window`] if this mailbox's own memory cannot be accessed.
    pub fn leave(&mut self) -> Result<(), MailboxError> {
        self.incarnation.set(0);
        let own = self.own()?;
        own.store(At::header(header::INCARNATION), 0, StoreOrder::Release)?;
        self.stop_hearing()?;
        self.notify_all();
        Ok(())
    }

    /// Marks `processor`, which has been stopped, as a processor that has left the system.
    /// `windows` are those of this processor.
    ///
    /// A host calls this after it has reset `processor`. No other program may write the processor's
    /// `mail`, and the host may do so only while the processor does not run.
    ///
    /// # Errors
    /// [`MailboxError::Layout`] if no program has ever joined with this number;
    /// [`MailboxError::Window`] if the memory cannot be accessed.
    pub fn declare_stopped(
        processor: Processor,
        windows: &Windows<B::Window>,
    ) -> Result<(), MailboxError> {
        let mail = Mail::<_, N>::new(&windows.mail, &processor);
        mail.check_sizes(windows.data.size())?;
        mail.check_layout(windows.data.size())?;
        mail.store(At::header(header::INCARNATION), 0, StoreOrder::Release)
    }

    /// An incarnation after `last` in which no peer believes us to be.
    ///
    /// `last` alone is not enough: a program that wrote anything into its `mail`, or memory that
    /// was cleared, may have left a former one there.
    fn unknown_incarnation(&self, last: u32) -> u32 {
        // Read once: who writes arbitrary words here can only make us skip a number. Memory that
        // is gone believes nothing.
        let known = self.peers.each_ref().map(|peer| {
            peer.mail()
                .look(peer.theirs.acknowledged(), LoadOrder::Relaxed)
        });
        let mut incarnation = next_incarnation(last);
        // Each of the known ones is met at most once.
        for _ in 0..N {
            if known.contains(&incarnation) {
                incarnation = next_incarnation(incarnation);
            }
        }
        incarnation
    }

    /// Empties every ring and cell of our own `mail`.
    fn clear(&self, own: &Mail<'_, B::Window, N>) -> Result<(), MailboxError> {
        let clear = |at| own.store(at, 0, StoreOrder::Relaxed);
        for peer in &self.peers {
            for index in 0..SLOTS {
                for at in [peer.ours.slot(index), peer.ours.cell(index)] {
                    clear(at.word(entry::EPOCH))?;
                    clear(at.word(entry::SEQUENCE))?;
                }
            }
            clear(peer.ours.acknowledged())?;
            clear(peer.ours.taken())?;
            clear(At::heard_epoch(peer.number))?;
        }
        clear(At::header(header::LISTENERS))?;
        let notify = u32::from(self.waiters.get() > 0);
        own.store(At::header(header::NOTIFY), notify, StoreOrder::Relaxed)?;
        // Pairs with the Acquire loads of `Mail::get`: whoever read a word of a later entry finds
        // the sequence number spoiled.
        fence(Ordering::Release);
        Ok(())
    }

    /// Notices that `peer` began or ended an incarnation, and acknowledges it.
    #[cold]
    #[inline(never)]
    pub(super) fn notice(&self, peer: &Peer<B::Window, N>) -> Result<(), MailboxError> {
        let present = peer.load_present()?;
        if peer.number == self.me
            || self.incarnation.get() == 0
            || (matches!(present, 0 | JOINING) && peer.incarnation.get() == 0)
        {
            return Ok(());
        }
        let own = self.own()?;
        self.exclusion.with(|| self.acknowledge(peer, &own))?;
        self.notify(peer.mail());
        Ok(())
    }

    fn acknowledge(
        &self,
        peer: &Peer<B::Window, N>,
        own: &Mail<'_, B::Window, N>,
    ) -> Result<(), MailboxError> {
        let present = peer.load_present()?;
        if present == peer.incarnation.get() {
            return Ok(());
        }
        let others =
            own.load(At::header(header::LISTENERS), LoadOrder::Relaxed)? & !(1 << peer.number.0);
        own.store(At::header(header::LISTENERS), others, StoreOrder::Relaxed)?;
        peer.end();
        if matches!(present, 0 | JOINING) {
            return Ok(());
        }
        peer.check_layout()?;
        let ours = self.incarnation.get();
        peer.begin(
            present,
            layout::epoch(ours, present),
            layout::epoch(present, ours),
        );
        // A peer that comes back to the number of a former incarnation must not find what was meant
        // for that one; nobody is in epoch 0.
        for index in 0..SLOTS {
            for at in [peer.ours.slot(index), peer.ours.cell(index)] {
                own.store(at.word(entry::EPOCH), 0, StoreOrder::Relaxed)?;
            }
        }
        own.store(peer.ours.taken(), 0, StoreOrder::Relaxed)?;
        // Release: whoever sees the acknowledgement sees the count reset. Pairs with the Acquire
        // load in `is_connected`.
        own.store(peer.ours.acknowledged(), present, StoreOrder::Release)
    }

    /// Returns true if both sides have acknowledged each other's present incarnation.
    pub(super) fn is_connected(&self, peer: &Peer<B::Window, N>) -> bool {
        if peer.connected.get() != 0 {
            return true;
        }
        if peer.incarnation.get() == 0 || self.incarnation.get() == 0 {
            return false;
        }
        // Acquire: pairs with the Release store in `acknowledge`.
        peer.mail()
            .look(peer.theirs.acknowledged(), LoadOrder::Acquire)
            == self.incarnation.get()
    }

    /// Rings everybody who wants to hear of a beginning or an end.
    fn notify_all(&self) {
        for peer in self.peers.iter().filter(|peer| peer.number != self.me) {
            self.notify(peer.mail());
        }
    }
}

/// The incarnation after `last`; 0 and [`JOINING`] are none.
const fn next_incarnation(last: u32) -> u32 {
    let next = last.wrapping_add(1);
    if next == 0 || next == JOINING {
        1
    } else {
        next
    }
}

/// A peer for the windows of each number.
fn each<W: MemoryWindow, const N: usize>(
    me: Processor,
    windows: [Windows<W>; N],
) -> Result<[Peer<W, N>; N], MailboxError> {
    for (number, Windows { mail, .. }) in (0..).map(Processor).zip(&windows) {
        Mail::<_, N>::new(mail, &number).check_size()?;
    }
    let mut number = 0;
    Ok(windows.map(|windows| {
        // SAFETY: it is large enough, as was seen above.
        let peer = unsafe { Peer::new(me, Processor(number), windows) };
        number = number.wrapping_add(1);
        peer
    }))
}

impl<B: Backend, const N: usize> Drop for Mailbox<'_, B, N> {
    fn drop(&mut self) {
        // There is nobody to tell that the memory is gone.
        let _ = self.leave();
    }
}
