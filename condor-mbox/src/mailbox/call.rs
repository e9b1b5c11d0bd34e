//! What goes between a program and its mailbox: messages, calls and tickets.

use core::time::Duration;

use super::MAX_DEPTH;
use crate::error::Error;
use crate::id::{Processor, Vector};
use crate::time::Instant;

/// What runs when a message arrives for a vector (memo, section 3.3.1).
///
/// It is called again while it still runs, if it waits for a reply or is interrupted, hence `Fn`
/// and `Sync`. Its result is the reply, if the sender wants one. It is borrowed: a handler that is a
/// local variable is declared before its mailbox, so that it outlives it.
pub type Handler<'v> = &'v (dyn Fn(&Call<'_>) -> u32 + Sync);

/// A message to be sent: a vector of a processor, and one word.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Message {
    /// The receiver.
    pub to: Processor,
    /// Which of its handlers.
    pub vector: Vector,
    /// The word; long data is passed as its offset in a window.
    pub data: u32,
}

/// The sending half of a mailbox, whatever its backend.
///
/// Programs call the methods of the same purpose on [`Mailbox`](super::Mailbox) and [`Call`].
pub trait Messenger {
    /// The sender's own number.
    fn number(&self) -> Processor;

    /// As [`Mailbox::send`](super::Mailbox::send), at the latest at `deadline`.
    ///
    /// # Errors
    /// As there.
    fn send_before(
        &self,
        message: Message,
        timeout: Duration,
        deadline: Instant,
    ) -> Result<(), Error>;

    /// As [`Mailbox::send_with_reply`](super::Mailbox::send_with_reply), at the latest at `deadline`.
    ///
    /// # Errors
    /// As there.
    fn send_with_reply_before(
        &self,
        message: Message,
        timeout: Duration,
        deadline: Instant,
    ) -> Result<u32, Error> {
        let (pending, deadline) = self.open_before(message, timeout, deadline)?;
        let outcome = self.wait_before(&pending, timeout, deadline);
        if outcome.is_err() {
            self.abandon(&pending);
        }
        outcome
    }

    /// As [`open`](Self::open), waiting for a slot; gives also when the time is over, counted
    /// from the call if it had to wait, else as late as `deadline`.
    ///
    /// # Errors
    /// As [`Mailbox::send`](super::Mailbox::send).
    fn open_before(
        &self,
        message: Message,
        timeout: Duration,
        deadline: Instant,
    ) -> Result<(Pending, Instant), Error>;

    /// As [`Ticket::wait`], at the latest at `deadline`.
    ///
    /// # Errors
    /// As there.
    fn wait_before(
        &self,
        pending: &Pending,
        timeout: Duration,
        deadline: Instant,
    ) -> Result<u32, Error>;

    /// As [`Mailbox::try_send`](super::Mailbox::try_send).
    ///
    /// # Errors
    /// As there.
    fn post(&self, message: Message) -> Result<(), Error>;

    /// As [`Mailbox::begin`](super::Mailbox::begin), without the guard.
    ///
    /// # Errors
    /// As there.
    fn open(&self, message: Message) -> Result<Pending, Error>;

    /// The reply to `pending`, if it has come.
    ///
    /// # Errors
    /// As [`Ticket::poll`].
    fn look(&self, pending: &Pending) -> Result<Option<u32>, Error>;

    /// Gives up the reply to `pending`: it is dropped when it comes.
    fn abandon(&self, pending: &Pending);
}

/// A request whose reply has not come yet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pending {
    pub(super) to: Processor,
    pub(super) vector: Vector,
    pub(super) cell: u32,
    pub(super) sequence: u32,
    pub(super) epoch: u32,
    pub(super) life: u32,
}

/// A request in progress, for a loop that must not wait: look at it once a tick.
///
/// Dropping it gives up the reply; its slot is free again once the reply has come.
///
/// ```
/// # use std::time::Duration;
/// # use condor_mbox::sim::System;
/// # use condor_mbox::{Error, Processor, Vector};
/// # const HOST: Processor = Processor(0);
/// # const HAND: Processor = Processor(1);
/// # const INCREMENT: Vector = Vector(3);
/// # const SECOND: Duration = Duration::from_secs(1);
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// # let system = System::<2>::in_virtual_time(4096);
/// # let mut hand = system.mailbox(HAND)?;
/// # hand.set_vector(INCREMENT, &|call| call.data() + 1, "increment")?;
/// # hand.join()?;
/// # system.while_waiting(HAND, move || {
/// #     hand.service(SECOND).expect("its memory is there");
/// # });
/// # let mut host = system.mailbox(HOST)?;
/// # host.join()?;
/// // A servo loop does not look for peers: the background must have done so.
/// assert_eq!(host.begin(HAND, INCREMENT, 41).err(), Some(Error::NotConnected { to: HAND }));
/// host.serve(SECOND)?;
///
/// // In one tick of the loop ...
/// let mut ticket = host.begin(HAND, INCREMENT, 41)?;
/// assert_eq!(ticket.poll()?, None);
/// # host.serve(SECOND)?;
/// // ... and in a later one.
/// assert_eq!(ticket.poll()?, Some(42));
/// # Ok(())
/// # }
/// ```
#[must_use = "dropping a ticket gives up the reply"]
#[derive(Debug)]
pub struct Ticket<'m, M: Messenger + ?Sized> {
    messenger: &'m M,
    pending: Option<Pending>,
}

impl<'m, M: Messenger + ?Sized> Ticket<'m, M> {
    pub(super) fn begin(messenger: &'m M, message: Message) -> Result<Self, Error> {
        Ok(Self::of(messenger, messenger.open(message)?))
    }

    pub(crate) fn of(messenger: &'m M, pending: Pending) -> Self {
        Self {
            messenger,
            pending: Some(pending),
        }
    }

    /// Waits for the reply, serving meanwhile, for at most `timeout`.
    ///
    /// After [`Error::TimedOut`] or [`Error::Stalled`] the ticket goes on waiting for its reply.
    ///
    /// # Errors
    /// As [`Mailbox::send_with_reply`](super::Mailbox::send_with_reply). `None` if the reply was
    /// given before.
    pub fn wait(&mut self, timeout: Duration) -> Result<Option<u32>, Error> {
        self.wait_before(timeout, Instant::FOREVER)
    }

    pub(crate) fn wait_before(
        &mut self,
        timeout: Duration,
        deadline: Instant,
    ) -> Result<Option<u32>, Error> {
        let Some(pending) = &self.pending else {
            return Ok(None);
        };
        let outcome = self.messenger.wait_before(pending, timeout, deadline);
        if !matches!(outcome, Err(Error::TimedOut { .. } | Error::Stalled { .. })) {
            self.finish();
        }
        outcome.map(Some)
    }

    /// The reply, once it has come; `None` before, and again after it was given.
    ///
    /// # Errors
    /// As [`Mailbox::send_with_reply`](super::Mailbox::send_with_reply), except that there is no
    /// deadline. Only the memory is looked at: a death that left no trace there shows up as the
    /// peer's next life. After an error the ticket is spent.
    pub fn poll(&mut self) -> Result<Option<u32>, Error> {
        let Some(pending) = &self.pending else {
            return Ok(None);
        };
        let outcome = self.messenger.look(pending);
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

impl<M: Messenger + ?Sized> Drop for Ticket<'_, M> {
    fn drop(&mut self) {
        self.finish();
    }
}

/// A message that has arrived, as its handler sees it.
pub struct Call<'c> {
    pub(super) messenger: &'c dyn Messenger,
    pub(super) sender: Processor,
    pub(super) addressee: Processor,
    pub(super) vector: Vector,
    pub(super) data: u32,
    pub(super) depth: u32,
    pub(super) deadline: Instant,
}

impl Call<'_> {
    /// Who sent the message.
    #[must_use]
    pub const fn sender(&self) -> Processor {
        self.sender
    }

    /// Whom it was sent to: this processor, or the one it listens to.
    #[must_use]
    pub const fn addressee(&self) -> Processor {
        self.addressee
    }

    /// Which vector it was sent to.
    #[must_use]
    pub const fn vector(&self) -> Vector {
        self.vector
    }

    /// Its word.
    #[must_use]
    pub const fn data(&self) -> u32 {
        self.data
    }

    /// The mailbox that the message came to, for requests that outlast this call: what is begun here
    /// by [`Messenger::open`] can be looked at in a later one.
    #[must_use]
    pub const fn messenger(&self) -> &dyn Messenger {
        self.messenger
    }

    /// When the wait that serves this message ends: no nested call waits longer.
    #[must_use]
    pub const fn deadline(&self) -> Instant {
        self.deadline
    }

    /// Nested [`Mailbox::send`](super::Mailbox::send).
    ///
    /// # Errors
    /// As there.
    pub fn send(
        &self,
        to: Processor,
        vector: Vector,
        data: u32,
        timeout: Duration,
    ) -> Result<(), Error> {
        self.messenger
            .send_before(Message { to, vector, data }, timeout, self.deadline)
    }

    /// Nested [`Mailbox::send_with_reply`](super::Mailbox::send_with_reply).
    ///
    /// # Errors
    /// As there, and [`Error::TooDeep`] if this is the innermost handler that is allowed.
    pub fn send_with_reply(
        &self,
        to: Processor,
        vector: Vector,
        data: u32,
        timeout: Duration,
    ) -> Result<u32, Error> {
        if self.depth >= MAX_DEPTH {
            return Err(Error::TooDeep { depth: self.depth });
        }
        self.messenger
            .send_with_reply_before(Message { to, vector, data }, timeout, self.deadline)
    }

    /// [`Mailbox::try_send`](super::Mailbox::try_send) from within a handler.
    ///
    /// # Errors
    /// As there.
    pub fn try_send(&self, to: Processor, vector: Vector, data: u32) -> Result<(), Error> {
        self.messenger.post(Message { to, vector, data })
    }

    /// [`Mailbox::begin`](super::Mailbox::begin) from within a handler.
    ///
    /// # Errors
    /// As there.
    pub fn begin(
        &self,
        to: Processor,
        vector: Vector,
        data: u32,
    ) -> Result<Ticket<'_, dyn Messenger + '_>, Error> {
        Ticket::begin(self.messenger, Message { to, vector, data })
    }
}
