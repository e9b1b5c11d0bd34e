//! `condor up`.

use std::cell::Cell;
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{Command, ExitCode};
use std::time::Duration;

use clap::Args;

use super::clock::ClockOptions;
use super::summary::Summary;
use super::{AnyError, Application, code, description};
use crate::commands::number::duration;
use crate::screen;
use condor_host::description::{ProcessorEntry, SystemDescription};
use condor_host::error::tell;
use condor_host::plain::shown_lines;
use condor_host::services::terminals;
use condor_host::supervisor::{self, SupervisorOptions, reaper};
use condor_host::system::SystemDirectory;

#[derive(Debug, Args)]
pub(super) struct Up {
    /// The file of the description; by default the one for which this program was built, or else `condor.toml`
    pub(super) file: Option<PathBuf>,
    #[command(flatten)]
    pub(super) how: How,
}

#[derive(Debug, Args)]
#[allow(
    clippy::struct_excessive_bools,
    reason = "each is a switch of the command line"
)]
pub(super) struct How {
    /// Runs without the user interface, for scripts, and prints a summary at the end
    #[arg(long)]
    headless: bool,
    /// Only the user interface uses this option: a person types there, and no lines come from the description
    #[arg(long, hide = true, requires = "headless")]
    attended: bool,
    /// Only `up` itself uses this option: this process is the supervisor; its parent waits for it, and ends what it
    /// leaves behind
    #[arg(long, hide = true)]
    kept: bool,
    /// Stops the system after this time, such as 10s or 2m: simulated time if the clock is simulated
    #[arg(long = "for", value_name = "TIME", value_parser = duration)]
    duration: Option<Duration>,
    /// Prints the summary as JSON; needs --headless
    #[arg(long, requires = "headless")]
    json: bool,
    #[command(flatten)]
    clock: ClockOptions,
    #[command(flatten)]
    tools: super::ui::Tools,
}

/// Runs what this process was called with as the supervisor, which this one keeps.
fn keep() -> Result<ExitCode, AnyError> {
    let mut words = std::env::args_os();
    let mut supervisor = Command::new(std::env::current_exe()?);
    if let Some(name) = words.next() {
        supervisor.arg0(name);
    }
    let mut words = words.peekable();
    supervisor.args(words.next_if(|word| word == "up"));
    supervisor.arg("--kept").args(words);
    let status = reaper::keep(supervisor)?;
    if status.code().is_none() {
        tell(format_args!(
            "the supervisor was killed ({status}), and so were all programs"
        ));
    }
    Ok(code(status.success()))
}

/// Returns a failure if the system did not come up, if a program failed for good, or if a program
/// that was not stopped does not run at the end.
pub(super) fn run(
    file: Option<PathBuf>,
    how: &How,
    application: &dyn Application,
) -> Result<ExitCode, AnyError> {
    let file = description(file, application);
    let mut description = match SystemDescription::read(&file, application) {
        Ok(description) => description,
        Err(mistakes) => {
            eprintln!("{mistakes}");
            return Ok(ExitCode::FAILURE);
        }
    };
    how.clock.apply(&mut description.clock)?;
    let typing = how.clock.script(&description)?;
    if !how.headless && !how.kept && screen::is_possible() {
        let words = how.clock.words();
        let name = &description.name;
        return super::ui::up(
            &file,
            name,
            how.duration,
            &words,
            &how.tools,
            application,
            None,
        );
    }
    if !how.kept {
        return keep();
    }
    let is_typed = typing.is_some();
    let options = SupervisorOptions {
        own: application.programs(),
        // Nobody reads it at once, and the log has it.
        echo: !how.attended,
        attended: how.attended,
        duration: how.duration,
        typing,
        adopts: true,
    };
    let seen = Cell::new(Summary::default());
    let ended = supervisor::run(
        &description,
        options,
        || application.prepare(&description),
        |directory| {
            if how.headless && !how.attended && !is_typed {
                type_lines(&description, directory);
            }
        },
        |directory, status| {
            if !how.headless {
                return;
            }
            match Summary::look(directory, status) {
                Ok(summary) => seen.set(summary),
                Err(error) => {
                    tell(format_args!(
                        "cannot read loops and messages for the summary: {error}"
                    ));
                }
            }
            if how.json {
                return;
            }
            if !how.attended {
                print_answers(&description, directory);
            }
            if let Err(error) = application.summarize(&description, directory) {
                tell(format_args!(
                    "cannot print the summary of the programs: {error}"
                ));
            }
        },
    )?;
    if how.headless {
        seen.into_inner().print(&ended.status, how.json)?;
    }
    Ok(code(!ended.failed))
}

/// The processors at whose terminals lines are typed.
fn typed_at(description: &SystemDescription) -> impl Iterator<Item = &ProcessorEntry> {
    let processors = description.processors.iter();
    processors.filter(|processor| !processor.headless.is_empty())
}

/// Prints what was said at the terminals at which lines were typed.
fn print_answers(description: &SystemDescription, directory: &SystemDirectory) {
    for ProcessorEntry { name, .. } in typed_at(description) {
        match std::fs::read(terminals::log(&directory.terminals(), name)) {
            Ok(said) => {
                let said = shown_lines(&String::from_utf8_lossy(&said));
                println!("terminal of {name}:\n{said}\n");
            }
            Err(error) => {
                tell(format_args!(
                    "cannot read the log of the terminal of {name}: {error}"
                ));
            }
        }
    }
}

/// Types what the description says.
fn type_lines(description: &SystemDescription, directory: &SystemDirectory) {
    for ProcessorEntry { name, headless, .. } in typed_at(description) {
        let text = headless.join("\n") + "\n";
        if let Err(error) = terminals::type_in(directory, name, text.as_bytes()) {
            tell(format_args!(
                "cannot type at the terminal of {name}: {error}"
            ));
        }
    }
}
