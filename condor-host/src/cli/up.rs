//! `condor up`.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use clap::Args;
use jiff::SignedDuration;

use super::{AnyError, Programs, description};
use crate::control::{Member, Status};
use crate::description::Description;
use crate::supervisor::{self, Options};

#[derive(Debug, Args)]
pub(super) struct Up {
    /// The description; the program's own, else `condor.toml`
    pub(super) file: Option<PathBuf>,
    #[command(flatten)]
    pub(super) how: How,
}

#[derive(Debug, Args)]
pub(super) struct How {
    /// Without user interface, for scripts: prints a summary at the end
    #[arg(long)]
    headless: bool,
    /// Takes the system down after this time, such as 10s or 2m
    #[arg(long = "for", value_name = "TIME", value_parser = duration)]
    duration: Option<Duration>,
    /// Prints the summary as JSON
    #[arg(long, requires = "headless")]
    json: bool,
    #[command(flatten)]
    tools: super::ui::Tools,
}

/// A time of the command line.
pub(crate) fn duration(text: &str) -> Result<Duration, String> {
    let span: SignedDuration = text
        .parse()
        .map_err(|error| format!("{error}; write for example 10s"))?;
    span.try_into()
        .map_err(|_| "a time before the beginning".into())
}

/// Fails if a program failed for good.
pub(super) fn run(
    file: Option<PathBuf>,
    how: &How,
    programs: &dyn Programs,
) -> Result<ExitCode, AnyError> {
    let file = description(file, programs);
    let description = match Description::read(&file, programs.names()) {
        Ok(description) => description,
        Err(mistakes) => {
            eprintln!("{mistakes}");
            return Ok(ExitCode::FAILURE);
        }
    };
    if !how.headless && super::ui::is_possible() {
        return super::ui::up(&file, &description.name, how.duration, &how.tools);
    }
    let options = Options {
        own: programs.names().to_vec(),
        echo: true,
        duration: how.duration,
    };
    let summary = supervisor::run(
        &description,
        options,
        |_| {},
        |directory| {
            if !how.headless {
                return;
            }
            if let Err(error) = programs.summarize(directory) {
                eprintln!("condor: no summary of the programs: {error}");
            }
        },
    )?;
    if how.headless {
        print(&summary.status, how.json)?;
    }
    Ok(if summary.failed {
        ExitCode::FAILURE
    } else {
        ExitCode::SUCCESS
    })
}

fn print(status: &Status, json: bool) -> Result<(), AnyError> {
    if json {
        println!("{}", serde_json::to_string(status)?);
        return Ok(());
    }
    println!("{} ran for {:.1} s", status.system, status.uptime);
    println!(
        "{:>6}  {:<16} {:<10} {:>8}  last exit",
        "number", "name", "state", "restarts"
    );
    for member in status.services.iter().chain(&status.processors) {
        let Member {
            number,
            name,
            state,
            restarts,
            last_exit,
            ..
        } = member;
        let last_exit = last_exit.as_deref().unwrap_or("-");
        println!("{number:>6}  {name:<16} {state:<10} {restarts:>8}  {last_exit}");
    }
    Ok(())
}
