//! Why loops cannot run on Linux.

use std::io;

use thiserror::Error;

use crate::error::LoopError;

/// Why a thread cannot be connected with [`Signals`](super::Signals).
#[derive(Debug, Error)]
pub enum SignalError {
    /// The thread is connected already, or another thread is.
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
    /// The kernel refuses a timer or its signal.
    #[error("the kernel refuses a timer with a signal: {0}")]
    Timer(#[from] io::Error),
}

/// Why a loop of [`Threads`](super::Threads) cannot begin.
#[derive(Debug, Error)]
pub enum ThreadError {
    /// The call names the loop wrongly.
    #[error(transparent)]
    Loop(#[from] LoopError),
    /// The kernel refuses a thread.
    #[error("the kernel refuses a thread for a loop: {0}")]
    Spawn(#[source] io::Error),
}
