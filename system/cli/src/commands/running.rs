//! [`Running`]: the system that a command is about.

use super::SystemChoice;
use condor_host::control::{ClockStatus, ControlClient, ControlClientError, Member, SystemStatus};
use condor_host::error::AnyError;
use condor_host::system::{self, FindError, SystemDirectory};
use condor_host::view::View;
use condor_mbox::Processor;
use condor_rt::numbers::VISITORS;

/// Returns the name of the processor or service with this number, or a description of a visitor.
pub(crate) fn name_of(status: &SystemStatus, number: Processor) -> String {
    let mut members = status.members();
    match members.find(|it| it.processor() == number) {
        Some(member) => member.name.clone(),
        None if VISITORS.contains(&number.0) => format!("visitor {}", number.0),
        None => format!("number {}", number.0),
    }
}

pub(super) struct Running {
    pub(super) directory: SystemDirectory,
    pub(super) status: SystemStatus,
}

impl Running {
    pub(super) fn find(which: &SystemChoice) -> Result<Self, AnyError> {
        let directory = system::find(which.system.as_deref())?;
        let status = ControlClient::connect(&directory)?.status()?;
        Ok(Self { directory, status })
    }

    pub(super) fn view(&self) -> Result<View, AnyError> {
        Ok(View::open(&self.directory, self.status.window_bytes)?)
    }

    /// An error if the system has ended meanwhile.
    pub(super) fn check(&self) -> Result<(), AnyError> {
        if self.directory.is_running() {
            return Ok(());
        }
        Err(format!("the system `{}` has ended", self.status.system).into())
    }

    /// The state that the simulated clock has now, if the system has one.
    pub(super) fn clock(&self) -> Result<Option<ClockStatus>, ControlClientError> {
        if self.status.clock.is_none() {
            return Ok(None);
        }
        Ok(ControlClient::connect(&self.directory)?.status()?.clock)
    }

    /// The processor or service of a name or number.
    pub(super) fn member(&self, text: &str) -> Result<&Member, FindError> {
        self.status.member(text)
    }

    /// Returns the processor with this name or number. Services are not found.
    pub(super) fn processor(&self, text: &str) -> Result<&Member, FindError> {
        self.status.processor(text)
    }
}
