//! The supervisor's mailbox, by which it sees the state of the other processors.

use std::os::fd::{AsFd, BorrowedFd};
use std::time::Duration;

use condor_mbox::linux::{LinuxDoorbell, PollableBell};
use condor_mbox::{Error, LoadOrder, MemoryWindow, Messenger, PeerState, Processor, layout};
use condor_rt::linux::{HostBell, HostClock, HostMailbox, MappedPage};

use super::UpError;
use crate::system::SystemDirectory;
use condor_rt::numbers::{PROCESSORS, SUPERVISOR};

/// The supervisor's mailbox. It only looks at other processors, and sends them no messages.
pub(super) struct Eye {
    mailbox: HostMailbox<'static>,
    bell: PollableBell,
    doorbell: HostBell,
}

impl Eye {
    /// `page` is that of the simulated clock.
    pub(super) fn open(
        directory: &SystemDirectory,
        window_bytes: u32,
        page: Option<MappedPage>,
    ) -> Result<Self, UpError> {
        let claim = directory.system(window_bytes)?.claim(SUPERVISOR)?;
        let doorbell = HostBell::of_guest(claim.doorbell().clone(), page);
        let bell = doorbell.doorbell().pollable();
        let own = doorbell.clone();
        let mut mailbox = HostBell::mailbox(claim, |_| own)?;
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

    /// Increments the supervisor's heartbeat, and acknowledges programs that have joined.
    pub(super) fn serve(&self) -> Result<(), Error> {
        self.bell.drain();
        self.mailbox.serve(Duration::ZERO)?;
        Ok(())
    }

    /// The life that the number has, or had last.
    pub(super) fn life(&self, number: Processor) -> u32 {
        self.word(number, layout::header::LAST_INCARNATION)
    }

    /// Returns whether a program has joined with another life than `life_before`.
    pub(super) fn is_up_after(&self, number: Processor, life_before: u32) -> bool {
        matches!(
            self.mailbox.peer_state(number),
            Ok(PeerState::Up { incarnation, .. }) if incarnation != life_before
        )
    }

    pub(super) fn heartbeat(&self, number: Processor) -> u32 {
        self.word(number, layout::header::HEARTBEAT)
    }

    /// 0 if the memory is gone, in which no life is and no heart beats.
    fn word(&self, number: Processor, at: u32) -> u32 {
        let windows = self.mailbox.windows(number);
        let word = windows.map(|windows| windows.mail.load(at, LoadOrder::Relaxed));
        word.ok().and_then(Result::ok).unwrap_or(0)
    }
}
