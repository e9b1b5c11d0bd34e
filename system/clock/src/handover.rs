//! [`Handover`]: how a participant sleeps until it has the turn, and wakes another one.

use crate::sync::AtomicU32;

/// The way in which participants of a [`Page`](crate::Page) sleep until they have the turn, the
/// right to run, and wake each other. A participant is a processor or a part of the host. Each kind
/// of machine has its own implementation.
///
/// # For implementers
///
/// `sleep` and `wake` must not lose a wake, as with a futex: a `wake` that comes after the caller
/// has loaded `seen` and before it sleeps must end that sleep at once. A sleep may end early for
/// any reason.
pub trait Handover {
    /// Sleeps until `word` differs from `seen`, until [`wake`](Self::wake) is called for `word`, or
    /// for `most_ns` nanoseconds of real time.
    fn sleep(&self, word: &AtomicU32, seen: u32, most_ns: u64);

    /// Wakes the participant `number`, which may sleep on `word`.
    fn wake(&self, number: u8, word: &AtomicU32);

    /// Returns the real time in nanoseconds since a moment that is the same for all participants;
    /// simulated time keeps pace with it if a speed is set. Returns `None`, as by default, if this
    /// participant cannot read the real time; it then never waits for it.
    fn wall_ns(&self) -> Option<u64> {
        None
    }

    /// Returns true if the calling thread is the one that runs the processor's program, not another
    /// thread beside it. The default is `true`.
    fn is_own_context(&self) -> bool {
        true
    }

    /// Returns true if all participants are processors of this one program, so that nothing outside
    /// it can ever ring a processor. The default is `false`.
    fn is_closed(&self) -> bool {
        false
    }

    /// Reports a mistake of the program; may unwind. By default it does nothing.
    fn fault(&self, fault: ClockFault) {
        let _ = fault;
    }
}

/// A mistake of a program with simulated time, which is reported to [`Handover::fault`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClockFault {
    /// The program still runs ten seconds of its time after it was told to stop.
    NotStopping,
    /// The program waits without a deadline, and no participant is left that could ring it.
    WaitsForever,
    /// A loop's body or a handler of the timer polls the clock, which stands still while they run.
    Polls,
}
