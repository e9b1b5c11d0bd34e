//! The supervisor's mailbox, by which it sees the state of the other processors.

use std::os::fd::{AsFd, BorrowedFd};
use std::time::Duration;

use condor_mbox::linux::{Claim, LinuxDoorbell, PollableBell};
use condor_mbox::{
    Doorbell, Handler, LoadOrder, MailboxError, MemoryWindow, Messenger, PeerState, Processor,
    layout,
};
use condor_rt::linux::{HostBell, HostClock, HostMailbox, MappedPage};

use super::UpError;
use condor_rt::numbers::{PROCESSORS, REQUESTS};

/// The rings that have been heard.
pub(super) type BellState = <HostBell as Doorbell>::Seen;

/// The supervisor's mailbox. It looks at other processors and takes their requests, and sends them
/// no messages.
pub(super) struct SupervisorMailbox<'v> {
    mailbox: HostMailbox<'v>,
    bell: PollableBell,
    doorbell: HostBell,
}

impl<'v> SupervisorMailbox<'v> {
    /// `page` is that of the simulated clock; `receive` gets the requests of processors.
    pub(super) fn open(
        claim: Claim<PROCESSORS>,
        page: Option<MappedPage>,
        receive: Handler<'v>,
    ) -> Result<Self, UpError> {
        // Simulated time waits for the answers to requests.
        let doorbell = HostBell::of_service(claim.doorbell().clone(), page);
        if let Some(clock) = doorbell.clock() {
            clock.finish();
        }
        let bell = doorbell.doorbell().pollable();
        let own = doorbell.clone();
        let mut mailbox = HostBell::mailbox(claim, |_| own)?;
        mailbox.set_vector(REQUESTS, receive, "requests")?;
        mailbox.join()?;
        mailbox.ring_always(true)?;
        Ok(Self {
            mailbox,
            bell,
            doorbell,
        })
    }

    /// Rings others, as the supervisor.
    pub(super) fn doorbell(&self) -> LinuxDoorbell<PROCESSORS> {
        self.doorbell.doorbell().clone()
    }

    /// The simulated clock, if the system has one.
    pub(super) fn clock(&self) -> Option<&HostClock> {
        self.doorbell.clock()
    }

    /// Returns a descriptor that becomes readable when a program has joined or left.
    pub(super) fn bell(&self) -> BorrowedFd<'_> {
        self.bell.as_fd()
    }

    /// Increments the supervisor's heartbeat, acknowledges programs that have joined, and takes the
    /// requests of processors. Once these are carried out, pass the result to [`done`](Self::done).
    pub(super) fn serve(&self) -> Result<BellState, MailboxError> {
        self.bell.drain();
        let seen = self.doorbell.prepare();
        self.mailbox.serve(Duration::ZERO)?;
        Ok(seen)
    }

    /// Lets simulated time go on after what [`serve`](Self::serve) has taken.
    pub(super) fn done(&self, seen: BellState) {
        self.doorbell.done(seen);
    }

    /// The incarnation that the number has, or had last.
    pub(super) fn incarnation(&self, number: Processor) -> u32 {
        self.word(number, layout::header::LAST_INCARNATION)
    }

    /// Returns true if a program has joined with another incarnation than `incarnation_before`.
    pub(super) fn is_up_after(&self, number: Processor, incarnation_before: u32) -> bool {
        matches!(
            self.mailbox.peer_state(number),
            Ok(PeerState::Up { incarnation, .. }) if incarnation != incarnation_before
        )
    }

    pub(super) fn heartbeat(&self, number: Processor) -> u32 {
        self.word(number, layout::header::HEARTBEAT)
    }

    /// 0 if the memory is gone, in which no incarnation is and no heart beats.
    fn word(&self, number: Processor, at: u32) -> u32 {
        let windows = self.mailbox.windows(number);
        let word = windows.map(|windows| windows.mail.load(at, LoadOrder::Relaxed));
        word.ok().and_then(Result::ok).unwrap_or(0)
    }
}
