//! [`RunningSystem`]: the system that is served, which may end and come back.

use std::time::{Duration, Instant};

use condor_host::control::{ControlClient, SystemStatus};
use condor_host::error::AnyError;
use condor_host::system::{self, SystemDirectory};
use condor_rt::linux::Environment;

/// The time between two looks whether the system still runs.
const LOOK: Duration = Duration::from_secs(1);
/// The time that its supervisor may take to answer.
const ANSWER: Duration = Duration::from_secs(5);

/// The choice of the running system that a gateway serves.
#[derive(Clone, Debug)]
pub enum SystemChoice {
    /// The system whose supervisor has started this process.
    Own(SystemDirectory),
    /// The system of this name; with `None`, the only one that runs.
    Named(Option<String>),
}

impl SystemChoice {
    /// Chooses the system whose supervisor has started this process as a service, as `environment` says. Without
    /// `environment`, chooses the system called `name`, or, without a name, the only one that runs.
    #[must_use]
    pub fn of(environment: Option<&Environment>, name: Option<String>) -> Self {
        let own = environment.and_then(|it| it.system.parent());
        own.map_or(Self::Named(name), |own| {
            Self::Own(SystemDirectory::at(own.into()))
        })
    }

    /// Finds the system.
    ///
    /// # Errors
    /// An error that says why it cannot be asked.
    pub(crate) fn find(&self) -> Result<RunningSystem, AnyError> {
        let directory = match self {
            Self::Own(directory) => directory.clone(),
            Self::Named(name) => system::find(name.as_deref())?,
        };
        let status = status(&directory)?;
        Ok(RunningSystem {
            directory,
            status,
            looked: Instant::now(),
        })
    }
}

/// A system that runs, or did so a moment ago.
#[derive(Debug)]
pub(crate) struct RunningSystem {
    /// The directory of the system.
    pub(crate) directory: SystemDirectory,
    /// Its state when it was found.
    pub(crate) status: SystemStatus,
    looked: Instant,
}

impl RunningSystem {
    /// Returns true if it is still the same one; it looks once a second.
    pub(crate) fn is_there(&mut self) -> bool {
        if self.looked.elapsed() < LOOK {
            return true;
        }
        self.looked = Instant::now();
        status(&self.directory).is_ok_and(|now| now.pid == self.status.pid)
    }
}

/// Asks a supervisor for the state of its system.
///
/// # Errors
/// An error that says why there is no answer.
pub(crate) fn status(directory: &SystemDirectory) -> Result<SystemStatus, AnyError> {
    let mut client = ControlClient::connect(directory)?;
    client.set_timeout(Some(ANSWER))?;
    Ok(client.status()?)
}
