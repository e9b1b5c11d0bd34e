//! The simulated clock between processes: [`MappedPage`], and [`HostBell`] for parts of the host.

use core::ops::Deref;
use core::ptr::NonNull;
use std::sync::Arc;
use std::sync::atomic::AtomicU32;

use condor_clock::linux::Futex;
use condor_clock::{Handover, LocalClock, Page};
use condor_mbox::linux::{Claim, LinuxDoorbell, LinuxWindow};
use condor_mbox::{self as mbox, Clock, Doorbell, Evidence, Instant, Mailbox};
use condor_mbox::{MemoryWindow as _, Processor, SingleContext};

use super::environment::FileRange;
use super::error::ProcessError;
use crate::numbers::PROCESSORS;

/// The clock of a process in simulated time.
pub(super) type ProcessClock = Arc<LocalClock<MappedPage, Bells>>;

/// The [page](Page) of a simulated clock, mapped from a file. All processes of the system map the
/// same page, in which the clock keeps its state. All clones are the same mapping.
#[derive(Clone, Debug)]
pub struct MappedPage {
    page: NonNull<Page>,
    /// Keeps the page mapped.
    _window: LinuxWindow,
}

// SAFETY: a page consists of atomics.
unsafe impl Send for MappedPage {}
// SAFETY: as above.
unsafe impl Sync for MappedPage {}

impl MappedPage {
    /// The number of bytes that a page takes in a file. The page must begin at an offset that is a
    /// multiple of 64.
    pub const BYTES: u32 = size_of::<Page>() as u32;

    /// Maps the page of a new clock in `range`, without a check of its contents. The caller must
    /// [reset](Page::reset) the page before other processes [open](Self::open) it.
    ///
    /// # Errors
    /// [`ProcessError::Open`] or [`ProcessError::MapShared`] if the file cannot be mapped;
    /// [`ProcessError::ClockPlace`] if `range` is too short for a page, or is not aligned to 64
    /// bytes.
    pub fn map(range: &FileRange) -> Result<Self, ProcessError> {
        let window = range.map("simulated clock")?;
        let words = window.words();
        let page = words.and_then(|words| Page::from_words(words.get()));
        let page = page.map(NonNull::from).ok_or(ProcessError::ClockPlace {
            path: range.path.clone(),
            offset: range.offset,
        })?;
        Ok(Self {
            page,
            _window: window,
        })
    }

    /// Maps the page in `range`, which another process has already [reset](Page::reset), and checks
    /// that it is the page of a simulated clock.
    ///
    /// # Errors
    /// [`ProcessError::Open`] or [`ProcessError::MapShared`] if the file cannot be mapped;
    /// [`ProcessError::ClockPlace`] if `range` is too short for a page, or is not aligned to 64
    /// bytes; [`ProcessError::Clock`] if the memory holds no page of this version.
    pub fn open(range: &FileRange) -> Result<Self, ProcessError> {
        let page = Self::map(range)?;
        page.check()?;
        Ok(page)
    }
}

impl Deref for MappedPage {
    type Target = Page;

    fn deref(&self) -> &Page {
        // SAFETY: the words are in the window, which is mapped as long as `self` exists and clones of which
        // are the same mapping; a page consists of atomics, for which all bytes are valid.
        unsafe { self.page.as_ref() }
    }
}

/// The [`Handover`] between processes: it wakes the process that gets the turn of a simulated
/// clock, the right to run. It wakes by futex, and also by doorbell if the participant [needs
/// one](Page::needs_bell).
#[derive(Debug)]
pub struct Bells {
    futex: Futex,
    page: MappedPage,
    doorbell: LinuxDoorbell<PROCESSORS>,
}

impl Bells {
    /// Makes the handover for a participant of the clock in `page`. The program of the participant
    /// runs in the calling thread, and `doorbell` is its doorbell.
    #[must_use]
    pub fn new(page: MappedPage, doorbell: LinuxDoorbell<PROCESSORS>) -> Self {
        Self {
            futex: Futex::new(),
            page,
            doorbell,
        }
    }
}

impl Handover for Bells {
    fn sleep(&self, word: &AtomicU32, seen: u32, most_ns: u64) {
        self.futex.sleep(word, seen, most_ns);
    }

    fn wake(&self, number: u8, word: &AtomicU32) {
        self.futex.wake(number, word);
        if self.page.needs_bell(number) {
            self.doorbell.ring(Processor(number));
        }
    }

    fn wall_ns(&self) -> Option<u64> {
        self.futex.wall_ns()
    }

    fn is_own_context(&self) -> bool {
        self.futex.is_own_context()
    }
}

/// The access of one part of the host to the simulated clock. The part is a service, for which simulated time waits, or
/// a guest, such as a command, for which it does not wait. Through this object the part asks for the *turn*, the right
/// to run at an instant of simulated time, and releases the turn afterwards.
#[derive(Debug)]
pub struct HostClock {
    page: MappedPage,
    number: u8,
    is_service: bool,
    by: Bells,
}

impl HostClock {
    /// Returns the page of the simulated clock, the shared memory with its state.
    #[must_use]
    pub fn page(&self) -> &Page {
        &self.page
    }

    /// Returns the processor number of this part of the host, under which it takes part in the
    /// simulated time.
    #[must_use]
    pub const fn number(&self) -> u8 {
        self.number
    }

    /// Returns the handover by which this part of the host wakes the next participant when it
    /// releases the turn.
    #[must_use]
    pub const fn handover(&self) -> &Bells {
        &self.by
    }

    /// Asks for the turn at the instant `at`, in nanoseconds of simulated time, and returns without waiting. The turn
    /// comes at `at`, or at the present instant if `at` has passed; in both cases after all processors that go on at
    /// that instant. Then [`has_turn`](Self::has_turn) returns true, and the doorbell of this part of the host rings.
    pub fn request(&self, at: u64) {
        self.page.request(self.number, at, &self.by);
    }

    /// Returns true if this part of the host has the turn for which it [asked](Self::request).
    #[must_use]
    pub fn has_turn(&self) -> bool {
        self.page.has_turn(self.number)
    }

    /// Releases the turn, so that simulated time can go on. If the turn has not come yet, withdraws
    /// the [request](Self::request).
    pub fn finish(&self) {
        self.page.finish(self.number, &self.by);
    }

    /// Releases the turn and [requests](Self::request) it again for the instant `at`, in nanoseconds, before any time
    /// passes. This part of the host keeps the turn if no other participant goes on before that instant.
    pub fn postpone(&self, at: u64) {
        self.page.postpone(self.number, at, &self.by);
    }
}

impl Drop for HostClock {
    fn drop(&mut self) {
        // A service is expected back: only its supervisor ends its participation.
        if !self.is_service {
            self.page.give_up(self.number, &self.by);
        }
    }
}

/// The mailbox of a part of the host, such as a service or a command; [`HostBell::mailbox`] makes
/// it.
pub type HostMailbox<'v> = Mailbox<'v, (LinuxWindow, HostBell, SingleContext), PROCESSORS>;

/// The doorbell of a part of the host, such as a service or a command. Its waits are in real time.
/// In a system with a simulated clock it reports to that clock which processors it rings, and which
/// messages were handled. All clones are the same doorbell.
#[derive(Clone, Debug)]
pub struct HostBell {
    doorbell: LinuxDoorbell<PROCESSORS>,
    clock: Option<Arc<HostClock>>,
}

impl HostBell {
    /// Makes the doorbell of a service: a part of the host for which simulated time waits until the
    /// service has handled all messages to it. `page` is the page of the simulated clock; `None` if
    /// the system runs by the real clock.
    #[must_use]
    pub fn of_service(doorbell: LinuxDoorbell<PROCESSORS>, page: Option<MappedPage>) -> Self {
        Self::new(doorbell, page, true)
    }

    /// Makes the doorbell of a guest: a part of the host for which simulated time does not wait.
    /// `page` is the page of the simulated clock; `None` if the system runs by the real clock. The
    /// guest takes part in the simulated time until the doorbell and all its clones are dropped.
    #[must_use]
    pub fn of_guest(doorbell: LinuxDoorbell<PROCESSORS>, page: Option<MappedPage>) -> Self {
        Self::new(doorbell, page, false)
    }

    fn new(
        doorbell: LinuxDoorbell<PROCESSORS>,
        page: Option<MappedPage>,
        is_service: bool,
    ) -> Self {
        let clock = page.map(|page| {
            let number = doorbell.number().0;
            if is_service {
                page.serve(number);
            } else {
                page.visit(number);
            }
            Arc::new(HostClock {
                by: Bells::new(page.clone(), doorbell.clone()),
                page,
                number,
                is_service,
            })
        });
        Self { doorbell, clock }
    }

    /// Makes the mailbox for the processor number that `claim` holds. `bell` makes its doorbell:
    /// [`of_service`](Self::of_service) or [`of_guest`](Self::of_guest).
    ///
    /// # Errors
    /// [`mbox::MailboxError::Layout`] if the memory was laid out for another system or by another version;
    /// [`mbox::MailboxError::Window`] if it cannot be accessed.
    pub fn mailbox<'v>(
        claim: Claim<PROCESSORS>,
        bell: impl FnOnce(LinuxDoorbell<PROCESSORS>) -> Self,
    ) -> Result<HostMailbox<'v>, mbox::MailboxError> {
        let number = claim.number();
        let (windows, doorbell) = claim.into_parts();
        Mailbox::new(number, windows, bell(doorbell), SingleContext::new())
    }

    /// Returns the underlying doorbell, which wakes this part of the host in real time.
    #[must_use]
    pub const fn doorbell(&self) -> &LinuxDoorbell<PROCESSORS> {
        &self.doorbell
    }

    /// Returns the object through which this part of the host uses the simulated clock; `None` if
    /// the system runs by the real clock.
    #[must_use]
    pub fn clock(&self) -> Option<&HostClock> {
        self.clock.as_deref()
    }

    /// Reports to the simulated clock that this service has handled all messages that came before
    /// [`prepare`](Doorbell::prepare) returned the argument. [`wait`](Doorbell::wait) makes this report itself, and
    /// also releases the turn; call `done` only if the service sleeps in another way. Such a service has the turn when
    /// it begins, and must [release it](HostClock::finish). Does nothing for a guest, and in a system that runs by the
    /// real clock.
    pub fn done(&self, (_, seen): (u32, u32)) {
        if let Some(clock) = &self.clock
            && clock.is_service
        {
            clock.page.consumed(clock.number, seen, &clock.by);
        }
    }
}

impl Clock for HostBell {
    #[inline]
    fn now(&self) -> Instant {
        self.doorbell.now()
    }
}

impl Doorbell for HostBell {
    /// The rings that were seen, and the messages of processors in simulated time.
    type Seen = (u32, u32);

    fn ring(&self, processor: Processor) {
        if let Some(clock) = &self.clock {
            if clock.page.is_processor(processor.0) {
                return clock.page.ring(clock.number, processor.0, &clock.by);
            }
            if processor.0 != clock.number && clock.page.is_service(processor.0) {
                clock.page.count_ring(processor.0);
            }
        }
        self.doorbell.ring(processor);
    }

    fn prepare(&self) -> (u32, u32) {
        let clock = self.clock.as_ref();
        let seen = clock.map_or(0, |clock| clock.page.rings(clock.number));
        (self.doorbell.prepare(), seen)
    }

    fn wait(&self, seen: (u32, u32), until: Instant, whom: Option<Processor>) {
        self.done(seen);
        if let Some(clock) = &self.clock
            && clock.is_service
            && clock.has_turn()
        {
            // The service has looked, and needs no turn.
            clock.finish();
        }
        self.doorbell.wait(seen.0, until, whom);
    }

    fn waits_for_listener(&self, listener: Processor) -> bool {
        let mut clock = self.clock.iter();
        clock.all(|clock| clock.page.is_processor(listener.0))
    }

    fn evidence(&self, processor: Processor) -> Evidence {
        self.doorbell.evidence(processor)
    }
}
