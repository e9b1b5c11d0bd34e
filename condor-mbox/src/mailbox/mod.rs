//! [`Mailbox`]: the mailbox of one processor.

mod join;
mod listen;
mod messenger;
mod pace;
mod peer;
mod request;
mod serve;
#[cfg(feature = "async")]
mod tasks;
mod vectors;
mod wait;

pub use messenger::{Call, Handler, MessageTicket, Messenger, PendingReply};
pub use vectors::VectorStatistics;
pub use wait::Waiting;

use crate::backend::Backend;
use crate::doorbell::{Doorbell as _, Evidence};
use crate::error::{MailboxError, MemoryObject};
use crate::id::{Processor, Vector};
use crate::layout::JOINING;
use crate::mail::Mail;
use crate::region::Region;
use crate::spin_lock::{Incarnations, LockOwner};
use crate::windows::Windows;
use peer::{Peer, Word};

/// The mailbox of one processor in a system of `N` processors: it sends messages, and runs handlers
/// for the messages that come.
///
/// `B` is the [`Backend`]: the machine. A mailbox is a [`Messenger`]; beyond that it joins the
/// system, has handlers, and knows its peers. Background, handlers and servo loops may make all
/// calls that take `&self`, each while others are in the middle of one. Dropping the mailbox leaves
/// the system.
///
/// ```
/// use std::time::Duration;
/// use condor_mbox::sim::SimSystem;
/// use condor_mbox::{Messenger, Processor, Vector};
///
/// const HOST: Processor = Processor(0);
/// const HAND: Processor = Processor(1);
/// const INCREMENT: Vector = Vector(3);
/// const SECOND: Duration = Duration::from_secs(1);
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let system = SimSystem::<2>::in_virtual_time(4096);
/// let mut hand = system.mailbox(HAND)?;
/// hand.set_vector(INCREMENT, &|call| call.data() + 1, "increment")?;
/// hand.join()?;
/// system.while_waiting(HAND, move || {
///     hand.serve(Duration::ZERO).expect("its memory is there");
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
/// | handler | everything in its [`Call`], whose waits end with the wait that serves it |
/// | interrupt | [`serve`](Messenger::serve), [`send`](Messenger::send) with a timeout of zero |
/// | servo loop | [`send`](Messenger::send) and [`begin`](Messenger::begin) with a timeout of zero, and [`MessageTicket::poll`] |
pub struct Mailbox<'v, B: Backend, const N: usize> {
    me: Processor,
    doorbell: B::Doorbell,
    exclusion: B::Exclusion,
    waiting: Waiting,
    handlers: [Option<Handler<'v>>; Vector::COUNT],
    peers: [Peer<B::Window, N>; N],
    /// Our own incarnation; 0 while we have not joined.
    incarnation: Word,
    /// Handlers in progress.
    depth: Word,
    /// Contexts that want the doorbell.
    waiters: Word,
    /// The peer after which the next look begins.
    turn: Word,
    /// The peer that was served last.
    last: Word,
    beats: Word,
    /// Requests that have been served.
    served: Word,
    /// Whether `waiters` counts one that never ends, because rings are always wanted.
    always: bool,
    listening: listen::Listening<N>,
    /// The handler of the messages that it hears.
    listener: Option<Handler<'v>>,
    #[cfg(feature = "async")]
    tasks: tasks::Tasks,
}

/// The state of another processor, as far as this mailbox knows it at this moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PeerState {
    /// The processor has never joined, or has left.
    Absent,
    /// The processor is beginning a new incarnation.
    Joining,
    /// The processor has joined, and has not been seen to die.
    Up {
        /// The processor's present incarnation: a number that changes each time it joins.
        incarnation: u32,
        /// True if both sides have acknowledged each other, so that messages pass.
        connected: bool,
    },
    /// The processor joined, and its program ended without leaving.
    Dead {
        /// The incarnation that has ended.
        incarnation: u32,
    },
}

impl<B: Backend, const N: usize> Mailbox<'_, B, N> {
    /// Returns the doorbell that was passed to [`new`](Self::new).
    #[must_use]
    pub const fn doorbell(&self) -> &B::Doorbell {
        &self.doorbell
    }

    /// Returns the windows of `processor`: its `mail` and its `data`.
    ///
    /// # Errors
    /// [`MailboxError::NoSuchProcessor`] if no processor has the number.
    pub fn windows(&self, processor: Processor) -> Result<&Windows<B::Window>, MailboxError> {
        Ok(&self.peer(processor)?.windows)
    }

    /// Returns the state of `processor`, as far as it is known.
    ///
    /// # Errors
    /// [`MailboxError::NoSuchProcessor`] if no processor has the number; [`MailboxError::Window`] if its memory is
    /// gone.
    pub fn peer_state(&self, processor: Processor) -> Result<PeerState, MailboxError> {
        let peer = self.peer(processor)?;
        Ok(match peer.load_present()? {
            0 => PeerState::Absent,
            incarnation if self.doorbell.evidence(processor) == Evidence::Dead => {
                PeerState::Dead { incarnation }
            }
            JOINING => PeerState::Joining,
            incarnation => PeerState::Up {
                incarnation,
                connected: self.is_connected(peer),
            },
        })
    }

    /// Returns the users' region of the `data` of `processor`, the part that is for programs.
    /// Offsets count from the beginning of the region.
    ///
    /// # Errors
    /// [`MailboxError::NoSuchProcessor`] if no processor has the number; [`MailboxError::Window`] if the window is
    /// too small.
    pub fn region(&self, processor: Processor) -> Result<Region<&B::Window>, MailboxError> {
        Region::users(&self.windows(processor)?.data).map_err(|error| MailboxError::Window {
            processor,
            object: MemoryObject::Data,
            kind: error.kind,
        })
    }

    /// Returns this processor in its present incarnation, which is the value that it passes to a
    /// [`SpinLock`](crate::SpinLock) to become its owner.
    ///
    /// # Errors
    /// [`MailboxError::NotJoined`] if this mailbox has not joined.
    pub fn owner(&self) -> Result<LockOwner, MailboxError> {
        self.check_joined()?;
        LockOwner::new(self.me, self.incarnation.get())
    }

    #[inline(always)]
    fn check_joined(&self) -> Result<(), MailboxError> {
        if self.incarnation.get() == 0 {
            return Err(MailboxError::NotJoined { number: self.me });
        }
        Ok(())
    }

    #[cold]
    fn no_such(number: Processor) -> MailboxError {
        MailboxError::NoSuchProcessor {
            number,
            processors: N as u8,
        }
    }

    #[inline(always)]
    fn peer(&self, number: Processor) -> Result<&Peer<B::Window, N>, MailboxError> {
        self.peers
            .get(number.index())
            .ok_or_else(|| Self::no_such(number))
    }

    #[inline(always)]
    fn own(&self) -> Result<Mail<'_, B::Window, N>, MailboxError> {
        Ok(self.peer(self.me)?.mail())
    }
}

/// Learns which incarnations have ended from the peers' own words and from the platform.
impl<B: Backend, const N: usize> Incarnations for Mailbox<'_, B, N> {
    fn is_current(&self, owner: LockOwner) -> bool {
        let Some(Ok(peer)) = owner.processor().map(|number| self.peer(number)) else {
            return false;
        };
        // Memory that is gone does not show that the program is.
        match peer.load_present() {
            Ok(present) if !owner.is_incarnation(present) => false,
            _ => self.doorbell.evidence(peer.number) != Evidence::Dead,
        }
    }
}
