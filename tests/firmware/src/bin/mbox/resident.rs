//! The vectors of each of the two processors, and what their handlers do.

use core::ptr;
use core::sync::atomic::{AtomicU32, AtomicUsize, Ordering::Relaxed};

use condor_mbox::error::MemoryObject;
use condor_mbox::{
    Call, CriticalSection, MailboxError, Messenger as _, Processor, Region, Vector, Windows,
};

use crate::map::windows;
use crate::{Bell, LEADER, Mail, PATIENCE, Window};

/// Returns the word at an offset of the users' `data` (memo, section 3.3.1).
pub(crate) const READ: Vector = Vector(12);
/// Calls back until its data is used up; returns the depth that was reached.
pub(crate) const NEST: Vector = Vector(2);
/// Does nothing.
pub(crate) const NOTE: Vector = Vector(4);
/// Counts what the follower sends on its own account.
pub(crate) const TICK: Vector = Vector(6);
/// Has no handler.
pub(crate) const NOBODY: Vector = Vector(63);

/// The state of the handlers of one processor.
pub(crate) struct Resident {
    pub(crate) ram: Region<Window>,
    ticks: AtomicU32,
    /// The place on the stack where the innermost handler of `NEST` runs; 0 if none does.
    innermost: AtomicUsize,
    /// The fewest bytes of stack between two of them: an interrupt in between takes its own besides.
    level: AtomicUsize,
}

/// Lets `body` have the mailbox of `me`, not joined yet, with its vectors.
///
/// # Errors
/// Returns [`MailboxError::Window`] if the `data` window has no room for users; otherwise the error of
/// [`Mailbox::new`](condor_mbox::Mailbox::new) or of `set_vector` if one of them fails.
pub(crate) fn reside<R>(
    me: Processor,
    doorbell: Bell,
    body: impl FnOnce(&mut Mail<'_>, &Resident) -> R,
) -> Result<R, MailboxError> {
    let [leader, follower] = windows();
    let Windows { data, .. } = if me == LEADER { leader } else { follower };
    let ram = Region::users(data).map_err(|error| MailboxError::Window {
        processor: me,
        object: MemoryObject::Data,
        kind: error.kind,
    })?;
    let resident = Resident {
        ram,
        ticks: AtomicU32::new(0),
        innermost: AtomicUsize::new(0),
        level: AtomicUsize::new(usize::MAX),
    };
    let read = |call: &Call<'_>| resident.ram.word(call.data()).unwrap_or(u32::MAX);
    let nest = |call: &Call<'_>| resident.nest(call);
    let tick = |_: &Call<'_>| {
        // Handlers of one vector do not interrupt each other here.
        let ticks = resident.ticks.load(Relaxed).wrapping_add(1);
        resident.ticks.store(ticks, Relaxed);
        0
    };
    let mut mailbox = Mail::new(me, windows(), doorbell, CriticalSection)?;
    mailbox.set_vector(READ, &read, "read a word")?;
    mailbox.set_vector(NEST, &nest, "nest")?;
    mailbox.set_vector(NOTE, &|_| 0, "note")?;
    mailbox.set_vector(TICK, &tick, "tick")?;
    Ok(body(&mut mailbox, &resident))
}

impl Resident {
    /// Returns the number of messages that have come, and that the other processor sent on its own account.
    pub(crate) fn ticks(&self) -> u32 {
        self.ticks.load(Relaxed)
    }

    /// Returns the bytes of stack that a level of nesting takes.
    pub(crate) fn level(&self) -> usize {
        self.level.load(Relaxed)
    }

    /// Handles [`NEST`]: each end asks the other for one less until nothing is left, or the stack allows no
    /// more.
    fn nest(&self, call: &Call<'_>) -> u32 {
        let Some(less) = call.data().checked_sub(1) else {
            return 0;
        };
        let (outer, here) = (self.innermost.load(Relaxed), ptr::from_ref(call).addr());
        if outer != 0 {
            let level = outer.saturating_sub(here);
            self.level
                .store(self.level.load(Relaxed).min(level), Relaxed);
        }
        self.innermost.store(here, Relaxed);
        let reply = call.send_with_reply(call.sender(), NEST, less, PATIENCE);
        self.innermost.store(outer, Relaxed);
        match reply {
            Ok(depth) => depth.saturating_add(1),
            Err(MailboxError::TooDeep {
                depth: Call::MAX_DEPTH,
            }) => 1000,
            Err(_) => u32::MAX,
        }
    }
}
