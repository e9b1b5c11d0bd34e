//! [`Tally`]: what was sent and what has come, by processor.

use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use core::time::Duration;

use condor_mbox::{Call, MailboxError, Messenger, Processor, Published, Vector};
use condor_rt::PROCESSORS;
use zerocopy::{FromBytes, Immutable, IntoBytes};

use super::Verdict;

/// Returns the place in the shared memory where a processor publishes its [`Counts`].
pub(super) const fn counts_of(processor: Processor) -> Published<Counts> {
    Published::at((processor.0 as u32).wrapping_mul(Published::<Counts>::BYTES))
}

/// Bytes of the shared memory that all processors need.
pub const SHARED_BYTES: u32 = PROCESSORS as u32 * Published::<Counts>::BYTES;

/// The vectors of messages: without reply, of backgrounds and of loops, and with reply.
pub(super) const NOTE: Vector = Vector(8);
pub(super) const TICK: Vector = Vector(9);
pub(super) const ASK: Vector = Vector(10);

/// The steps of a drill, in the state of a processor.
pub(super) const JOINED: u32 = 1;
pub(super) const SENT: u32 = 2;
pub(super) const COMPARED: u32 = 3;

/// Bits of a question that say how deep it is asked back.
const DEPTH_BITS: u32 = 4;

/// The number of messages that a processor says it has sent to each other one.
#[derive(Clone, Copy, Debug, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub(super) struct Counts {
    pub(super) state: u32,
    notes: [u32; PROCESSORS],
    ticks: [u32; PROCESSORS],
}

/// One number for each processor. Handlers, loops and background are contexts of one processor, and
/// each number has one writer.
#[derive(Default)]
struct Row([AtomicU32; PROCESSORS]);

impl Row {
    fn get(&self, processor: Processor) -> u32 {
        self.0
            .get(processor.index())
            .map_or(0, |one| one.load(Relaxed))
    }

    fn set(&self, processor: Processor, value: u32) {
        if let Some(one) = self.0.get(processor.index()) {
            one.store(value, Relaxed);
        }
    }

    fn all(&self) -> [u32; PROCESSORS] {
        self.0.each_ref().map(|one| one.load(Relaxed))
    }
}

/// The counts of messages that were sent and that have come.
#[derive(Default)]
pub(super) struct Tally {
    notes_sent: Row,
    ticks_sent: Row,
    notes: Row,
    ticks: Row,
    calls: AtomicU32,
    nested: AtomicU32,
    questions: AtomicU32,
    wrong: AtomicU32,
}

impl Tally {
    pub(super) fn check(&self, right: bool) {
        if !right {
            self.wrong.fetch_add(1, Relaxed);
        }
    }

    pub(super) fn wrong(&self) -> u32 {
        self.wrong.load(Relaxed)
    }

    /// Handles [`NOTE`].
    pub(super) fn note(&self, call: &Call<'_>) -> u32 {
        self.follows(&self.notes, call)
    }

    /// Handles [`TICK`].
    pub(super) fn tick(&self, call: &Call<'_>) -> u32 {
        self.follows(&self.ticks, call)
    }

    fn follows(&self, row: &Row, call: &Call<'_>) -> u32 {
        let from = call.sender();
        self.check(call.data() == row.get(from).wrapping_add(1));
        row.set(from, call.data());
        0
    }

    /// Handles [`ASK`]: asks back first.
    pub(super) fn answer(&self, call: &Call<'_>, timeout: Duration) -> u32 {
        let question = call.data();
        self.calls.fetch_add(1, Relaxed);
        if let Some(back) = deeper(question) {
            match call.send_with_reply(call.sender(), ASK, back, timeout) {
                Ok(reply) => {
                    self.nested.fetch_add(1, Relaxed);
                    self.check(reply == answer_to(back));
                }
                // So many handlers are in progress that there is no room for one more, or all slots
                // wait for replies.
                Err(MailboxError::TooDeep { .. } | MailboxError::NoSlot { .. }) => {}
                Err(_) => self.check(false),
            }
        }
        answer_to(question)
    }

    pub(super) fn next_note(&self, to: Processor) -> u32 {
        self.notes_sent.get(to).wrapping_add(1)
    }

    pub(super) fn note_sent(&self, to: Processor, number: u32) {
        self.notes_sent.set(to, number);
    }

    pub(super) fn next_tick(&self, to: Processor) -> u32 {
        self.ticks_sent.get(to).wrapping_add(1)
    }

    pub(super) fn tick_sent(&self, to: Processor, number: u32) {
        self.ticks_sent.set(to, number);
    }

    /// Returns a new question, whose receivers ask back to this depth.
    pub(super) fn next_question(&self, depth: u32) -> u32 {
        self.questions.fetch_add(1, Relaxed) << DEPTH_BITS | depth
    }

    pub(super) fn counts(&self, state: u32) -> Counts {
        Counts {
            state,
            notes: self.notes_sent.all(),
            ticks: self.ticks_sent.all(),
        }
    }

    /// Returns the number of messages from `from` to `me` that have not come.
    pub(super) fn missing(&self, me: Processor, from: Processor, sent: &Counts) -> u32 {
        let of = |sent: &[u32; PROCESSORS], row: &Row| {
            let sent = sent.get(me.index()).copied().unwrap_or(0);
            sent.abs_diff(row.get(from))
        };
        of(&sent.notes, &self.notes).saturating_add(of(&sent.ticks, &self.ticks))
    }

    pub(super) fn fill(&self, verdict: &mut Verdict) {
        let sum = |row: &Row| row.all().into_iter().fold(0, u32::wrapping_add);
        verdict.notes = sum(&self.notes);
        verdict.ticks = sum(&self.ticks);
        verdict.calls = self.calls.load(Relaxed);
        verdict.nested = self.nested.load(Relaxed);
    }
}

/// Returns the question that the receiver of `question` asks back, if there is one.
fn deeper(question: u32) -> Option<u32> {
    let depth = question & ((1 << DEPTH_BITS) - 1);
    depth
        .checked_sub(1)
        .map(|depth| question >> DEPTH_BITS << DEPTH_BITS | depth)
}

/// Returns the right answer to a question.
pub(super) fn answer_to(question: u32) -> u32 {
    question.wrapping_mul(0x9e37_79b1).rotate_left(7)
}
