//! [`Mailbox`]: one processor's end of the message system.

mod call;
mod join;
mod link;
mod listen;
mod pair;
mod send;
mod serve;
mod vectors;
mod wait;

pub use call::{Call, Handler, Message, Messenger, Pending, Ticket};
pub use link::Link;
pub use vectors::VectorStatistics;
pub use wait::Waiting;

use crate::doorbell::{Doorbell, Evidence};
use crate::error::{Error, Object};
use crate::exclusion::Exclusion;
use crate::id::{Processor, Vector};
use crate::layout::{JOINING, header};
use crate::mail::Mail;
use crate::region::Region;
use crate::spin_lock::{Lives, Owner};
use crate::window::{LoadOrder, MemoryWindow};
use crate::windows::Windows;
use pair::{Pair, Word};

/// How many handlers may be in progress on one processor, each interrupted by the next.
pub const MAX_DEPTH: u32 = if cfg!(condor_loom) { 2 } else { 8 };

/// One processor's mailbox in a system of `N`.
///
/// `W` is the [`MemoryWindow`], `D` the [`Doorbell`], `X` the [`Exclusion`] between the contexts
/// of this processor. All calls take `&self`: background, handlers and servo loops may each be in
/// the middle of one. Dropping the mailbox leaves the system.
///
/// ```
/// use std::time::Duration;
/// use condor_mbox::sim::System;
/// use condor_mbox::{Processor, Vector};
///
/// const HOST: Processor = Processor(0);
/// const HAND: Processor = Processor(1);
/// const INCREMENT: Vector = Vector(3);
/// const SECOND: Duration = Duration::from_secs(1);
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let system = System::<2>::in_virtual_time(4096);
/// let mut hand = system.mailbox(HAND)?;
/// hand.set_vector(INCREMENT, &|call| call.data() + 1, "increment")?;
/// hand.join()?;
/// system.while_waiting(HAND, move || {
///     hand.service(SECOND).expect("its memory is there");
/// });
///
/// let mut host = system.mailbox(HOST)?;
/// host.join()?;
/// host.send(HAND, INCREMENT, 1, SECOND)?;
/// assert_eq!(host.send_with_reply(HAND, INCREMENT, 41, SECOND)?, 42);
///
/// let statistics = host.vector_statistics(HAND, INCREMENT)?;
/// assert_eq!((statistics.name(), statistics.handled), ("increment", 2));
/// # Ok(())
/// # }
/// ```
///
/// # Which call for which context
///
/// | context | may call |
/// |---|---|
/// | background | everything |
/// | handler | everything, through its [`Call`], which carries the deadline of whom it serves |
/// | interrupt | [`service`](Self::service), [`try_send`](Self::try_send) |
/// | servo loop | [`try_send`](Self::try_send), [`begin`](Self::begin) and [`Ticket::poll`], which neither wait nor serve |
pub struct Mailbox<'v, W: MemoryWindow, D: Doorbell, X: Exclusion, const N: usize> {
    me: Processor,
    windows: [Windows<W>; N],
    doorbell: D,
    exclusion: X,
    waiting: Waiting,
    handlers: [Option<Handler<'v>>; Vector::COUNT],
    pairs: [Pair; N],
    /// Our own life; 0 while we have not joined.
    life: Word,
    /// Handlers in progress.
    depth: Word,
    /// Contexts that want the doorbell.
    waiters: Word,
    /// Whom the next look begins with.
    turn: Word,
    beats: Word,
    /// Requests that have been served.
    served: Word,
    /// Whether one of `waiters` is there for good.
    always: bool,
    listening: listen::Listening<N>,
}

/// What is known of another processor at this moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PeerState {
    /// It has never joined, or has left.
    Absent,
    /// It is beginning a new life.
    Joining,
    /// It has joined, and has not been seen to die.
    Up {
        /// Its life, which differs from that of every former program on this number.
        life: u32,
        /// Both sides have acknowledged each other: messages pass.
        connected: bool,
    },
    /// It joined, and its program ended without leaving.
    Dead {
        /// The life that ended.
        life: u32,
    },
}

/// A peer whose number has been checked.
struct Peer<'m, W, const N: usize> {
    number: Processor,
    mail: Mail<'m, W, N>,
    windows: &'m Windows<W>,
    pair: &'m Pair,
}

impl<W: MemoryWindow, D: Doorbell, X: Exclusion, const N: usize> Mailbox<'_, W, D, X, N> {
    /// The mailbox's own number.
    #[must_use]
    pub const fn number(&self) -> Processor {
        self.me
    }

    /// The doorbell that was given at the beginning.
    #[must_use]
    pub const fn doorbell(&self) -> &D {
        &self.doorbell
    }

    /// The windows of a processor.
    ///
    /// # Errors
    /// [`Error::NoSuchProcessor`].
    pub fn windows(&self, processor: Processor) -> Result<&Windows<W>, Error> {
        self.windows
            .get(processor.index())
            .ok_or_else(|| Self::no_such(processor))
    }

    /// What is known of `processor`.
    ///
    /// # Errors
    /// [`Error::NoSuchProcessor`]; [`Error::Window`] if its memory is gone.
    pub fn peer_state(&self, processor: Processor) -> Result<PeerState, Error> {
        let peer = self.peer(processor)?;
        // Acquire: pairs with the Release store of the life in `join`.
        Ok(match peer.mail.load(header::LIFE, LoadOrder::Acquire)? {
            0 => PeerState::Absent,
            life if self.doorbell.evidence(processor) == Evidence::Dead => PeerState::Dead { life },
            JOINING => PeerState::Joining,
            life => PeerState::Up {
                life,
                connected: self.is_connected(&peer)?,
            },
        })
    }

    /// The users' part of a processor's `data`; offsets count from its beginning.
    ///
    /// # Errors
    /// [`Error::NoSuchProcessor`]; [`Error::Window`] if the window is too small.
    pub fn region(&self, processor: Processor) -> Result<Region<&W>, Error> {
        Region::users(&self.windows(processor)?.data).map_err(|error| Error::Window {
            processor,
            object: Object::Data,
            kind: error.kind,
        })
    }

    /// This processor in its present life, as the owner of a [`SpinLock`](crate::SpinLock).
    ///
    /// # Errors
    /// [`Error::NotJoined`].
    pub fn owner(&self) -> Result<Owner, Error> {
        match self.life.get() {
            0 => Err(Error::NotJoined { number: self.me }),
            life => Owner::new(self.me, life),
        }
    }

    #[cold]
    fn no_such(number: Processor) -> Error {
        Error::NoSuchProcessor {
            number,
            processors: N as u8,
        }
    }

    #[inline(always)]
    fn peer(&self, number: Processor) -> Result<Peer<'_, W, N>, Error> {
        match (
            self.windows.get(number.index()),
            self.pairs.get(number.index()),
        ) {
            (Some(windows), Some(pair)) => Ok(Peer {
                number,
                mail: Mail::new(&windows.mail, number),
                windows,
                pair,
            }),
            _ => Err(Self::no_such(number)),
        }
    }

    #[inline(always)]
    fn own(&self) -> Result<Mail<'_, W, N>, Error> {
        self.peer(self.me).map(|peer| peer.mail)
    }

    #[inline(always)]
    fn peers(&self) -> impl Iterator<Item = Peer<'_, W, N>> {
        (0..N as u8).filter_map(|number| self.peer(Processor(number)).ok())
    }
}

/// Knows from the peers' own words, and from the platform, whose life is over.
impl<W: MemoryWindow, D: Doorbell, X: Exclusion, const N: usize> Lives for Mailbox<'_, W, D, X, N> {
    fn is_current(&self, owner: Owner) -> bool {
        let Some(Ok(peer)) = owner.processor().map(|number| self.peer(number)) else {
            return false;
        };
        // Acquire: pairs with the Release store of the life in `join`. Memory that is gone is no
        // evidence that the program is.
        match peer.mail.load(header::LIFE, LoadOrder::Acquire) {
            Ok(life) if !owner.is_life(life) => false,
            _ => self.doorbell.evidence(peer.number) != Evidence::Dead,
        }
    }
}

impl<W: MemoryWindow, const N: usize> Peer<'_, W, N> {
    /// Checks that the peer was built for this system.
    fn check_layout(&self) -> Result<(), Error> {
        let data_bytes = self.windows.data.size();
        self.mail.check_sizes(data_bytes)?;
        self.mail.check_layout(data_bytes)
    }

    /// Whether the peer lives, as far as its own `mail` says.
    fn has_joined(&self) -> Result<bool, Error> {
        Ok(!matches!(
            self.mail.load(header::LIFE, LoadOrder::Relaxed)?,
            0 | JOINING
        ))
    }
}
