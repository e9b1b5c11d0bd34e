//! The services of a running system, each in a process of its own.
//!
//! A service may be killed at any moment: the supervisor restarts it, and it continues.

pub mod files;
pub mod terminals;

use std::time::Duration;

use condor_mbox::linux::{Claim, SystemError};
use condor_mbox::{Error, Processor};

use crate::error::FileError;
use crate::system::Windows;
use condor_rt::linux::{Environment, MappedPage, ProcessError};
use condor_rt::numbers::PROCESSORS;

/// The longest wait for a number whose previous service is exiting.
const SUCCESSION: Duration = Duration::from_secs(5);

/// The reason for which a service could not start, or has ended.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ServiceError {
    /// The environment of the process does not describe a service: a supervisor did not start it.
    #[error(transparent)]
    Environment(#[from] ProcessError),
    /// The processors' shared memory (the windows) cannot be opened.
    #[error(transparent)]
    Windows(#[from] SystemError),
    /// Its mailbox returned this error.
    #[error(transparent)]
    Mailbox(#[from] Error),
    /// The file server returned this error.
    #[error(transparent)]
    Files(#[from] condor_fs::server::ServerError),
    /// An operation on one of its files failed.
    #[error(transparent)]
    File(#[from] FileError),
    /// Signals could not be handled, or the wait for events failed.
    #[error("cannot wait for events: {0}")]
    Events(std::io::Error),
}

/// Claims `number` of the system that the environment names, and opens the page of its simulated
/// clock, if it has one.
fn claim(number: Processor) -> Result<(Claim<PROCESSORS>, Option<MappedPage>), ServiceError> {
    let environment = Environment::read()?;
    let system = Windows::at(environment.system, environment.window_bytes)?;
    let page = environment.clock.as_ref().map(MappedPage::open);
    Ok((system.claim_within(number, SUCCESSION)?, page.transpose()?))
}
