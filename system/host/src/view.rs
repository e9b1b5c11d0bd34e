//! The state of a running system, read from its memory by a visitor without stopping any program.
//!
//! A [`View`] claims one of the numbers of [`VISITORS`] and maps all windows. It reads everything
//! from the memory of the processors: the incarnation of a mailbox, the counts of servo loops and vectors,
//! the state of terminals, and variables. To send messages, watch variables or set parameters, it
//! must [join](View::join) first.

mod hearing;
mod interrupts;
mod loops;
mod terminals;
mod variables;
mod vectors;

pub use hearing::{HeardMessage, Hearing, HearingEvent};
pub use interrupts::BoardInterrupts;
pub use loops::{LoopRates, LoopSample, Percentiles};
pub use terminals::TerminalCounts;
pub use variables::Variables;
pub use vectors::VectorCounts;

use core::cell::RefCell;
use core::time::Duration;

use condor_mbox::linux::{Claim, LinuxWindow, SystemError};
use condor_mbox::{
    AccessError, Allocator, Instant, LoadOrder, MailboxError, MemoryWindow, Messenger, PeerState,
    Processor, Region, layout,
};
use condor_platform::linux::{LOCK_PATIENCE, while_held};
use serde::Serialize;

use crate::system::{SystemDirectory, SystemWindows};

use condor_rt::linux::{HostBell, HostMailbox, MappedPage, ProcessError};
use condor_rt::numbers::{PROCESSORS, VISITORS};
use condor_rt::objects::{self, ObjectKind, SharedObject};

/// The mailbox of a visitor, which is a program that looks at a running system without belonging to it.
pub type Post = HostMailbox<'static>;

/// The reason why a visitor cannot read the memory of a system.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ViewError {
    /// The object table of a processor, the list of its loops, variables and terminals, has another version.
    #[error(
        "{processor} has an object table of version {found}, and this program reads version {expected}; build both \
         from the same sources",
        expected = objects::VERSION
    )]
    Version {
        /// The number of the processor.
        processor: Processor,
        /// The version of its table.
        found: u32,
    },
    /// All numbers of visitors are in use.
    #[error(
        "too many programs look at the system; end one of these first: {}",
        Holders(holders)
    )]
    Full {
        /// The numbers of visitors, each with the id of the process that holds it.
        holders: Vec<(Processor, u32)>,
    },
    /// The processors' shared memory (the windows) cannot be opened.
    #[error(transparent)]
    Windows(#[from] SystemError),
    /// The page of the simulated clock cannot be opened.
    #[error(transparent)]
    Clock(#[from] ProcessError),
    /// A processor has no vector of this name or number; the text says which it has.
    #[error("{0}")]
    NoVector(String),
    /// The visitor's mailbox returned this error.
    #[error(transparent)]
    Mailbox(#[from] MailboxError),
    /// An access to the memory of a processor failed.
    #[error("cannot access the memory of {processor}: {source}")]
    Memory {
        /// The number of the processor.
        processor: Processor,
        /// The error of the access.
        source: AccessError,
    },
}

struct Holders<'a>(&'a [(Processor, u32)]);

impl core::fmt::Display for Holders<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("processes ")?;
        for (place, (number, process)) in self.0.iter().enumerate() {
            let comma = if place == 0 { "" } else { ", " };
            write!(f, "{comma}{process} (number {})", number.0)?;
        }
        Ok(())
    }
}

/// The state of a processor's mailbox: whether a program has joined there and takes messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum MailboxState {
    /// The processor has never joined, or has left.
    Absent,
    /// The processor is about to join.
    Joining,
    /// The processor has joined the mailbox system, and takes messages.
    Up,
    /// The program of the processor ended without leaving the mailbox system.
    Dead,
}

impl core::fmt::Display for MailboxState {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.pad(match self {
            Self::Absent => "absent",
            Self::Joining => "joining",
            Self::Up => "up",
            Self::Dead => "dead",
        })
    }
}

/// The state of a processor's mailbox, and the counter with which its program shows that it still runs. Both are read
/// from the memory of the processor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Heart {
    /// The state of the mailbox.
    pub presence: MailboxState,
    /// The incarnation of the mailbox, a number that changes each time a program joins: the present
    /// one, or the last one if no program has joined now; 0 before the first.
    pub incarnation: u32,
    /// The heartbeat: a count that the processor increments whenever it serves or waits; wraps.
    pub beats: u32,
}

/// A visitor of a running system: it reads the memories that the processors share, without stopping any program. It can
/// send messages after [`join`](Self::join).
pub struct View {
    post: Post,
    /// The allocator of the free part of the visitor's own memory.
    allocator: RefCell<Allocator>,
    /// The simulated clock, if the system has one.
    clock: Option<MappedPage>,
}

impl core::fmt::Debug for View {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("View")
            .field("number", &self.post.number())
            .finish_non_exhaustive()
    }
}

impl View {
    /// Opens the memories of the processors of the system in `directory`, and claims the first free number for
    /// visitors. `window_bytes` is the size of the users' region of each processor's `data`, in bytes: see
    /// [`SystemStatus`](crate::control::SystemStatus::window_bytes).
    ///
    /// # Errors
    /// Returns [`ViewError::Full`] if no such number is free; [`ViewError::Windows`] if the windows cannot be
    /// opened; [`ViewError::Clock`] if the simulated clock cannot be opened.
    pub fn open(directory: &SystemDirectory, window_bytes: u32) -> Result<Self, ViewError> {
        let mut claim = claim(&directory.system(window_bytes)?)?;
        let allocator = RefCell::new(claim.places()?);
        let page = directory.clock_page()?;
        let clock = page.clone();
        let post = HostBell::mailbox(claim, |bell| HostBell::of_guest(bell, page))?;
        Ok(Self {
            post,
            allocator,
            clock,
        })
    }

    /// Joins the mailbox system under the visitor's number, so that messages can be sent. Returns the visitor's
    /// mailbox.
    ///
    /// # Errors
    /// Returns [`ViewError::Mailbox`] if [`Mailbox::join`](condor_mbox::Mailbox::join) fails.
    pub fn join(&mut self) -> Result<&Post, ViewError> {
        self.post.join()?;
        Ok(&self.post)
    }

    /// Returns the visitor's mailbox. It can send messages only after [`join`](Self::join).
    #[must_use]
    pub const fn post(&self) -> &Post {
        &self.post
    }

    /// Returns the present time on the clock of the system: the simulated clock, or else the clock of this host.
    #[must_use]
    pub fn now(&self) -> Instant {
        match &self.clock {
            Some(page) => Instant::from_ns(page.now()),
            None => self.post.now(),
        }
    }

    /// Returns true if the system has a simulated clock, which all processors share.
    pub(crate) const fn is_simulated(&self) -> bool {
        self.clock.is_some()
    }

    /// Reads the state of the mailbox of `processor`, and its heartbeat. If the heartbeat is the same after some time,
    /// the program hangs or has ended.
    ///
    /// # Errors
    /// [`ViewError::Mailbox`] if there is no such processor or its memory cannot be read.
    pub fn heart(&self, processor: Processor) -> Result<Heart, ViewError> {
        let mail = &self.post.windows(processor)?.mail;
        let word = |at| mail.load(at, LoadOrder::Relaxed).unwrap_or(0);
        let presence = match self.post.peer_state(processor)? {
            PeerState::Absent => MailboxState::Absent,
            PeerState::Joining => MailboxState::Joining,
            PeerState::Up { .. } => MailboxState::Up,
            PeerState::Dead { .. } => MailboxState::Dead,
        };
        Ok(Heart {
            presence,
            incarnation: word(layout::header::LAST_INCARNATION),
            beats: word(layout::header::HEARTBEAT),
        })
    }

    /// Returns the users' region of the `data` of `processor`: the part of its memory in which its program places
    /// loops, variables, terminals and other objects.
    ///
    /// # Errors
    /// [`ViewError::Mailbox`] if there is no such processor, [`ViewError::Memory`] if its memory
    /// cannot be accessed.
    pub fn region(&self, processor: Processor) -> Result<Region<LinuxWindow>, ViewError> {
        let window = self.post.windows(processor)?.data.clone();
        Region::users(window).map_err(|source| ViewError::Memory { processor, source })
    }

    /// Returns the objects of the kind `kind`, such as loops or terminals, that the object table of `processor` lists.
    ///
    /// # Errors
    /// [`ViewError::Mailbox`] if there is no such processor, [`ViewError::Memory`] if its memory
    /// cannot be read, [`ViewError::Version`] if the table has another version.
    pub fn objects(
        &self,
        processor: Processor,
        kind: ObjectKind,
    ) -> Result<Vec<SharedObject>, ViewError> {
        let region = self.region(processor)?;
        let at = |source| ViewError::Memory { processor, source };
        if let Some(found) = objects::version(&region).map_err(at)?
            && found != objects::VERSION
        {
            return Err(ViewError::Version { processor, found });
        }
        let all = objects::all(&region).map_err(at)?;
        let of_kind = all.filter(|object| object.as_ref().map_or(true, |it| it.kind == kind));
        of_kind.collect::<Result<_, _>>().map_err(at)
    }
}

fn claim(windows: &SystemWindows) -> Result<Claim<PROCESSORS>, ViewError> {
    let is_full = |result: &Result<_, _>| matches!(result, Err(ViewError::Full { .. }));
    while_held(LOCK_PATIENCE, is_full, || {
        let mut holders = Vec::new();
        for number in VISITORS {
            match windows.claim_within(Processor(number), Duration::ZERO) {
                Err(SystemError::NumberTaken { number, process_id }) => {
                    holders.push((number, process_id));
                }
                other => return Ok(other?),
            }
        }
        Err(ViewError::Full { holders })
    })
}
