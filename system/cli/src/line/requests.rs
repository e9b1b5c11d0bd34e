//! Commands that ask the supervisor of a running system.

use clap::Args;

use super::AnyError;
use crate::commands::SystemChoice;
use condor_host::control::{ControlClient, ControlClientError, ControlRequest, from_here, told_of};
use condor_host::supervisor;
use condor_host::system;

#[derive(Debug, Args)]
pub(super) struct OneProcessor {
    /// The name or the number of the processor, or the name of a service
    processor: String,
    #[command(flatten)]
    which: SystemChoice,
}

#[derive(Debug, Args)]
pub(super) struct Load {
    /// The name or the number of the processor
    processor: String,
    /// The program: a path, a name that is looked for as in the description (beside it, beside this binary and in
    /// PATH), or `self` for one that this binary contains
    program: String,
    /// The arguments of the program; if PROGRAM is `self`, the first one names a program of this binary
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    arguments: Vec<String>,
    #[command(flatten)]
    which: SystemChoice,
}

fn connect(which: &SystemChoice) -> Result<ControlClient, AnyError> {
    Ok(ControlClient::connect(&system::find(
        which.system.as_deref(),
    )?)?)
}

pub(super) fn stop(one: OneProcessor) -> Result<(), AnyError> {
    let processor = one.processor;
    connect(&one.which)?.ask(&ControlRequest::Stop { processor })?;
    Ok(())
}

pub(super) fn start(one: OneProcessor) -> Result<(), AnyError> {
    let processor = one.processor;
    connect(&one.which)?.ask(&ControlRequest::Start { processor })?;
    Ok(())
}

pub(super) fn restart(one: OneProcessor) -> Result<(), AnyError> {
    let processor = one.processor;
    connect(&one.which)?.ask(&ControlRequest::Restart {
        processor,
        held: false,
    })?;
    Ok(())
}

pub(super) fn load(load: Load) -> Result<(), AnyError> {
    let program = from_here(load.program)?;
    connect(&load.which)?.ask(&ControlRequest::Load {
        processor: load.processor,
        program,
        arguments: load.arguments,
    })?;
    Ok(())
}

pub(super) fn down(which: &SystemChoice) -> Result<(), AnyError> {
    let directory = system::find(which.system.as_deref())?;
    let killed = match ControlClient::connect(&directory)?.down() {
        Err(error @ ControlClientError::TimedOut { .. }) => {
            return Err(match supervisor::process_of(&directory) {
                Some(process) => format!(
                    "{error}; `kill -9 {process}` ends the supervisor, and with it all programs"
                ),
                None => error.to_string(),
            }
            .into());
        }
        other => other?,
    };
    if let Some(text) = told_of(&killed) {
        println!("{text}");
    }
    Ok(())
}
