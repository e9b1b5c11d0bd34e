//! What can go wrong with the machine of a process.

use std::ffi::OsString;
use std::io;
use std::path::PathBuf;

use condor_dev::linux::MapError;
use condor_mbox::linux::SystemError;

/// Why a process cannot be a processor.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ProcessError {
    /// A variable of the environment is missing.
    #[error("the environment has no {variable}: it must be {expected}")]
    Missing {
        /// Which.
        variable: &'static str,
        /// What would be right.
        expected: &'static str,
    },
    /// A variable of the environment is wrong.
    #[error("{variable} is {value:?} in the environment: it must be {expected}")]
    Wrong {
        /// Which.
        variable: &'static str,
        /// What it is.
        value: OsString,
        /// What would be right.
        expected: &'static str,
    },
    /// The number, or the memory of the processors.
    #[error(transparent)]
    System(#[from] SystemError),
    /// The file of the bus, or of the shared memory, cannot be opened.
    #[error("cannot open the {what} {path:?}: {source}")]
    Open {
        /// Which of them.
        what: &'static str,
        /// Its file.
        path: PathBuf,
        /// The system's answer.
        source: io::Error,
    },
    /// The bus cannot be mapped.
    #[error("cannot map the bus {path:?}: {source}")]
    MapBus {
        /// Its file.
        path: PathBuf,
        /// Why not.
        source: MapError,
    },
    /// The shared memory cannot be mapped.
    #[error("cannot map the shared memory {path:?}: {source}")]
    MapShared {
        /// Its file.
        path: PathBuf,
        /// Why not.
        source: condor_mbox::linux::MapError,
    },
    /// SIGTERM and SIGINT cannot be handled.
    #[error("cannot handle SIGTERM and SIGINT: {0}")]
    Stopping(io::Error),
}
