//! The vectors of each of the two processors, and what their handlers do.

use core::ptr;
use core::sync::atomic::{AtomicU32, AtomicUsize, Ordering::Relaxed};
use core::time::Duration;

use condor_mbox::error::MemoryObject;
use condor_mbox::exchange::answer;
use condor_mbox::{
    Call, CriticalSection, Doorbell, MailboxError, Messenger, Processor, Region, Vector,
};

use crate::{LEADER, Mbox, PATIENCE, PROCESSORS, Window, windows};

/// Returns the word at an offset of the users' `data` (memo, section 3.3.1).
pub(crate) const READ: Vector = Vector(12);
/// Counts messages that come in the order of their data; returns the number of those that did not.
pub(crate) const IN_ORDER: Vector = Vector(1);
/// Calls back until its data is used up; returns the depth that was reached.
pub(crate) const NEST: Vector = Vector(2);
/// Adds up terms.
pub(crate) const SUM: Vector = Vector(3);
/// Notes its data.
pub(crate) const NOTE: Vector = Vector(4);
/// Sends to its sender in each way that a handler has.
pub(crate) const ANSWER: Vector = Vector(5);
/// Counts what the follower sends on its own account.
pub(crate) const TICK: Vector = Vector(6);
/// Is refused, with its data as error code.
pub(crate) const REFUSE: Vector = Vector(7);
/// Has no handler.
pub(crate) const NOBODY: Vector = Vector(63);

/// The terms of a sum.
pub(crate) type Terms = [u32; 4];

/// The state of the handlers of one processor.
pub struct Resident {
    me: Processor,
    pub(crate) ram: Region<Window>,
    /// The users' `data` of all.
    data: [Region<Window>; PROCESSORS],
    next: AtomicU32,
    pub(crate) disorder: AtomicU32,
    pub(crate) noted: AtomicU32,
    pub(crate) notes: AtomicU32,
    ticks: AtomicU32,
    /// The place on the stack where the innermost handler of `NEST` runs; 0 if none does.
    innermost: AtomicUsize,
    /// The fewest bytes of stack between two of them: an interrupt in between takes its own besides.
    pub(crate) level: AtomicUsize,
    /// Messages to the number listened to that were heard here.
    pub(crate) heard: AtomicU32,
}

/// Lets `body` have the mailbox of `me`, not joined yet, with its vectors.
///
/// # Errors
/// Returns [`MailboxError::Window`] if a `data` window has no room for users; otherwise the error of
/// [`Mailbox::new`](condor_mbox::Mailbox::new) or of `set_vector` if one of them fails.
pub fn reside<D: Doorbell, R>(
    me: Processor,
    doorbell: D,
    body: impl FnOnce(&mut Mbox<'_, D>, &Resident) -> R,
) -> Result<R, MailboxError> {
    let resident = Resident::new(me)?;
    let read = |call: &Call<'_>| resident.read(call);
    let in_order = |call: &Call<'_>| resident.in_order(call);
    let sum = |call: &Call<'_>| resident.sum(call);
    let note = |call: &Call<'_>| resident.note(call);
    let nest = |call: &Call<'_>| resident.nest(call);
    let tick = |_: &Call<'_>| {
        count(&resident.ticks);
        0
    };
    let mut mailbox = Mbox::<D>::new(me, windows(), doorbell, CriticalSection)?;
    mailbox.set_vector(READ, &read, "read a word")?;
    mailbox.set_vector(IN_ORDER, &in_order, "in order")?;
    mailbox.set_vector(NEST, &nest, "nest")?;
    mailbox.set_vector(SUM, &sum, "sum")?;
    mailbox.set_vector(NOTE, &note, "note")?;
    mailbox.set_vector(ANSWER, &send_back, "answer")?;
    mailbox.set_vector(TICK, &tick, "tick")?;
    mailbox.set_vector(REFUSE, &|call| call.refuse(call.data()), "refuse")?;
    Ok(body(&mut mailbox, &resident))
}

impl Resident {
    fn new(me: Processor) -> Result<Self, MailboxError> {
        let data = windows().map(|windows| windows.data);
        let [leader, follower] = data.map(|data| {
            Region::users(data).map_err(|error| MailboxError::Window {
                processor: me,
                object: MemoryObject::Data,
                kind: error.kind,
            })
        });
        let data = [leader?, follower?];
        let [leader, follower] = data;
        Ok(Self {
            me,
            ram: if me == LEADER { leader } else { follower },
            data,
            next: AtomicU32::new(0),
            disorder: AtomicU32::new(0),
            noted: AtomicU32::new(0),
            notes: AtomicU32::new(0),
            ticks: AtomicU32::new(0),
            innermost: AtomicUsize::new(0),
            level: AtomicUsize::new(usize::MAX),
            heard: AtomicU32::new(0),
        })
    }

    /// Returns the number of messages that have come, and that the other processor sent on its own account.
    pub fn ticks(&self) -> u32 {
        self.ticks.load(Relaxed)
    }

    fn read(&self, call: &Call<'_>) -> u32 {
        if call.addressee() != self.me {
            count(&self.heard);
        }
        self.ram.word(call.data()).unwrap_or(u32::MAX)
    }

    fn in_order(&self, call: &Call<'_>) -> u32 {
        if call.data() == 0 {
            self.disorder.store(0, Relaxed);
        } else if call.data() != self.next.load(Relaxed) {
            count(&self.disorder);
        }
        self.next.store(call.data().wrapping_add(1), Relaxed);
        self.disorder.load(Relaxed)
    }

    /// Handles [`SUM`]. The place comes from the sender: it may be any number, and is checked by the
    /// region.
    fn sum(&self, call: &Call<'_>) -> u32 {
        self.data.get(call.sender().index()).map_or(0, |data| {
            answer(call, data, |terms: Terms| {
                terms
                    .iter()
                    .fold(0_u32, |sum, term| sum.wrapping_add(*term))
            })
        })
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

    fn note(&self, call: &Call<'_>) -> u32 {
        self.noted.store(call.data(), Relaxed);
        count(&self.notes);
        0
    }
}

/// Counts up. The handlers of one vector do not interrupt each other here, so no atomic addition is needed.
fn count(counter: &AtomicU32) {
    counter.store(counter.load(Relaxed).wrapping_add(1), Relaxed);
}

/// Sends to the sender in each way that a handler has; returns the number of ways that went well: 4.
fn send_back(call: &Call<'_>) -> u32 {
    let (to, data) = (call.sender(), call.data());
    let sent = call.send(to, NOTE, data, PATIENCE).is_ok();
    let posted = call
        .send(to, NOTE, data.wrapping_add(1), Duration::ZERO)
        .is_ok();
    let begun = match call.begin(to, NOTE, data.wrapping_add(2), Duration::ZERO) {
        // Nobody serves while a handler polls: the reply is given up.
        Ok(mut ticket) => ticket.poll().is_ok(),
        Err(_) => false,
    };
    let bounded = call.deadline() > condor_mbox::Instant::from_ns(0)
        && call.vector() == ANSWER
        && call.send_with_reply(to, NOBODY, 0, Duration::from_secs(1))
            == Err(MailboxError::NoHandler { to, vector: NOBODY });
    [sent, posted, begun, bounded]
        .into_iter()
        .fold(0, |ways, went| ways + u32::from(went))
}
