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

/// The page of a simulated clock, the memory in which it keeps its state, mapped from a file. All
/// clones are the same mapping.
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
    /// The number of bytes that a page takes in a file, at an offset that is a multiple of 64.
    pub const BYTES: u32 = size_of::<Page>() as u32;

    /// Maps the page in `range` without a check. The caller must [reset](Page::reset) the page.
    ///
    /// # Errors
    /// [`ProcessError::Open`] or [`ProcessError::MapShared`] if the file cannot be mapped;
    /// [`ProcessError::ClockPlace`] if no page has room there.
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

    /// Maps the page in `range` and checks it. Another process has [reset](Page::reset) the page.
    ///
    /// # Errors
    /// [`ProcessError::Open`] or [`ProcessError::MapShared`] if the file cannot be mapped;
    /// [`ProcessError::ClockPlace`] if no page has room there; [`ProcessError::Clock`] if the
    /// memory holds no page of this version.
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

/// Hands the turn of a simulated clock, the right to run, over between processes: by futex, and
/// also by doorbell to each participant that [needs one](Page::needs_bell).
#[derive(Debug)]
pub struct Bells {
    futex: Futex,
    page: MappedPage,
    doorbell: LinuxDoorbell<PROCESSORS>,
}

impl Bells {
    /// Makes the handover of the program that runs in the calling thread and holds `doorbell`.
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

/// A part of the host in simulated time: a service, for which time waits, or a guest, for which it does
/// not. It asks for the *turn*, the right to run at an instant of that time, and releases the turn
/// afterwards.
#[derive(Debug)]
pub struct HostClock {
    page: MappedPage,
    number: u8,
    is_service: bool,
    by: Bells,
}

impl HostClock {
    /// Returns the page of the simulated clock.
    #[must_use]
    pub fn page(&self) -> &Page {
        &self.page
    }

    /// Returns the number of this part of the host among the participants in the simulated time.
    #[must_use]
    pub const fn number(&self) -> u8 {
        self.number
    }

    /// Returns the way in which it hands the turn over.
    #[must_use]
    pub const fn handover(&self) -> &Bells {
        &self.by
    }

    /// Asks for the turn, and does not wait: at the instant `at`, in nanoseconds, or as soon as no
    /// processor has anything to do, whichever is later. The doorbell rings when this part of the host
    /// [has](Self::has_turn) it.
    pub fn request(&self, at: u64) {
        self.page.request(self.number, at, &self.by);
    }

    /// Returns true if this part of the host has the turn, which it [requested](Self::request).
    #[must_use]
    pub fn has_turn(&self) -> bool {
        self.page.has_turn(self.number)
    }

    /// Releases the turn, so that the simulated time can go on.
    pub fn finish(&self) {
        self.page.finish(self.number, &self.by);
    }

    /// Releases the turn and [requests](Self::request) it again for `at`, before any time passes. If no
    /// processor has anything to do before, this part of the host keeps the turn.
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

/// The mailbox of a part of the host.
pub type HostMailbox<'v> = Mailbox<'v, (LinuxWindow, HostBell, SingleContext), PROCESSORS>;

/// The doorbell of a part of the host. Its waits are in real time. In a system with a simulated
/// clock it reports its rings, and the messages that were handled, to that clock. All clones are
/// the same doorbell.
#[derive(Clone, Debug)]
pub struct HostBell {
    doorbell: LinuxDoorbell<PROCESSORS>,
    clock: Option<Arc<HostClock>>,
}

impl HostBell {
    /// Makes the doorbell of a service: a part of the host for which the time of `page` waits until
    /// the service has taken all messages to it. `page` is `None` in a system that runs by the real
    /// clock.
    #[must_use]
    pub fn of_service(doorbell: LinuxDoorbell<PROCESSORS>, page: Option<MappedPage>) -> Self {
        Self::new(doorbell, page, true)
    }

    /// Makes the doorbell of a guest: a part of the host for which simulated time does not wait.
    /// The guest takes part in the time of `page` until the doorbell and all its clones are
    /// dropped. `page` is `None` in a system that runs by the real clock.
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

    /// Makes the mailbox of the number that `claim` holds, with the doorbell that `bell` makes.
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

    /// Returns the doorbell that wakes this part of the host.
    #[must_use]
    pub const fn doorbell(&self) -> &LinuxDoorbell<PROCESSORS> {
        &self.doorbell
    }

    /// Returns the simulated clock; `None` if the system runs by the real clock.
    #[must_use]
    pub fn clock(&self) -> Option<&HostClock> {
        self.clock.as_deref()
    }

    /// Reports to the simulated clock that the service has handled all messages that came before
    /// [`prepare`](Doorbell::prepare) returned `seen`. [`wait`](Doorbell::wait) does the same, and also
    /// releases the turn. A service that sleeps in another way must call this itself. The service has the
    /// turn when it begins, and must [release it](HostClock::finish).
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

    fn evidence(&self, processor: Processor) -> Evidence {
        self.doorbell.evidence(processor)
    }
}
