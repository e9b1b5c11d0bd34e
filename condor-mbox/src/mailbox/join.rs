//! Joining and leaving the system, and noticing that others did.

use super::pair::{Pair, Word};
use super::{Mailbox, Peer, Waiting, listen, vectors};
use crate::doorbell::Doorbell;
use crate::error::Error;
use crate::exclusion::Exclusion;
use crate::id::Processor;
use crate::layout::{self, JOINING, SLOTS, entry, header};
use crate::mail::Mail;
use crate::sync::{Ordering, fence};
use crate::window::{LoadOrder, MemoryWindow, StoreOrder};
use crate::windows::Windows;

impl<W: MemoryWindow, D: Doorbell, X: Exclusion, const N: usize> Mailbox<'_, W, D, X, N> {
    /// Takes over the windows of `number`, whose claim the caller holds, without joining yet.
    ///
    /// The memory must hold zeros, or what a former life of this number left behind. Set the
    /// vectors, then [`join`](Self::join).
    ///
    /// # Errors
    /// [`Error::NoSuchProcessor`]; [`Error::Layout`] if the memory belongs to something else or
    /// was laid out by another version or for another system; [`Error::Window`].
    pub fn new(
        number: Processor,
        windows: [Windows<W>; N],
        doorbell: D,
        exclusion: X,
    ) -> Result<Self, Error> {
        const {
            assert!(
                N >= 1 && N <= Processor::MAX_COUNT,
                "a system has 1 to 32 processors"
            );
        };
        let this = Self {
            me: number,
            windows,
            doorbell,
            exclusion,
            waiting: Waiting::default(),
            handlers: [None; layout::VECTORS],
            pairs: core::array::from_fn(|_| Pair::new()),
            life: Word::new(0),
            depth: Word::new(0),
            waiters: Word::new(0),
            turn: Word::new(0),
            beats: Word::new(0),
            served: Word::new(0),
            always: false,
            listening: listen::Listening::new(),
        };
        let own = this.peer(number)?;
        let data_bytes = own.windows.data.size();
        own.mail.check_sizes(data_bytes)?;
        if own.mail.load(header::MAGIC, LoadOrder::Acquire)? == 0 {
            own.mail.format(data_bytes)?;
        } else {
            own.mail.check_layout(data_bytes)?;
        }
        // From here on nobody believes the former life. Release: pairs with the Acquire loads of
        // the life; what follows must not be seen by who still believes it, see `clear`.
        own.mail.store(header::LIFE, JOINING, StoreOrder::Release)?;
        vectors::clear(&own.mail)?;
        Ok(this)
    }

    /// Begins a new life in the system: from now on messages arrive.
    ///
    /// # Errors
    /// [`Error::Window`].
    pub fn join(&mut self) -> Result<(), Error> {
        let own = self.own()?;
        own.store(header::LIFE, JOINING, StoreOrder::Release)?;
        let life = next_life(own.load(header::LAST_LIFE, LoadOrder::Relaxed)?);
        own.store(header::LAST_LIFE, life, StoreOrder::Relaxed)?;
        self.clear(&own)?;
        for pair in &self.pairs {
            pair.begin(0, 0, 0);
        }
        let to_self = layout::epoch(life, life);
        if let Some(pair) = self.pairs.get(self.me.index()) {
            pair.begin(life, to_self, to_self);
        }
        own.store(
            Mail::<W, N>::acknowledged(self.me),
            life,
            StoreOrder::Relaxed,
        )?;
        self.life.set(life);
        // Release: whoever sees this life sees empty rings. Pairs with the Acquire load in `notice`.
        own.store(header::LIFE, life, StoreOrder::Release)?;
        self.ring_all();
        Ok(())
    }

    /// Leaves the system; the mailbox can [`join`](Self::join) again.
    ///
    /// Calls that others have in progress here end with [`Error::PeerLeft`].
    ///
    /// # Errors
    /// [`Error::Window`].
    pub fn leave(&mut self) -> Result<(), Error> {
        self.life.set(0);
        self.own()?.store(header::LIFE, 0, StoreOrder::Release)?;
        self.ring_all();
        Ok(())
    }

    /// Says on behalf of a processor that has been stopped that it is gone.
    ///
    /// For the host that has just reset `processor`: nobody else may write its `mail`, and the
    /// host only while the processor does not run.
    ///
    /// # Errors
    /// [`Error::Layout`] if nothing has ever joined there; [`Error::Window`].
    pub fn declare_stopped(processor: Processor, windows: &Windows<W>) -> Result<(), Error> {
        let mail = Mail::<_, N>::new(&windows.mail, processor);
        mail.check_sizes(windows.data.size())?;
        mail.check_layout(windows.data.size())?;
        mail.store(header::LIFE, 0, StoreOrder::Release)
    }

    /// Empties every ring and cell of our own `mail`.
    fn clear(&self, own: &Mail<'_, W, N>) -> Result<(), Error> {
        for peer in self.peers() {
            for index in 0..SLOTS {
                for at in [
                    Mail::<W, N>::slot(peer.number, index),
                    Mail::<W, N>::cell(peer.number, index),
                ] {
                    own.store(at + entry::EPOCH, 0, StoreOrder::Relaxed)?;
                    own.store(at + entry::SEQUENCE, 0, StoreOrder::Relaxed)?;
                }
            }
            own.store(
                Mail::<W, N>::acknowledged(peer.number),
                0,
                StoreOrder::Relaxed,
            )?;
            // Release: who sees the count set back sees that our life is over. Pairs with the
            // Acquire load in `refresh_taken`.
            own.store(Mail::<W, N>::taken(peer.number), 0, StoreOrder::Release)?;
            own.store(
                layout::listen(u32::from(peer.number.0)),
                0,
                StoreOrder::Relaxed,
            )?;
        }
        own.store(header::LISTENERS, 0, StoreOrder::Relaxed)?;
        own.store(
            header::ATTENTION,
            u32::from(self.waiters.get() > 0),
            StoreOrder::Relaxed,
        )?;
        // Pairs with the Acquire fence of `Mail::get`: whoever read a word of a later entry finds
        // the sequence spoiled.
        fence(Ordering::Release);
        Ok(())
    }

    /// Looks whether `peer` began or ended a life, and acknowledges it.
    #[inline(always)]
    pub(super) fn notice(&self, peer: &Peer<'_, W, N>) -> Result<(), Error> {
        // Acquire: pairs with the Release store of the life in `join`.
        let life = peer.mail.load(header::LIFE, LoadOrder::Acquire)?;
        if life == peer.pair.life.get() {
            Ok(())
        } else {
            self.change_life(peer, life)
        }
    }

    #[cold]
    fn change_life(&self, peer: &Peer<'_, W, N>, life: u32) -> Result<(), Error> {
        if peer.number == self.me
            || self.life.get() == 0
            || (matches!(life, 0 | JOINING) && peer.pair.life.get() == 0)
        {
            return Ok(());
        }
        let own = self.own()?;
        self.exclusion.with(|| self.acknowledge(peer, &own))?;
        self.wake(peer)
    }

    fn acknowledge(&self, peer: &Peer<'_, W, N>, own: &Mail<'_, W, N>) -> Result<(), Error> {
        let life = peer.mail.load(header::LIFE, LoadOrder::Acquire)?;
        if life == peer.pair.life.get() {
            return Ok(());
        }
        let others = own.load(header::LISTENERS, LoadOrder::Relaxed)? & !(1 << peer.number.0);
        own.store(header::LISTENERS, others, StoreOrder::Relaxed)?;
        peer.pair.end();
        if matches!(life, 0 | JOINING) {
            return Ok(());
        }
        peer.check_layout()?;
        let ours = self.life.get();
        peer.pair
            .begin(life, layout::epoch(ours, life), layout::epoch(life, ours));
        // Release: as in `clear`.
        own.store(Mail::<W, N>::taken(peer.number), 0, StoreOrder::Release)?;
        // Release: whoever sees the acknowledgement sees the count reset. Pairs with the Acquire
        // load in `is_connected`.
        own.store(
            Mail::<W, N>::acknowledged(peer.number),
            life,
            StoreOrder::Release,
        )
    }

    /// Whether both sides have acknowledged each other's present life.
    #[inline(always)]
    pub(super) fn is_connected(&self, peer: &Peer<'_, W, N>) -> Result<bool, Error> {
        if peer.pair.connected.get() != 0 {
            return Ok(true);
        }
        if peer.pair.life.get() == 0 || self.life.get() == 0 {
            return Ok(false);
        }
        // Acquire: pairs with the Release store in `acknowledge`.
        let acknowledged = peer
            .mail
            .load(Mail::<W, N>::acknowledged(self.me), LoadOrder::Acquire)?;
        Ok(acknowledged == self.life.get())
    }

    /// Rings everybody who wants to hear of a beginning or an end.
    fn ring_all(&self) {
        for peer in self.peers().filter(|peer| peer.number != self.me) {
            // A peer whose memory is gone cannot be waiting for us.
            let _ = self.wake(&peer);
        }
    }
}

/// The life after `last`; 0 and [`JOINING`] are no lives.
const fn next_life(last: u32) -> u32 {
    let next = last.wrapping_add(1);
    if next == 0 || next == JOINING {
        1
    } else {
        next
    }
}

impl<W: MemoryWindow, D: Doorbell, X: Exclusion, const N: usize> Drop for Mailbox<'_, W, D, X, N> {
    fn drop(&mut self) {
        // There is nobody to tell that the memory is gone.
        let _ = self.leave();
    }
}
