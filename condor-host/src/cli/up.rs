//! `condor up`.

use std::cell::Cell;
use std::io::{self, Write as _};
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use clap::Args;
use jiff::SignedDuration;

use super::summary::Summary;
use super::{AnyError, Programs, description};
use crate::description::Description;
use crate::supervisor::{self, Options};
use crate::system::Directory;

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
    /// Somebody is there to type all the same: at the user interface that started this supervisor
    #[arg(long, hide = true, requires = "headless")]
    attended: bool,
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
    programs.prepare(&description)?;
    let options = Options {
        own: programs.names().to_vec(),
        echo: true,
        duration: how.duration,
    };
    let seen = Cell::new(Summary::default());
    let ended = supervisor::run(
        &description,
        options,
        |directory| {
            if how.headless && !how.attended {
                type_lines(&description, directory);
            }
        },
        |directory, status| {
            if !how.headless {
                return;
            }
            match Summary::look(directory, status) {
                Ok(summary) => seen.set(summary),
                Err(error) => eprintln!("condor: no summary of the windows: {error}"),
            }
            if !how.json
                && let Err(error) = programs.summarize(&description, directory)
            {
                eprintln!("condor: no summary of the programs: {error}");
            }
        },
    )?;
    if how.headless {
        seen.into_inner().print(&ended.status, how.json)?;
    }
    Ok(if ended.failed {
        ExitCode::FAILURE
    } else {
        ExitCode::SUCCESS
    })
}

/// How long the terminal service may take to find a terminal.
const TERMINAL: Duration = Duration::from_secs(10);

/// Types what the description says, each processor's lines from a thread that nothing waits for.
fn type_lines(description: &Description, directory: &Directory) {
    for processor in &description.processors {
        if processor.headless.is_empty() {
            continue;
        }
        let socket = directory.terminal(&processor.name);
        let (name, text) = (processor.name.clone(), processor.headless.join("\n") + "\n");
        std::thread::spawn(move || {
            if let Err(error) = type_at(&socket, &text) {
                eprintln!("condor: nothing can be typed at the terminal of {name}: {error}");
            }
        });
    }
}

fn type_at(socket: &Path, text: &str) -> io::Result<()> {
    let deadline = Instant::now() + TERMINAL;
    let mut terminal = loop {
        match UnixStream::connect(socket) {
            Ok(terminal) => break terminal,
            Err(error) if Instant::now() >= deadline => return Err(error),
            // It appears when the service has found the terminal in the program's window.
            Err(_) => std::thread::sleep(Duration::from_millis(20)),
        }
    };
    terminal.write_all(text.as_bytes())?;
    terminal.shutdown(Shutdown::Write)?;
    // What the program answers is in its log; the service closes when it has taken all.
    io::copy(&mut terminal, &mut io::sink())?;
    Ok(())
}
