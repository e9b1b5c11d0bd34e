//! The simulated clock between processes: [`MappedPage`], and [`HostBell`] for parts of the host.

use core::ops::Deref;
use core::ptr::NonNull;
use std::sync::Arc;

use condor_clock::linux::Futex;
use condor_clock::{LocalClock, Page};
use condor_mbox::linux::{LinuxDoorbell, LinuxWindow};
use condor_mbox::{Clock, Doorbell, Evidence, Instant, MemoryWindow as _, Processor};

use super::environment::FileRange;
use super::error::ProcessError;
use crate::numbers::PROCESSORS;

/// The clock of a process in simulated time.
pub(super) type ProcessClock = Arc<LocalClock<MappedPage, Futex>>;

/// The page of a simulated clock in a file. All clones are the same mapping.
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

    /// Maps the page in `range`, for one who will [reset](Page::reset) it.
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

    /// Maps the page in `range`, which somebody has [reset](Page::reset).
    ///
    /// # Errors
    /// Those of [`map`](Self::map); [`ProcessError::Clock`] if it is no page of this version.
    pub fn open(range: &FileRange) -> Result<Self, ProcessError> {
        let page = Self::map(range)?;
        page.check()?;
        Ok(page)
    }
}

impl Deref for MappedPage {
    type Target = Page;

    fn deref(&self) -> &Page {
        // SAFETY: the words lie in the window, which is mapped as long as this lives and clones of
        // which are the same mapping; a page consists of atomics, for which all bytes are valid.
        unsafe { self.page.as_ref() }
    }
}

/// The part of the host in simulated time: a service, which time waits for, or a guest.
#[derive(Debug)]
pub struct HostClock {
    page: MappedPage,
    number: u8,
    is_service: bool,
}

impl HostClock {
    /// Has `number` take part as a service: time waits until it has taken what is sent to it.
    #[must_use]
    pub fn serve(page: MappedPage, number: Processor) -> Self {
        page.serve(number.0);
        Self {
            page,
            number: number.0,
            is_service: true,
        }
    }

    /// Has `number` take part as a guest, until this is dropped.
    #[must_use]
    pub fn visit(page: MappedPage, number: Processor) -> Self {
        page.visit(number.0);
        Self {
            page,
            number: number.0,
            is_service: false,
        }
    }

    /// Returns the page.
    #[must_use]
    pub fn page(&self) -> &Page {
        &self.page
    }

    /// Returns the number that takes part.
    #[must_use]
    pub const fn number(&self) -> u8 {
        self.number
    }
}

impl Drop for HostClock {
    fn drop(&mut self) {
        // A service is expected back: only its supervisor gives it up.
        if !self.is_service {
            self.page.give_up(self.number, &Futex::new());
        }
    }
}

/// The doorbell of a part of the host, which waits by the real clock. In a system with a simulated
/// clock it tells that clock what it rings and what it has done. All clones are the same doorbell.
#[derive(Clone, Debug)]
pub struct HostBell {
    doorbell: LinuxDoorbell<PROCESSORS>,
    clock: Option<Arc<HostClock>>,
}

impl HostBell {
    /// Makes the doorbell; `clock` is that of a system in simulated time.
    #[must_use]
    pub fn new(doorbell: LinuxDoorbell<PROCESSORS>, clock: Option<HostClock>) -> Self {
        let clock = clock.map(Arc::new);
        Self { doorbell, clock }
    }

    /// Returns the doorbell that wakes this part of the host.
    #[must_use]
    pub const fn doorbell(&self) -> &LinuxDoorbell<PROCESSORS> {
        &self.doorbell
    }

    /// Returns the simulated clock, if the system has one.
    #[must_use]
    pub fn clock(&self) -> Option<&HostClock> {
        self.clock.as_deref()
    }

    /// Says that all has been done that came before [`prepare`](Doorbell::prepare) returned `seen`.
    /// [`wait`](Doorbell::wait) says it, too.
    pub fn done(&self, (_, seen): (u32, u32)) {
        if let Some(clock) = &self.clock
            && clock.is_service
        {
            clock.page.consumed(clock.number, seen, &Futex::new());
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
                return clock.page.ring(clock.number, processor.0, &Futex::new());
            }
            if clock.page.is_service(processor.0) {
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
        self.doorbell.wait(seen.0, until, whom);
    }

    fn evidence(&self, processor: Processor) -> Evidence {
        self.doorbell.evidence(processor)
    }
}
