//! condor-mbox: calls with a reply to a handler that gives back what it got.
//!
//! Every call has a deadline, an epoch, a checked vector and a handler table, like any user's; the
//! windows and doorbells are those of the Linux backend. Its memory is a family of its own, fresh
//! for every round.

use std::time::Duration;

use condor_mbox::linux::{LinuxDoorbell, LinuxWindow, System};
use condor_mbox::{
    Call, CriticalSection, Exclusion, Mailbox, Processor, SingleContext, Vector, Waiting,
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
    Ok(Box::new(Ours {
        system: System::family(0)?,
        waiting,
        depth,
        exclusion,
    }))
}

struct Ours<X> {
    system: System<2>,
    waiting: Waiting,
    /// How often a handler calls back: the number of the vector that is called.
    depth: u8,
    exclusion: fn() -> X,
}

impl<X: Exclusion> Ours<X> {
    /// Joins as `number`, in the process that calls.
    fn end(&self, number: Processor) -> Result<End<X>> {
        let (windows, doorbell) = self.system.claim(number)?.into_parts();
        let mut mailbox = Mailbox::new(number, windows, doorbell, (self.exclusion)())?;
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

impl<X: Exclusion> Contestant for Ours<X> {
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
struct End<X: Exclusion> {
    mailbox: Mailbox<'static, LinuxWindow, LinuxDoorbell<2>, X, 2>,
    depth: u8,
}

impl<X: Exclusion> Client for End<X> {
    #[inline]
    fn call(&mut self, value: u32) -> Result<u32> {
        Ok(self
            .mailbox
            .send_with_reply(SERVER, Vector(self.depth), value, TIMEOUT)?)
    }
}

impl<X: Exclusion> Server for End<X> {
    fn serve(&mut self, count: u32) -> Result<()> {
        // Of the calls of one round trip, every other is to the server.
        let mut left = count as usize * usize::from(self.depth / 2 + 1);
        while left > 0 {
            left = left.saturating_sub(self.mailbox.serve(TIMEOUT)?);
        }
        Ok(())
    }
}
