//! [`Messenger`]: sending and serving messages, on any backend.

use core::cell::Cell;
use core::pin::Pin;
use core::task::{Context, Poll, Waker};
use core::time::Duration;

use crate::error::MailboxError;
use crate::id::{Processor, Vector};
use crate::time::Instant;

/// A handler: the function that runs when a message arrives for a vector (A.I. Memo 977, section
/// 3.3.1).
///
/// A handler may be called again while it still runs, if it waits for a reply or is interrupted;
/// hence it is `Fn` and `Sync`. Its result is the reply, if the sender wants one; [`Call::refuse`]
/// replies with an error code instead. The mailbox borrows it: declare a handler that is a local
/// variable before its mailbox, so that it outlives the mailbox.
pub type Handler<'v> = &'v (dyn Fn(&Call<'_>) -> u32 + Sync);

/// Sends messages, and runs handlers for the messages that come (*serves* them).
///
/// [`Mailbox`](super::Mailbox) implements it, and so does the [`Call`] of a handler. A library that
/// sends messages takes a `&dyn Messenger`, or is generic over it, and does not depend on a
/// backend.
///
/// Waits have a timeout and serve incoming requests meanwhile, on the same stack, so that two
/// processors may call each other. With a timeout of zero nothing waits and nothing is served;
/// servo loops and interrupts use this.
pub trait Messenger {
    /// Returns the number of this processor.
    fn number(&self) -> Processor;

    /// Returns the present instant.
    fn now(&self) -> Instant;

    /// Sends `data` to `vector` of `to`, which may be this processor, and does not wait for its
    /// handler (A.I. Memo 977, section 3.3.1).
    ///
    /// Waits for a free slot, or for the receiver to join, for at most `timeout`. Messages to one
    /// receiver are taken there in the order in which they were sent.
    ///
    /// # Errors
    /// [`MailboxError::NoSuchProcessor`] or [`MailboxError::NoSuchVector`] if a number is too large;
    /// [`MailboxError::NotJoined`] if this mailbox has not joined. After `timeout`: [`MailboxError::NoSlot`] if
    /// no slot is free, [`MailboxError::NotConnected`] if the receiver has not joined, [`MailboxError::Stalled`]
    /// if its heartbeat stood still. As soon as it is known: [`MailboxError::PeerDied`]. At once:
    /// [`MailboxError::Layout`] if the receiver belongs to another system, [`MailboxError::Protocol`] if it
    /// violates the protocol, [`MailboxError::Window`] if memory cannot be accessed. After an error the
    /// message was not sent.
    fn send(
        &self,
        to: Processor,
        vector: Vector,
        data: u32,
        timeout: Duration,
    ) -> Result<(), MailboxError>;

    /// Sends `data` to `vector` of `to`, and waits for the result of its handler for at most
    /// `timeout`.
    ///
    /// After the timeout the request may still run once, if it was sent; its reply is dropped.
    ///
    /// # Errors
    /// The errors of [`send`](Self::send); [`MailboxError::Refused`] with the handler's error code;
    /// [`MailboxError::NoHandler`] if the vector has none, [`MailboxError::HandlerFailed`] if it panicked;
    /// [`MailboxError::TimedOut`] or [`MailboxError::Stalled`] after `timeout`; [`MailboxError::PeerDied`],
    /// [`MailboxError::PeerLeft`] and [`MailboxError::PeerRestarted`] as soon as they are known;
    /// [`MailboxError::TooDeep`] if the caller is a handler at the greatest depth.
    fn send_with_reply(
        &self,
        to: Processor,
        vector: Vector,
        data: u32,
        timeout: Duration,
    ) -> Result<u32, MailboxError>;

    /// Sends `data` to `vector` of `to`, and returns a ticket for the reply. Waits for a free slot,
    /// or for the receiver to join, for at most `timeout`.
    ///
    /// # Errors
    /// Returns the errors of [`send`](Self::send) if the message was not sent. Errors of its handler come
    /// with the reply.
    fn begin(
        &self,
        to: Processor,
        vector: Vector,
        data: u32,
        timeout: Duration,
    ) -> Result<MessageTicket<'_>, MailboxError>;

    /// Serves the messages that have come, and returns their number.
    ///
    /// If none has come, this call waits until one has been served, for at most `timeout`; with a timeout of
    /// zero it does not wait. It serves at most as many messages of each sender as a ring has slots, so no
    /// sender can keep an interrupt busy for ever. If there are more, and rings are
    /// [always](super::Mailbox::ring_always) wanted, it rings this processor again.
    ///
    /// # Errors
    /// [`MailboxError::NotJoined`] if this mailbox has not joined; [`MailboxError::Window`] if its own memory
    /// cannot be accessed.
    fn serve(&self, timeout: Duration) -> Result<usize, MailboxError>;

    /// Serves as [`serve`](Self::serve) does, while the caller waits for an action of `whom`: for example until
    /// a file server comes back, or until a terminal has room. The call may end early where rings are certain
    /// ([`Doorbell::rings_always`](crate::Doorbell::rings_always)).
    ///
    /// # Errors
    /// [`MailboxError::NotJoined`] if this mailbox has not joined; [`MailboxError::Window`] if its own memory
    /// cannot be accessed.
    fn serve_for(&self, whom: Processor, timeout: Duration) -> Result<usize, MailboxError> {
        let _ = whom;
        self.serve(timeout)
    }

    /// Returns the reply to `pending` if it has come. Programs call [`MessageTicket::poll`] instead.
    ///
    /// # Errors
    /// Returns the errors of [`MessageTicket::poll`] if there will be no reply.
    fn poll_pending(&self, pending: &PendingReply) -> Result<Option<u32>, MailboxError>;

    /// Waits for the reply to `pending`. Programs call [`MessageTicket::wait`] instead.
    ///
    /// # Errors
    /// Returns the errors of [`MessageTicket::wait`] if no reply has come in time or none will come.
    fn wait_pending(&self, pending: &PendingReply, timeout: Duration) -> Result<u32, MailboxError>;

    /// Drops the reply to `pending`, now or when it comes.
    fn abandon(&self, pending: &PendingReply);

    /// Wakes `waker` when the next [`serve`](Self::serve) ends. Without the feature `async` this is
    /// not possible, and `waker` is woken at once.
    fn wake_after_serve(&self, waker: &Waker) {
        waker.wake_by_ref();
    }
}

/// A request whose reply has not come yet, without its messenger. [`MessageTicket::detach`] returns
/// it, and [`MessageTicket::attach`] makes a ticket of it again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PendingReply {
    pub(super) to: Processor,
    pub(super) vector: Vector,
    pub(super) cell: u8,
    pub(super) sequence: u32,
    pub(super) epoch: u32,
    pub(super) incarnation: u32,
}

/// A request in progress: poll it once a tick, wait for it, or await it. [`Messenger::begin`]
/// returns it.
///
/// Dropping the ticket gives up the reply; the slot of the request is free again once the reply has
/// come.
///
/// A ticket is a [`Future`], for programs whose tasks wait for other events, too. In such a program
/// the doorbell wakes a task that serves. With the feature `async`, `serve` then wakes the tasks
/// that await a reply; without it, those tasks are polled again and again.
///
/// ```
/// # use std::time::Duration;
/// # use condor_mbox::sim::SimSystem;
/// # use condor_mbox::{MailboxError, Messenger, Processor, Vector};
/// # const HOST: Processor = Processor(0);
/// # const HAND: Processor = Processor(1);
/// # const INCREMENT: Vector = Vector(3);
/// # const SECOND: Duration = Duration::from_secs(1);
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// # let system = SimSystem::<2>::in_virtual_time(4096);
/// # let mut hand = system.mailbox(HAND)?;
/// # hand.set_vector(INCREMENT, &|call| call.data() + 1, "increment")?;
/// # hand.join()?;
/// # system.while_waiting(HAND, move || {
/// #     hand.serve(Duration::ZERO).expect("its memory is there");
/// # });
/// # let mut host = system.mailbox(HOST)?;
/// # host.join()?;
/// host.wait_for_peer(HAND, None, SECOND)?; // in the background, before the loop begins
///
/// // In one tick of a servo loop ...
/// let mut ticket = host.begin(HAND, INCREMENT, 41, Duration::ZERO)?;
/// assert_eq!(ticket.poll()?, None);
/// # host.serve(SECOND)?;
/// // ... and in a later one.
/// assert_eq!(ticket.poll()?, Some(42));
/// # Ok(())
/// # }
/// ```
#[must_use = "dropping a ticket gives up the reply"]
pub struct MessageTicket<'m> {
    messenger: &'m dyn Messenger,
    pending: Option<PendingReply>,
}

impl<'m> MessageTicket<'m> {
    /// Makes a ticket again of the request `pending`, which `messenger` must have sent.
    pub fn attach(messenger: &'m dyn Messenger, pending: PendingReply) -> Self {
        Self {
            messenger,
            pending: Some(pending),
        }
    }

    /// Returns the request without its messenger, so that a handler, for example, can keep it for a
    /// later call. [`attach`](Self::attach) makes a ticket of it again. Returns `None` if the reply
    /// was returned before.
    ///
    /// Dropping the returned request does not give up the reply, so its slot stays in use.
    #[must_use]
    pub fn detach(mut self) -> Option<PendingReply> {
        self.pending.take()
    }

    /// Waits for the reply for at most `timeout`, and serves messages meanwhile. Returns `None` if
    /// the reply was returned before.
    ///
    /// After [`MailboxError::TimedOut`] or [`MailboxError::Stalled`] the ticket can still get its
    /// reply.
    ///
    /// # Errors
    /// Returns the errors of [`Messenger::send_with_reply`] if no reply has come in time, or none will come.
    pub fn wait(&mut self, timeout: Duration) -> Result<Option<u32>, MailboxError> {
        let Some(pending) = &self.pending else {
            return Ok(None);
        };
        let outcome = self.messenger.wait_pending(pending, timeout);
        if !matches!(
            outcome,
            Err(MailboxError::TimedOut { .. } | MailboxError::Stalled { .. })
        ) {
            self.finish();
        }
        outcome.map(Some)
    }

    /// Returns the reply if it has come, without waiting. Returns `None` if it has not come yet, or
    /// if it was returned before.
    ///
    /// # Errors
    /// The errors of [`Messenger::send_with_reply`], except timeouts. This call reads only shared
    /// memory. If a peer died without leaving a trace there, the error comes only when another
    /// program has joined with its number. After an error the ticket is used up.
    pub fn poll(&mut self) -> Result<Option<u32>, MailboxError> {
        let Some(pending) = &self.pending else {
            return Ok(None);
        };
        let outcome = self.messenger.poll_pending(pending);
        if !matches!(outcome, Ok(None)) {
            self.finish();
        }
        outcome
    }

    /// Nothing more is to come, or a slot whose peer is gone is given up.
    fn finish(&mut self) {
        if let Some(pending) = self.pending.take() {
            self.messenger.abandon(&pending);
        }
    }
}

/// Waits for the reply or an error; never completes if the reply was returned before.
impl Future for MessageTicket<'_> {
    type Output = Result<u32, MailboxError>;

    fn poll(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Self::Output> {
        // Before the look: a reply that comes after it is served after it.
        self.messenger.wake_after_serve(context.waker());
        match MessageTicket::poll(&mut self) {
            Ok(None) => Poll::Pending,
            Ok(Some(value)) => Poll::Ready(Ok(value)),
            Err(error) => Poll::Ready(Err(error)),
        }
    }
}

impl core::fmt::Debug for MessageTicket<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_tuple("Ticket").field(&self.pending).finish()
    }
}

impl Drop for MessageTicket<'_> {
    fn drop(&mut self) {
        self.finish();
    }
}

/// A message, as its handler gets it.
///
/// A `Call` is a [`Messenger`], through which the handler can send messages and wait. Such a wait
/// ends, at the latest, when the wait ends in which the handler runs: see
/// [`deadline`](Self::deadline).
pub struct Call<'c> {
    pub(super) messenger: &'c dyn Messenger,
    pub(super) sender: Processor,
    pub(super) incarnation: u32,
    pub(super) addressee: Processor,
    pub(super) vector: Vector,
    pub(super) data: u32,
    pub(super) depth: u32,
    pub(super) deadline: Instant,
    pub(super) refused: Cell<bool>,
}

impl Call<'_> {
    /// The greatest number of handlers that can be in progress on one processor at a time, each
    /// started while the one before it waits or is interrupted.
    pub const MAX_DEPTH: u32 = if cfg!(condor_loom) { 2 } else { 8 };

    /// Returns the processor that sent the message.
    #[must_use]
    pub const fn sender(&self) -> Processor {
        self.sender
    }

    /// Returns the incarnation of the sender in which it sent the message: a number that changes
    /// each time its program joins, as in [`PeerState::Up`](crate::PeerState::Up). It is 0 if that
    /// incarnation has ended since then.
    #[must_use]
    pub const fn sender_incarnation(&self) -> u32 {
        self.incarnation
    }

    /// Returns the processor to which the message was sent: this one, or the one to which this
    /// mailbox [listens](super::Mailbox::listen).
    #[must_use]
    pub const fn addressee(&self) -> Processor {
        self.addressee
    }

    /// Returns the vector to which the message was sent.
    #[must_use]
    pub const fn vector(&self) -> Vector {
        self.vector
    }

    /// Returns the 32-bit word that the message carries.
    #[must_use]
    pub const fn data(&self) -> u32 {
        self.data
    }

    /// Returns the instant at which the wait ends in which this handler runs. No wait of the
    /// handler through this `Call` lasts longer.
    #[must_use]
    pub const fn deadline(&self) -> Instant {
        self.deadline
    }

    /// Refuses the request: the handler's result becomes an error code, which the caller gets as
    /// [`MailboxError::Refused`]. Returns `code`, so this can be the handler's last expression.
    ///
    /// ```
    /// # use std::time::Duration;
    /// # use condor_mbox::sim::SimSystem;
    /// # use condor_mbox::{MailboxError, Messenger, Processor, Vector};
    /// # const HAND: Processor = Processor(0);
    /// # const HALVE: Vector = Vector(3);
    /// # let system = SimSystem::<1>::in_virtual_time(64);
    /// # let mut hand = system.mailbox(HAND)?;
    /// const ODD: u32 = 7;
    ///
    /// hand.set_vector(
    ///     HALVE,
    ///     &|call| match call.data() {
    ///         odd if odd % 2 == 1 => call.refuse(ODD),
    ///         even => even / 2,
    ///     },
    ///     "halve",
    /// )?;
    /// # hand.join()?;
    /// # let second = Duration::from_secs(1);
    /// assert_eq!(hand.send_with_reply(HAND, HALVE, 8, second), Ok(4));
    /// let refused = MailboxError::Refused { to: HAND, vector: HALVE, code: ODD };
    /// assert_eq!(hand.send_with_reply(HAND, HALVE, 9, second), Err(refused));
    /// # Ok::<(), MailboxError>(())
    /// ```
    pub fn refuse(&self, code: u32) -> u32 {
        self.refused.set(true);
        code
    }

    /// `timeout`, or what is left until the deadline.
    fn within(&self, timeout: Duration) -> Duration {
        if self.deadline == Instant::FOREVER || timeout.is_zero() {
            return timeout;
        }
        let left = self.deadline.ns_since(self.messenger.now());
        timeout.min(Duration::from_nanos(left))
    }
}

impl Messenger for Call<'_> {
    fn number(&self) -> Processor {
        self.messenger.number()
    }

    fn now(&self) -> Instant {
        self.messenger.now()
    }

    fn send(
        &self,
        to: Processor,
        vector: Vector,
        data: u32,
        timeout: Duration,
    ) -> Result<(), MailboxError> {
        let timeout = self.within(timeout);
        self.messenger.send(to, vector, data, timeout)
    }

    fn send_with_reply(
        &self,
        to: Processor,
        vector: Vector,
        data: u32,
        timeout: Duration,
    ) -> Result<u32, MailboxError> {
        if self.depth >= Self::MAX_DEPTH {
            return Err(MailboxError::TooDeep { depth: self.depth });
        }
        let timeout = self.within(timeout);
        self.messenger.send_with_reply(to, vector, data, timeout)
    }

    fn begin(
        &self,
        to: Processor,
        vector: Vector,
        data: u32,
        timeout: Duration,
    ) -> Result<MessageTicket<'_>, MailboxError> {
        let timeout = self.within(timeout);
        self.messenger.begin(to, vector, data, timeout)
    }

    fn serve(&self, timeout: Duration) -> Result<usize, MailboxError> {
        self.messenger.serve(self.within(timeout))
    }

    fn serve_for(&self, whom: Processor, timeout: Duration) -> Result<usize, MailboxError> {
        self.messenger.serve_for(whom, self.within(timeout))
    }

    fn poll_pending(&self, pending: &PendingReply) -> Result<Option<u32>, MailboxError> {
        self.messenger.poll_pending(pending)
    }

    fn wait_pending(&self, pending: &PendingReply, timeout: Duration) -> Result<u32, MailboxError> {
        let timeout = self.within(timeout);
        self.messenger.wait_pending(pending, timeout)
    }

    fn abandon(&self, pending: &PendingReply) {
        self.messenger.abandon(pending);
    }

    fn wake_after_serve(&self, waker: &Waker) {
        self.messenger.wake_after_serve(waker);
    }
}
