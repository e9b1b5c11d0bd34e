//! The services of a running system, each in a process of its own.
//!
//! They may be killed at any moment: the supervisor starts them again, and they go on where they
//! stopped.

pub mod files;
pub mod terminals;

use std::env::VarError;

use condor_mbox::linux::{Claim, SystemError};
use condor_mbox::{Error, Processor};

use crate::numbers::PROCESSORS;
use crate::system::{Windows, environment};

/// Why a service does not serve.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ServiceError {
    /// It was not started by a supervisor.
    #[error("the environment has no {name} that can be used: {reason}; supervisors start services")]
    Environment {
        /// The variable.
        name: &'static str,
        /// What is wrong with it.
        reason: String,
    },
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
    let directory = variable(environment::SYSTEM)?;
    let bytes = variable(environment::WINDOW_BYTES)?;
    let bytes = bytes.parse().map_err(|_| ServiceError::Environment {
        name: environment::WINDOW_BYTES,
        reason: format!("`{bytes}` is no number"),
    })?;
    Ok(Windows::at(directory, bytes)?.claim(number)?)
}

fn variable(name: &'static str) -> Result<String, ServiceError> {
    std::env::var(name).map_err(|error: VarError| ServiceError::Environment {
        name,
        reason: error.to_string(),
    })
}
