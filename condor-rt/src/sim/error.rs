//! What can go wrong with a system in virtual time.

use core::any::Any;
use core::fmt;
use std::panic;

use condor_mbox::Processor;
use condor_mbox::linux::SystemError;

use crate::numbers::PROCESSORS;

/// Why a system cannot be made, or did not run well.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SimError {
    /// The memory of the processors.
    #[error(transparent)]
    System(#[from] SystemError),
    /// There is no such number.
    #[error("{number} does not exist: a system has {PROCESSORS} processors")]
    NoSuchProcessor {
        /// The number that was given.
        number: Processor,
    },
    /// The processor has a program already.
    #[error("{number} has a program already")]
    Taken {
        /// Which.
        number: Processor,
    },
    /// A thread could not be started.
    #[error("cannot start a thread for {number}: {source}")]
    Thread {
        /// For whom.
        number: Processor,
        /// The system's answer.
        source: std::io::Error,
    },
    /// Programs failed, in the order in which they did.
    #[error("{}", joined(.0))]
    Failed(Vec<Failure>),
}

/// A program that failed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    /// Whose.
    pub number: Processor,
    /// When, in nanoseconds since the beginning.
    pub at_ns: u64,
    /// Why.
    pub cause: Cause,
}

/// How a program failed.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Cause {
    /// It ended with this error.
    Error(String),
    /// It panicked with this message.
    Panic(String),
    /// It went on for ten seconds after it was told to stop.
    NotStopping,
    /// It waited without a deadline, and nobody was left who could have rung.
    WaitsForever,
    /// A loop, or a handler of the timer, polled a clock, where time does not pass.
    Polls,
}

impl Cause {
    /// Ends the program of this thread.
    pub(super) fn unwind(self) -> ! {
        panic::resume_unwind(Box::new(self))
    }

    /// What has ended a program that did not return.
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

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (seconds, ns) = (self.at_ns / 1_000_000_000, self.at_ns % 1_000_000_000);
        write!(f, "{} at {seconds}.{ns:09} s: ", self.number)?;
        match &self.cause {
            Cause::Error(text) => f.write_str(text),
            Cause::Panic(text) => write!(f, "it panicked: {text}"),
            Cause::NotStopping => f.write_str("it did not stop when it was told to"),
            Cause::Polls => f.write_str("a loop polls a clock, which stands still meanwhile"),
            Cause::WaitsForever => {
                f.write_str("it waits without a deadline, and nobody is left to ring it")
            }
        }
    }
}

fn joined(failures: &[Failure]) -> String {
    let lines: Vec<String> = failures.iter().map(ToString::to_string).collect();
    lines.join("\n")
}
