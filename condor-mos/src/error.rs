//! Errors of rates, and of calls.

use thiserror::Error;

use crate::clock::ClockSpec;
use crate::process::LoopId;
use crate::rate::Rate;

/// The reason why no schedule can be made for a set of rates.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum RateError {
    /// A period is shorter than a tick, or is not a whole number of ticks in any countable time.
    #[error(
        "the rate {rate} does not suit a clock of {frequency}: its period is shorter than a tick of the clock, or has \
             too fine a fraction of one; choose a lower or a rounder rate"
    )]
    TooFast {
        /// The rate that has no schedule.
        rate: Rate,
        /// The frequency of the clock, in ticks per second.
        frequency: Rate,
    },
    /// The releases of the set take so long to repeat that the table has no room for them all.
    #[error(
        "the rates of the loops need {needed} entries of the event table, which has {capacity}: use a larger table, \
         or the schedule `Scan`, which needs none"
    )]
    TooManyEvents {
        /// The number that [`entries`](crate::entries) returns for the rates and their phases.
        needed: usize,
        /// The number of entries of the table.
        capacity: usize,
    },
    /// A loop's phase, the time of its first release, is not within its first period.
    #[error("the phase is {phase} ticks; it must be less than the period of the rate {rate}")]
    Phase {
        /// The loop's rate.
        rate: Rate,
        /// The time from the start to its first release, in ticks.
        phase: u32,
    },
    /// There are too many rates, or none.
    #[error("the schedule has room for 1 to {capacity} loops, not for {loops}")]
    Loops {
        /// The number of rates.
        loops: usize,
        /// The number of loops for which the schedule has room.
        capacity: usize,
    },
}

impl RateError {
    /// Returns the fault in words, for an error of compilation, which cannot print values.
    pub(crate) const fn message(self) -> &'static str {
        match self {
            Self::TooFast { .. } => "a rate is faster than the timer's ticks",
            Self::TooManyEvents { .. } => {
                "the event table is too small for these rates: use a larger table, or the schedule `Scan`, which needs none"
            }
            Self::Phase { .. } => "a phase is not less than the period",
            Self::Loops { .. } => "there are too many rates, or none",
        }
    }
}

/// The reason why a call that names a loop failed, such as [`Loops::enable`](crate::Loops::enable).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum LoopError {
    /// The schedule has fewer loops.
    #[error("there is no loop {}: the schedule has loops 0 to {}", id.0, loops - 1)]
    NoSuchLoop {
        /// The number of the loop.
        id: LoopId,
        /// The number of loops.
        loops: u8,
    },
    /// The loop has a body already.
    #[error("loop {} already has a body to run", id.0)]
    Taken {
        /// The number of the loop.
        id: LoopId,
    },
    /// The loop has no body.
    #[error("loop {} has no body to run yet: `assign` one first", id.0)]
    Unassigned {
        /// The number of the loop.
        id: LoopId,
    },
    /// The loops have no schedule with the new rate.
    #[error(transparent)]
    Rate(#[from] RateError),
    /// The scheduler was made with [`NoStatistics`](crate::NoStatistics), so it has no counts of
    /// the loop.
    #[error("there are no statistics of loop {}: its scheduler was made with `NoStatistics`", id.0)]
    NoStatistics {
        /// The number of the loop.
        id: LoopId,
    },
    /// The operating system could not start a thread for the loop.
    #[error("cannot start a thread for loop {}: error {os_error} of the operating system", id.0)]
    NoThread {
        /// The number of the loop.
        id: LoopId,
        /// The error number of the operating system.
        os_error: i32,
    },
}

/// The reason why [`Loops::run`](crate::Loops::run) or [`Loops::start`](crate::Loops::start) did
/// not start the schedule.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum StartError {
    /// The schedule was made for a clock that differs from the platform's.
    #[error("the timer counts at {timer}, but the schedule was made for {schedule}")]
    Clock {
        /// The clock of the platform.
        timer: ClockSpec,
        /// The clock of the schedule.
        schedule: ClockSpec,
    },
    /// The platform's interrupts have no handler: [`Loops::run`](crate::Loops::run) connects one.
    #[error("no handler is connected to the timer's interrupt")]
    NoHandler,
    /// The handler cannot be connected to the timer's interrupt.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// The schedule has begun already.
    #[error("the schedule has already been started")]
    Started,
}

/// The reason why a handler cannot be connected to a timer's interrupt; see
/// [`Platform::connect`](crate::Platform::connect). It never occurs on processors whose interrupt
/// handlers are connected when the program is linked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum ConnectError {
    /// The platform is connected already, or the thread is connected with another platform.
    #[error(
        "the interrupt of the timer already has a handler, from this thread or from another call for this platform; only one is \
         possible"
    )]
    Connected,
    /// There is no real-time signal of this number.
    #[error("there is no real-time signal {signal}")]
    NoSuchSignal {
        /// The number of the signal.
        signal: i32,
    },
    /// The program has a handler of its own for the signal.
    #[error("signal {signal} has a handler already: choose another by `Signals::with_signal`")]
    SignalTaken {
        /// The number of the signal.
        signal: i32,
    },
    /// The program's implementation of critical sections does not keep signals out.
    #[error(
        "critical sections of this program do not keep signals out: \
         enable `critical-section` of condor-platform, and no other implementation"
    )]
    OtherSection,
    /// The operating system refuses a timer or its signal.
    #[error("cannot make a timer that sends a signal: error {os_error} of the operating system")]
    Timer {
        /// The error number of the operating system.
        os_error: i32,
    },
}

/// The reason why [`LoopLock::lock`](crate::LoopLock::lock) did not take the lock.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum LoopLockError {
    /// A loop that is faster than all declared users asked for it.
    #[error(
        "a loop that is faster than all declared users of the lock asked for it: declare this loop, too"
    )]
    Undeclared,
    /// The lock is taken already: the same context asked twice, or the caller is an interrupt
    /// handler or a context of another scheduler.
    #[error("the lock is already taken")]
    Taken,
}
