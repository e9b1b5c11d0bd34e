//! [`Handover`]: how a participant sleeps until it has the turn, and wakes another one.

use crate::sync::AtomicU32;

/// The way in which participants of one kind of machine sleep and are woken.
///
/// # For implementers
///
/// `sleep` and `wake` are a futex, or something that is as good: a `wake` between the moment at which
/// `seen` was loaded and `sleep` must end that sleep at once. A sleep may end early for any reason.
pub trait Handover {
    /// Sleeps until `word` is no longer `seen`, until [`wake`](Self::wake), or for `most_ns`
    /// nanoseconds of real time.
    fn sleep(&self, word: &AtomicU32, seen: u32, most_ns: u64);

    /// Wakes the participant `number`, which may sleep on `word`.
    fn wake(&self, number: u8, word: &AtomicU32);

    /// Returns the real time in nanoseconds, with which simulated time can keep pace; `None` if
    /// this participant cannot read it. The participant then never waits for the real time.
    fn wall_ns(&self) -> Option<u64> {
        None
    }

    /// Returns whether the caller is the program of its processor, and no other thread beside it.
    fn is_own_context(&self) -> bool {
        true
    }

    /// Returns whether all participants are processors of this one program, so that nobody else
    /// can ever ring a processor.
    fn is_closed(&self) -> bool {
        false
    }

    /// Reports a mistake of the program; may unwind.
    fn fault(&self, fault: Fault) {
        let _ = fault;
    }
}

/// A mistake that a program makes with simulated time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// The program still runs ten seconds of its time after it was told to stop.
    NotStopping,
    /// The program waits without a deadline, and no participant is left that could ring it.
    WaitsForever,
    /// A loop, or a handler of the timer, polls the clock, which stands still there.
    Polls,
}
