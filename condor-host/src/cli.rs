//! The command line of `condor`, and of programs that are `condor` with programs of their own.
//!
//! A package with programs for its processors has one binary, which contains `condor` and all of
//! them:
//!
//! ```no_run
//! use std::process::ExitCode;
//! use condor_host::cli::{self, Programs};
//!
//! fn servo(_arguments: Vec<String>) -> ExitCode {
//!     ExitCode::SUCCESS // Here the program runs until it is told to end.
//! }
//!
//! fn main() -> ExitCode {
//!     cli::main(&Programs::new(&[("servo", servo)]))
//! }
//! ```

mod new;
mod requests;
mod service;
mod summary;
mod ui;
mod up;

pub(crate) use up::duration;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, CommandFactory, Parser, Subcommand};

use crate::commands;
use crate::description::Description;
use crate::extension::Extension;
use crate::plain::plain_lines;
use crate::system::SystemDirectory;

/// A program: gets its arguments, and runs in the process that a supervisor started for it. Most
/// such functions call [`linux::run`](condor_rt::linux::run).
pub type Run = fn(Vec<String>) -> ExitCode;

/// The parts that a binary adds to `condor`. If it adds only programs and extensions, use
/// [`Programs`].
pub trait Application: Sync {
    /// Returns the programs with their names. With `program = "self"` in a description, the first
    /// argument is such a name.
    fn programs(&self) -> &[(&'static str, Run)];

    /// Returns the file of the description that commands use if none is named.
    fn description(&self) -> Option<PathBuf> {
        None
    }

    /// Returns the extensions: further kinds of processors, and further services.
    fn extensions(&self) -> &[&'static dyn Extension] {
        &[]
    }

    /// Checks the robot's configuration in the file `robot`, which the description names.
    ///
    /// # Errors
    /// An error that says what is wrong with it.
    fn check_robot(&self, robot: &Path) -> Result<(), AnyError> {
        Err(format!(
            "{} has no use for {}; leave `robot` out",
            me(),
            robot.display()
        )
        .into())
    }

    /// Makes what the programs of a system need, such as files that they load. `condor up` calls it
    /// before it starts them; no other run of the system is alive then.
    ///
    /// # Errors
    /// An error that says what cannot be made; the system is not started then.
    fn prepare(&self, description: &Description) -> Result<(), AnyError> {
        let _ = description;
        Ok(())
    }

    /// Writes a summary of the system in `directory`, beside that of its loops and messages. In a
    /// run without user interface, it is called at the end, before the programs are stopped.
    ///
    /// # Errors
    /// An error that says why there is no summary.
    fn summarize(
        &self,
        description: &Description,
        directory: &SystemDirectory,
    ) -> Result<(), AnyError> {
        let _ = (description, directory);
        Ok(())
    }
}

/// An application that adds programs by their names, and extensions. If no description is named, it
/// uses `condor.toml` in the working directory.
#[derive(Clone, Copy, Default)]
pub struct Programs<'p> {
    programs: &'p [(&'static str, Run)],
    extensions: &'p [&'static dyn Extension],
}

impl<'p> Programs<'p> {
    /// Makes an application of programs with their names.
    #[must_use]
    pub const fn new(programs: &'p [(&'static str, Run)]) -> Self {
        Self {
            programs,
            extensions: &[],
        }
    }

    /// Adds these extensions.
    #[must_use]
    pub const fn with(mut self, extensions: &'p [&'static dyn Extension]) -> Self {
        self.extensions = extensions;
        self
    }
}

impl Application for Programs<'_> {
    fn programs(&self) -> &[(&'static str, Run)] {
        self.programs
    }

    fn extensions(&self) -> &[&'static dyn Extension] {
        self.extensions
    }
}

/// Brings up a robot whose processors share memory with this machine, and looks after it.
#[derive(Debug, Parser)]
#[command(name = "condor", version, args_conflicts_with_subcommands = true)]
struct Line {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    up: up::How,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Makes a project of one's own: two processors, to begin with
    New(new::New),
    /// Checks the description of a system, and explains every mistake
    Check {
        /// The description
        file: Option<PathBuf>,
    },
    /// Brings a system up
    Up(up::Up),
    /// Stops the program of a processor, or a service
    Stop(requests::One),
    /// Starts the program of a processor that was stopped
    Start(requests::One),
    /// Stops a processor, and starts it with another program
    Load(requests::Load),
    /// Ends a running system
    Down(Which),
    /// Shows a running system on this terminal
    Ui(ui::Ui),
    /// Shows the processors of a running system
    Ps(commands::Ps),
    /// Shows the servo loops of a running system
    Top(commands::Top),
    /// Sends a message to a processor
    Send(commands::Send),
    /// Shows the vectors of processors: names, and counts of messages
    Vectors(commands::Vectors),
    /// Variables and parameters of servo loops, and fields of published cells
    #[command(subcommand)]
    Vars(commands::Vars),
    /// Connects this terminal to that of a processor
    Tty(commands::Tty),
    /// Shows what happened in a running system
    Log(requests::Log),
    #[command(hide = true, subcommand)]
    Service(service::Service),
    #[command(hide = true, disable_help_flag = true)]
    Program {
        name: String,
        #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
        arguments: Vec<String>,
    },
}

/// Which of the running systems is meant.
#[derive(Debug, Args)]
pub(crate) struct Which {
    /// The name of the system, if several are running
    #[arg(long, value_name = "NAME")]
    pub(crate) system: Option<String>,
}

/// The error of a command, which is shown to people.
pub type AnyError = Box<dyn core::error::Error>;

/// Runs the command that the arguments of this process name. Returns its exit status: 0 for
/// success, 1 for failure, 2 for arguments that cannot be understood.
pub fn main(application: &dyn Application) -> ExitCode {
    // It exits by itself, with 2, if they cannot be understood.
    let line = Line::parse();
    match run(line, application) {
        Ok(status) => status,
        // Whoever reads the output has seen enough of it.
        Err(error) if is_broken_pipe(&*error) => ExitCode::SUCCESS,
        Err(error) => {
            // Names that programs have chosen may be in it.
            eprintln!("condor: {}", plain_lines(&error.to_string()));
            ExitCode::FAILURE
        }
    }
}

/// How this program was called, for what people may type next.
pub(crate) fn me() -> String {
    let called = std::env::args_os().next().unwrap_or_default();
    let name = Path::new(&called).file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}

fn is_broken_pipe(error: &(dyn core::error::Error + 'static)) -> bool {
    let error = error.downcast_ref::<std::io::Error>();
    error.is_some_and(|error| error.kind() == std::io::ErrorKind::BrokenPipe)
}

fn run(line: Line, application: &dyn Application) -> Result<ExitCode, AnyError> {
    match line.command {
        None if application.description().is_none() => {
            Line::command().print_help()?;
            return Ok(ExitCode::from(2));
        }
        None => return up::run(None, &line.up, application),
        Some(Command::New(new)) => new.run()?,
        Some(Command::Check { file }) => check(&description(file, application), application)?,
        Some(Command::Up(up)) => return up::run(up.file, &up.how, application),
        Some(Command::Stop(one)) => requests::stop(one)?,
        Some(Command::Start(one)) => requests::start(one)?,
        Some(Command::Load(load)) => requests::load(load)?,
        Some(Command::Down(which)) => requests::down(&which)?,
        Some(Command::Log(log)) => requests::log(&log)?,
        Some(Command::Ui(ui)) => ui.run()?,
        Some(Command::Ps(ps)) => ps.run()?,
        Some(Command::Top(top)) => top.run()?,
        Some(Command::Send(send)) => send.run()?,
        Some(Command::Vectors(vectors)) => vectors.run()?,
        Some(Command::Vars(vars)) => vars.run()?,
        Some(Command::Tty(tty)) => tty.run()?,
        Some(Command::Service(service)) => service.run(application)?,
        Some(Command::Program { name, arguments }) => {
            let mut known = application.programs().iter();
            let Some((_, run)) = known.find(|(known, _)| *known == name) else {
                eprintln!("{}: this program has no program `{name}` of its own", me());
                return Ok(ExitCode::from(2));
            };
            return Ok(run(arguments));
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// What the programs are called.
pub(crate) fn names(application: &dyn Application) -> Vec<&'static str> {
    let programs = application.programs().iter();
    programs.map(|(name, _)| *name).collect()
}

/// The description that is meant.
fn description(file: Option<PathBuf>, application: &dyn Application) -> PathBuf {
    file.or_else(|| application.description())
        .unwrap_or_else(|| "condor.toml".into())
}

fn check(file: &Path, application: &dyn Application) -> Result<(), AnyError> {
    match Description::read(file, application) {
        Ok(description) => {
            let count = description.processors.len();
            println!(
                "{}: `{}` is right: {count} processors",
                file.display(),
                description.name
            );
            Ok(())
        }
        Err(mistakes) => {
            let count = mistakes.0.len();
            println!("{mistakes}");
            Err(format!(
                "{} has {count} mistake{}",
                file.display(),
                if count == 1 { "" } else { "s" }
            )
            .into())
        }
    }
}
