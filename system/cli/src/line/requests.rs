//! Commands that ask the supervisor of a running system.

use clap::Args;

use super::AnyError;
use crate::commands::Which;
use condor_host::control::{Client, ClientError, Request, follow, from_here, told_of};
use condor_host::plain::{plain, plain_json};
use condor_host::supervisor;
use condor_host::system;

#[derive(Debug, Args)]
pub(super) struct One {
    /// The name or the number of the processor, or the name of a service
    processor: String,
    #[command(flatten)]
    which: Which,
}

#[derive(Debug, Args)]
pub(super) struct Load {
    /// The name or the number of the processor
    processor: String,
    /// The program: a path, a name that is searched as in the description, or `self` for one that this binary contains
    program: String,
    /// The arguments of the program; after `self`, the first is the name of the program
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    arguments: Vec<String>,
    #[command(flatten)]
    which: Which,
}

#[derive(Debug, Args)]
pub(super) struct Log {
    /// Also shows new lines as they come, until the system ends
    #[arg(short, long)]
    follow: bool,
    /// The number of earlier lines to show
    #[arg(short = 'n', long, default_value_t = 50)]
    lines: usize,
    /// Prints each line as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    which: Which,
}

fn connect(which: &Which) -> Result<Client, AnyError> {
    Ok(Client::connect(&system::find(which.system.as_deref())?)?)
}

pub(super) fn stop(one: One) -> Result<(), AnyError> {
    let processor = one.processor;
    connect(&one.which)?.ask(&Request::Stop { processor })?;
    Ok(())
}

pub(super) fn start(one: One) -> Result<(), AnyError> {
    let processor = one.processor;
    connect(&one.which)?.ask(&Request::Start { processor })?;
    Ok(())
}

pub(super) fn restart(one: One) -> Result<(), AnyError> {
    let processor = one.processor;
    connect(&one.which)?.ask(&Request::Restart { processor })?;
    Ok(())
}

pub(super) fn load(load: Load) -> Result<(), AnyError> {
    let program = from_here(load.program)?;
    connect(&load.which)?.ask(&Request::Load {
        processor: load.processor,
        program,
        arguments: load.arguments,
    })?;
    Ok(())
}

pub(super) fn down(which: &Which) -> Result<(), AnyError> {
    let directory = system::find(which.system.as_deref())?;
    let killed = match Client::connect(&directory)?.down() {
        Err(error @ ClientError::TimedOut { .. }) => {
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

pub(super) fn log(log: &Log) -> Result<(), AnyError> {
    let directory = system::find(log.which.system.as_deref())?;
    let (lines, events) = follow(&directory, log.lines)?;
    for line in &lines {
        if log.json {
            println!("{}", plain_json(&serde_json::json!({ "line": line }))?);
        } else {
            println!("{}", plain(line));
        }
    }
    let followed = if log.follow { usize::MAX } else { 0 };
    for event in events.take(followed) {
        let event = event?;
        if log.json {
            println!("{}", plain_json(&event)?);
        } else {
            println!("{}", plain(&event.to_string()));
        }
    }
    Ok(())
}
