//! The services of a running system, each in a process of its own.
//!
//! They may be killed at any moment: the supervisor starts them again, and they go on where they
//! stopped.

pub mod files;
pub mod terminals;

use condor_mbox::linux::{Claim, SystemError};
use condor_mbox::{Error, Processor};

use crate::system::Windows;
use condor_rt::linux::{Environment, ProcessError};
use condor_rt::numbers::PROCESSORS;

/// Why a service does not serve.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ServiceError {
    /// It was not started by a supervisor.
    #[error(transparent)]
    Environment(#[from] ProcessError),
    /// The windows.
    #[error(transparent)]
    Windows(#[from] SystemError),
    /// Its mailbox.
    #[error(transparent)]
    Mailbox(#[from] Error),
    /// The file server.
    #[error(transparent)]
    Files(#[from] condor_fs::server::ServerError),
    /// A file of its own.
    #[error("cannot {doing} {path:?}: {source}")]
    File {
        /// What was tried.
        doing: &'static str,
        /// With which file.
        path: std::path::PathBuf,
        /// The answer.
        source: std::io::Error,
    },
    /// Signals, or the wait for events.
    #[error("cannot wait for events: {0}")]
    Events(std::io::Error),
}

impl ServiceError {
    fn at(
        doing: &'static str,
        path: &std::path::Path,
    ) -> impl FnOnce(std::io::Error) -> Self + use<> {
        let path = path.into();
        move |source| Self::File {
            doing,
            path,
            source,
        }
    }
}

/// Claims `number` of the system that the environment names.
fn claim(number: Processor) -> Result<Claim<PROCESSORS>, ServiceError> {
    let environment = Environment::read()?;
    let system = Windows::at(environment.system, environment.window_bytes)?;
    Ok(system.claim(number)?)
}
