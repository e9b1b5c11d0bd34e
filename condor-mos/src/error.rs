//! What can be wrong with rates, and with calls.

use thiserror::Error;

use crate::clock::Clock;
use crate::rate::Rate;
use crate::scheduler::LoopId;

/// Why a set of rates has no schedule.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum RateError {
    /// A period is shorter than a tick, or no whole number of ticks in any countable time.
    #[error("a rate of {rate} has no grid in ticks of {frequency}")]
    TooFast {
        /// The rate.
        rate: Rate,
        /// Ticks per second.
        frequency: Rate,
    },
    /// The set repeats so seldom that its events do not fit the table.
    #[error(
        "the rates take {needed} entries, the event table has {capacity}: use a larger one, or a \
         scan"
    )]
    TooManyEvents {
        /// What [`entries`](crate::entries) returns for the rates and their phases.
        needed: usize,
        /// Entries that the table has.
        capacity: usize,
    },
    /// A loop's first release is not within its first period.
    #[error("a phase of {phase} ticks is not less than the period of {rate}")]
    Phase {
        /// The loop's rate.
        rate: Rate,
        /// Ticks from the start to its first release.
        phase: u32,
    },
    /// There are too many rates, or none.
    #[error("a schedule of 1 to {capacity} loops cannot have {loops}")]
    Loops {
        /// How many rates there are.
        loops: usize,
        /// How many the schedule has room for.
        capacity: usize,
    },
}

impl RateError {
    /// What is wrong, for an error of compilation, which cannot print values.
    pub(crate) const fn message(self) -> &'static str {
        match self {
            Self::TooFast { .. } => "a rate is faster than the timer's ticks",
            Self::TooManyEvents { .. } => {
                "the event table is too small for these rates: use a larger one, or a scan"
            }
            Self::Phase { .. } => "a phase is not less than the period",
            Self::Loops { .. } => "there are too many rates, or none",
        }
    }
}

/// Why a call that names a loop cannot be done.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum LoopError {
    /// The schedule has fewer loops.
    #[error("there is no loop {}: the schedule has loops 0 to {}", id.0, loops - 1)]
    NoSuchLoop {
        /// Its name.
        id: LoopId,
        /// How many there are.
        loops: u8,
    },
    /// The loop already has something to run.
    #[error("loop {} already has something to run", id.0)]
    Taken {
        /// The loop.
        id: LoopId,
    },
    /// The loop has nothing to run.
    #[error("loop {} has nothing to run yet", id.0)]
    Unassigned {
        /// The loop.
        id: LoopId,
    },
    /// There is no schedule for the rate that it was to have.
    #[error(transparent)]
    Rate(#[from] RateError),
    /// What runs the loop keeps no statistics: [`NoStatistics`](crate::NoStatistics).
    #[error("there are no statistics of loop {}: its scheduler keeps none", id.0)]
    NoStatistics {
        /// The loop.
        id: LoopId,
    },
    /// The operating system has no thread for the loop.
    #[error("no thread for loop {}: error {os_error} of the operating system", id.0)]
    NoThread {
        /// The loop.
        id: LoopId,
        /// The system's number of the error.
        os_error: i32,
    },
}

/// Why a schedule cannot begin.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum StartError {
    /// The schedule counts the ticks of another clock.
    #[error("the timer counts at {timer}, the schedule was made for {schedule}")]
    Clock {
        /// The platform's.
        timer: Clock,
        /// The schedule's.
        schedule: Clock,
    },
    /// The platform's interrupts have nothing to call: [`Loops::run`](crate::Loops::run) connects them.
    #[error("no handler is connected to the timer's interrupt")]
    NoHandler,
    /// The handler cannot be connected to the timer's interrupt.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// It has already begun.
    #[error("the schedule has already been started")]
    Started,
}

/// Why a handler cannot be connected to a timer's interrupt, see
/// [`Platform::connect`](crate::Platform::connect). On a processor whose interrupts are connected when
/// its program is linked, there is no such error.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum ConnectError {
    /// The platform is connected already, or the thread is with another one.
    #[error("the thread or the platform is connected already")]
    Connected,
    /// There are not so many real-time signals.
    #[error("there is no signal {signal}")]
    NoSuchSignal {
        /// Its number.
        signal: i32,
    },
    /// The program has a handler of its own for the signal.
    #[error("signal {signal} has a handler already: choose another by `Signals::with_signal`")]
    SignalTaken {
        /// Its number.
        signal: i32,
    },
    /// Critical sections of this program do not keep signals out.
    #[error(
        "critical sections of this program do not keep signals out: \
         enable `critical-section` of condor-platform, and no other implementation"
    )]
    OtherSection,
    /// The operating system refuses a timer or its signal.
    #[error("no timer with a signal: error {os_error} of the operating system")]
    Timer {
        /// The system's number of the error.
        os_error: i32,
    },
}

/// Why a [`LoopLock`](crate::LoopLock) cannot be taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum LockError {
    /// Someone faster than all declared users asked for it.
    #[error("a loop that is faster than all declared users of the lock asked for it")]
    Undeclared,
    /// It is taken: asked for twice, or by an interrupt handler, or by what runs other loops.
    #[error("the lock is already taken")]
    Taken,
}
