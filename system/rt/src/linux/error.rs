//! Errors of the machine of a process.

use std::io;
use std::path::PathBuf;

use condor_dev::linux::BusMapError;
use condor_mbox::linux::SystemError;

/// The environment variable with the settings.
pub(super) const VARIABLE: &str = "CONDOR_PROCESS";

/// The reason why a process of Linux cannot be a processor: its settings, its memory, its bus, its
/// clock or its signals.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ProcessError {
    /// The environment has no settings of a process.
    #[error(
        "the environment has no {VARIABLE}: a supervisor such as `condor up` starts this program with it"
    )]
    Missing,
    /// A setting is missing, or has a value that is not allowed.
    #[error("{VARIABLE} in the environment is wrong: {0}")]
    Wrong(String),
    /// The processor's number could not be claimed, or the memory of the processors could not be
    /// opened.
    #[error(transparent)]
    System(#[from] SystemError),
    /// A UIO device, the serial port, or the file of the bus, of the shared memory or of the simulated clock could not
    /// be opened.
    #[error("cannot open the {what} {path:?}: {source}")]
    Open {
        /// `UIO device`, `serial port`, `bus`, `shared memory` or `simulated clock`.
        what: &'static str,
        /// The path of the file.
        path: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// The bus could not be mapped.
    #[error("cannot map the bus, the device registers in {path:?}: {source}")]
    MapBus {
        /// The path of the file.
        path: PathBuf,
        /// The reason.
        source: BusMapError,
    },
    /// A memory that processes share could not be mapped.
    #[error("cannot map the {what} {path:?}: {source}")]
    MapShared {
        /// `shared memory` or `simulated clock`.
        what: &'static str,
        /// The path of the file.
        path: PathBuf,
        /// The reason.
        source: condor_mbox::linux::WindowMapError,
    },
    /// The page of the simulated clock does not fit into the file at this offset, or the offset is not a multiple of 64.
    #[error(
        "{path:?} cannot have the page of a simulated clock at offset {offset:#x}: the offset must be a multiple of 64, \
         and the whole page in the file"
    )]
    ClockPlace {
        /// The path of the file.
        path: PathBuf,
        /// The offset of the page, in bytes from the beginning of the file.
        offset: u64,
    },
    /// The file holds no page of a simulated clock, or its page has another version.
    #[error(transparent)]
    Clock(#[from] condor_clock::PageError),
    /// Handlers for SIGTERM and SIGINT could not be registered.
    #[error("cannot handle SIGTERM and SIGINT: {0}")]
    Stopping(io::Error),
    /// Handlers for the signals of fatal errors could not be registered.
    #[error("cannot handle SIGSEGV and other signals of fatal errors: {0}")]
    Fatal(io::Error),
}

impl ProcessError {
    pub(super) fn wrong(problem: &impl ToString) -> Self {
        Self::Wrong(problem.to_string())
    }
}
