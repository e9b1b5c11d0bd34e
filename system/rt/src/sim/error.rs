//! Errors of a system in virtual time.

use core::any::Any;
use core::fmt;
use std::panic;

use condor_clock::ClockFault;
use condor_mbox::Processor;
use condor_mbox::linux::SystemError;

use crate::numbers::PROCESSORS;

/// The reason why a [`VirtualSystem`](super::VirtualSystem) cannot be made or set up, or why its
/// run has failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SimError {
    /// The memory of the processors could not be made or claimed.
    #[error(transparent)]
    System(#[from] SystemError),
    /// The system has no processor with this number.
    #[error("{number} does not exist: a system has {PROCESSORS} processors, numbered from 0")]
    NoSuchProcessor {
        /// The number that was given.
        number: Processor,
    },
    /// The processor has a program already.
    #[error("{number} has a program already")]
    Taken {
        /// The number of the processor.
        number: Processor,
    },
    /// A thread could not be started.
    #[error("cannot start a thread for {number}: {source}")]
    Thread {
        /// The number of the processor whose program the thread was made for.
        number: Processor,
        /// The error of the operating system.
        source: std::io::Error,
    },
    /// Programs failed; the list is in the order of their failures.
    #[error("{}", joined(.0))]
    Failed(Vec<SimFailure>),
}

/// The failure of one program in a run of a [`VirtualSystem`](super::VirtualSystem): the processor,
/// the instant and the cause.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SimFailure {
    /// The number of the program's processor.
    pub number: Processor,
    /// The instant of the failure, in nanoseconds since the beginning of the run.
    pub at_ns: u64,
    /// The error, panic or other fault by which the program failed.
    pub cause: Cause,
}

/// The cause for which a program in virtual time has failed: an error, a panic, or a wrong use of
/// time, such as a wait that can never end.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Cause {
    /// The program returned an error, which has this text.
    Error(String),
    /// The program panicked with this message.
    Panic(String),
    /// The program still ran ten seconds of its time after it was told to stop.
    NotStopping,
    /// The program waited without a deadline, and no processor was left that could ring it.
    WaitsForever,
    /// A loop, or a handler of the timer, read a clock again and again to wait, although no time
    /// passes while it runs.
    Polls,
}

impl From<ClockFault> for Cause {
    fn from(fault: ClockFault) -> Self {
        match fault {
            ClockFault::NotStopping => Self::NotStopping,
            ClockFault::WaitsForever => Self::WaitsForever,
            ClockFault::Polls => Self::Polls,
        }
    }
}

impl Cause {
    /// Ends the program of this thread.
    pub(super) fn unwind(self) -> ! {
        panic::resume_unwind(Box::new(self))
    }

    /// Returns the cause of the end of a program that did not return.
    pub(super) fn of(payload: Box<dyn Any + Send>) -> Self {
        let payload = match payload.downcast::<Self>() {
            Ok(cause) => return *cause,
            Err(payload) => payload,
        };
        Self::Panic(match payload.downcast::<String>() {
            Ok(text) => *text,
            Err(payload) => payload
                .downcast_ref::<&str>()
                .map_or_else(|| "no message".into(), |text| (*text).into()),
        })
    }
}

impl fmt::Display for SimFailure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (seconds, ns) = (self.at_ns / 1_000_000_000, self.at_ns % 1_000_000_000);
        write!(f, "{} at {seconds}.{ns:09} s: ", self.number)?;
        match &self.cause {
            Cause::Error(text) => f.write_str(text),
            Cause::Panic(text) => write!(f, "it panicked: {text}"),
            Cause::NotStopping => f.write_str("it did not stop when it was asked to"),
            Cause::Polls => f.write_str(
                "one of its loops polls a clock, which stands still until the loop waits",
            ),
            Cause::WaitsForever => {
                f.write_str("it waits without a deadline, and no other program can wake it")
            }
        }
    }
}

fn joined(failures: &[SimFailure]) -> String {
    let lines: Vec<String> = failures.iter().map(ToString::to_string).collect();
    lines.join("\n")
}
