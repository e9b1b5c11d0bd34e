//! condor-mbox: calls with a reply to a handler that gives back what it got.
//!
//! Every call has a deadline, an epoch, a checked vector and a handler table, like any user's; the
//! windows and doorbells are those of the Linux backend. Its memory is a family of its own, fresh
//! for every round.

use std::time::Duration;

use condor_mbox::linux::{Mailbox, System};
use condor_mbox::{
    Call, CriticalSection, Exclusion, Messenger, Processor, SingleContext, Vector, Waiting,
};

use super::contestant::{Client, Contestant, Server, Setup};
use crate::Result;

const CLIENT: Processor = Processor(0);
const SERVER: Processor = Processor(1);

/// Deadline of every call.
const TIMEOUT: Duration = Duration::from_secs(5);

/// Opens mailboxes that spin and belong to one thread each.
pub(super) fn open_spinning<'m>(_: &Setup<'m>) -> Result<Box<dyn Contestant + 'm>> {
    open(Waiting::Spin, 0, SingleContext::new)
}

/// Opens mailboxes of a system of 16 that spin; the other 14 processors have not joined.
pub(super) fn open_spinning_of_16<'m>(_: &Setup<'m>) -> Result<Box<dyn Contestant + 'm>> {
    open_of::<_, 16>(Waiting::Spin, 0, SingleContext::new)
}

/// Opens mailboxes that spin and can be shared by threads.
pub(super) fn open_shared<'m>(_: &Setup<'m>) -> Result<Box<dyn Contestant + 'm>> {
    open(Waiting::Spin, 0, || CriticalSection)
}

/// Opens mailboxes that spin for a bounded time.
pub(super) fn open_bounded<'m>(_: &Setup<'m>) -> Result<Box<dyn Contestant + 'm>> {
    open(Waiting::default(), 0, SingleContext::new)
}

/// Opens mailboxes that sleep.
pub(super) fn open_blocking<'m>(_: &Setup<'m>) -> Result<Box<dyn Contestant + 'm>> {
    open(Waiting::Sleep, 0, SingleContext::new)
}

/// Opens mailboxes whose handlers call each other back `DEPTH` times before they reply.
pub(super) fn open_nested<'m, const DEPTH: u8>(_: &Setup<'m>) -> Result<Box<dyn Contestant + 'm>> {
    open(Waiting::Spin, DEPTH, SingleContext::new)
}

fn open<'m, X: Exclusion + 'm>(
    waiting: Waiting,
    depth: u8,
    exclusion: fn() -> X,
) -> Result<Box<dyn Contestant + 'm>> {
    open_of::<X, 2>(waiting, depth, exclusion)
}

fn open_of<'m, X: Exclusion + 'm, const N: usize>(
    waiting: Waiting,
    depth: u8,
    exclusion: fn() -> X,
) -> Result<Box<dyn Contestant + 'm>> {
    Ok(Box::new(Ours {
        system: System::<N>::family(0)?,
        waiting,
        depth,
        exclusion,
    }))
}

struct Ours<X, const N: usize> {
    system: System<N>,
    waiting: Waiting,
    /// How often a handler calls back: the number of the vector that is called.
    depth: u8,
    exclusion: fn() -> X,
}

impl<X: Exclusion, const N: usize> Ours<X, N> {
    /// Joins as `number`, in the process that calls.
    fn end(&self, number: Processor) -> Result<End<X, N>> {
        let claim = self.system.claim(number)?;
        let mut mailbox = claim.mailbox_with((self.exclusion)())?;
        mailbox.set_waiting(self.waiting);
        for vector in 0..=self.depth {
            mailbox.set_vector(Vector(vector), &answer, "answer")?;
        }
        mailbox.join()?;
        Ok(End {
            mailbox,
            depth: self.depth,
        })
    }
}

/// Gives back what came, after a call to the sender's next lower vector if there is one.
fn answer(call: &Call<'_>) -> u32 {
    match call.vector().0.checked_sub(1) {
        None => call.data(),
        // Zero is never the right answer, so that the error is found.
        Some(lower) => call
            .send_with_reply(call.sender(), Vector(lower), call.data(), TIMEOUT)
            .unwrap_or(0),
    }
}

impl<X: Exclusion, const N: usize> Contestant for Ours<X, N> {
    fn client<'a>(self: Box<Self>) -> Result<Box<dyn Client + 'a>>
    where
        Self: 'a,
    {
        Ok(Box::new(self.end(CLIENT)?))
    }

    fn server<'a>(self: Box<Self>) -> Result<Box<dyn Server + 'a>>
    where
        Self: 'a,
    {
        Ok(Box::new(self.end(SERVER)?))
    }
}

/// One processor's mailbox.
struct End<X: Exclusion, const N: usize> {
    mailbox: Mailbox<'static, N, X>,
    depth: u8,
}

impl<X: Exclusion, const N: usize> Client for End<X, N> {
    #[inline]
    fn call(&mut self, value: u32) -> Result<u32> {
        Ok(self
            .mailbox
            .send_with_reply(SERVER, Vector(self.depth), value, TIMEOUT)?)
    }
}

impl<X: Exclusion, const N: usize> Server for End<X, N> {
    fn serve(&mut self, count: u32) -> Result<()> {
        // Of the calls of one round trip, every other is to the server.
        let mut left = count as usize * usize::from(self.depth / 2 + 1);
        while left > 0 {
            left = left.saturating_sub(self.mailbox.serve(TIMEOUT)?);
        }
        Ok(())
    }
}
