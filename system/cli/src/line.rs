//! The command line of `condor`, and of programs that are `condor` with programs of their own.

mod clock;
mod new;
mod requests;
mod summary;
mod ui;
mod up;

use std::ffi::OsString;
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Arg, CommandFactory, FromArgMatches, Parser, Subcommand};

use crate::commands::{self, SystemChoice};
use condor_host::application::Application;
use condor_host::description::{SystemDescription, find_program};
use condor_host::error::{AnyError, me};
use condor_host::gateway::INSTALL;
use condor_host::plain::plain_lines;
use condor_host::services;

/// Starts the programs of a robot whose processors share memory with this machine, and watches them.
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
    /// Makes a new project: programs for two processors, or a robot
    New(new::NewArguments),
    /// Checks the description of a system (a TOML file) and explains every mistake
    Check {
        /// The file of the description; by default the one for which this program was built, or else `condor.toml`
        file: Option<PathBuf>,
    },
    /// Starts a system: its services and the programs of its processors
    Up(up::Up),
    /// Stops the program of a processor, or stops a service
    Stop(requests::OneProcessor),
    /// Starts a processor's program, or a service, that has been stopped or has failed
    Start(requests::OneProcessor),
    /// Stops a processor's program, or a service, if it runs, and starts it again
    Restart(requests::OneProcessor),
    /// Stops the program of a processor and starts another one there
    Load(requests::Load),
    /// Stops all programs and services of a running system, within 10 s; kills and names those that do not end when
    /// asked
    Down(SystemChoice),
    /// Shows a running system on this terminal: terminals, loops, messages, log
    Ui(ui::Ui),
    /// Shows the state of the processors and services of a running system
    Ps(commands::Ps),
    /// Shows the servo loops of a running system: rates, run times, overruns
    Top(commands::Top),
    /// Shows the simulated clock of a running system; pauses, steps and resumes it, and sets its speed
    Clock(clock::Clock),
    /// Sends a message to a vector (a numbered handler) of a processor
    Send(commands::Send),
    /// Shows the vectors (numbered message handlers) of processors, and counts of messages
    Vectors(commands::Vectors),
    /// Shows variables of servo loops and fields of published cells (values that programs share); shows and sets parameters
    #[command(subcommand)]
    Vars(commands::Vars),
    /// Shows a running system in browsers, and in viewers such as Foxglove and Lichtblick
    View(commands::View),
    /// Records variables and events into an MCAP file, until Ctrl-C
    Record(commands::Record),
    /// Writes variables of a recording as a table (CSV) or as a drawing (SVG)
    Export(commands::Export),
    /// Draws variables over time on this terminal; with --robot also the robot, as a figure of lines
    Plot(commands::Plot),
    /// Shows a robot in browsers from its configuration alone, to try postures and motions; with --check checks a
    /// motion instead: limits, torques, tensions, collisions
    Sim(commands::Sim),
    /// Connects this terminal to the terminal of a processor
    Tty(commands::Tty),
    /// Prints static variables of a running program, by their names in its debug information
    Print(commands::Print),
    /// Starts GDB on the program of a processor: a process of this machine, or a hart (a core of a RISC-V machine)
    Gdb(commands::Gdb),
    /// Serves GDB's protocol for the programs of harts, so that an editor can debug them
    Debug(commands::Debug),
    /// Shows the log of a running system
    Log(requests::Log),
    #[command(hide = true, disable_help_flag = true)]
    Service {
        #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
        words: Vec<String>,
    },
    #[command(hide = true, disable_help_flag = true)]
    Program {
        name: String,
        #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
        arguments: Vec<String>,
    },
}

/// The arguments of a command of the application.
const ARGUMENTS: &str = "arguments";

/// Runs the command that the arguments of this process name: one of `condor`, or one that `application` adds. Returns the exit
/// status of the process: 0 for success, 1 for failure, 2 for arguments that cannot be understood. A command that
/// `application` adds returns its own.
pub fn main(application: &dyn Application) -> ExitCode {
    let mut words = std::env::args_os().skip(1);
    if words.next().is_some_and(|word| word == "--remote") {
        return remote(words.collect());
    }
    let mut command = named();
    for (name, about, _) in application.commands() {
        let arguments = Arg::new(ARGUMENTS)
            .num_args(0..)
            .trailing_var_arg(true)
            .allow_hyphen_values(true);
        let own = clap::Command::new(name).about(about).arg(arguments);
        command = command.subcommand(own.disable_help_flag(true));
    }
    // clap exits by itself, with 2, if the arguments cannot be understood.
    let matches = command.get_matches();
    if let Some((name, own)) = matches.subcommand()
        && let Some((.., run)) = application.commands().into_iter().find(|it| it.0 == name)
    {
        let arguments = own.get_many(ARGUMENTS).unwrap_or_default();
        return run(arguments.cloned().collect());
    }
    let line = Line::from_arg_matches(&matches).unwrap_or_else(|error| error.exit());
    match run(line, application) {
        Ok(status) => status,
        // The reader of the output has seen enough of it.
        Err(error) if is_broken_pipe(&*error) => ExitCode::SUCCESS,
        Err(error) => {
            // Names that programs have chosen may be in it.
            eprintln!("{}: {}", me(), plain_lines(&error.to_string()));
            ExitCode::FAILURE
        }
    }
}

/// Returns the command line; its help and errors use the name by which this program was called.
fn named() -> clap::Command {
    let me = me();
    let remote =
        format!("`{me} --remote ROBOT COMMAND` runs a command for a robot that is elsewhere.");
    Line::command().bin_name(me).after_help(remote)
}

/// Runs a command of `condor-remote`, which takes the place of this process, for the robot that the first word names.
fn remote(words: Vec<OsString>) -> ExitCode {
    let program = find_program(Path::new(""), "condor-remote");
    let error = match program {
        Ok(program) => {
            let mut command = std::process::Command::new(&program);
            let error = command.arg("--robot").args(words).exec();
            format!("cannot run {}: {error}", program.display())
        }
        Err(error) => format!("{error}; {INSTALL}"),
    };
    eprintln!("{}: {error}", me());
    ExitCode::FAILURE
}

fn code(succeeded: bool) -> ExitCode {
    if succeeded {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}

fn is_broken_pipe(error: &(dyn core::error::Error + 'static)) -> bool {
    let error = error.downcast_ref::<std::io::Error>();
    error.is_some_and(|error| error.kind() == std::io::ErrorKind::BrokenPipe)
}

fn run(line: Line, application: &dyn Application) -> Result<ExitCode, AnyError> {
    match line.command {
        None if application.description().is_none() => {
            named().print_help()?;
            return Ok(ExitCode::from(2));
        }
        None => return up::run(None, &line.up, application),
        Some(Command::New(new)) => new.run()?,
        Some(Command::Check { file }) => check(&description(file, application), application)?,
        Some(Command::Up(up)) => return up::run(up.file, &up.how, application),
        Some(Command::Stop(one)) => requests::stop(one)?,
        Some(Command::Start(one)) => requests::start(one)?,
        Some(Command::Restart(one)) => requests::restart(one)?,
        Some(Command::Load(load)) => requests::load(load)?,
        Some(Command::Down(which)) => requests::down(&which)?,
        Some(Command::Log(log)) => requests::log(&log)?,
        Some(Command::Ui(ui)) => ui.run(application)?,
        Some(Command::Ps(ps)) => ps.run()?,
        Some(Command::Top(top)) => top.run()?,
        Some(Command::Clock(clock)) => clock.run()?,
        Some(Command::Send(send)) => send.run()?,
        Some(Command::Vectors(vectors)) => vectors.run()?,
        Some(Command::Vars(vars)) => vars.run()?,
        Some(Command::View(view)) => view.run(application)?,
        Some(Command::Record(record)) => record.run(application)?,
        Some(Command::Export(export)) => export.run()?,
        Some(Command::Plot(plot)) => plot.run(application)?,
        Some(Command::Sim(sim)) => return Ok(code(sim.run(application)?)),
        Some(Command::Tty(tty)) => tty.run()?,
        Some(Command::Print(print)) => print.run(application)?,
        Some(Command::Gdb(gdb)) => gdb.run(application)?,
        Some(Command::Debug(debug)) => debug.run(application)?,
        Some(Command::Service { words }) => services::run(&words, application)?,
        Some(Command::Program { name, arguments }) => {
            if !application.programs().contains(&name.as_str()) {
                eprintln!("{}: this binary contains no program `{name}`", me());
                return Ok(ExitCode::from(2));
            }
            return Ok(application.run_program(&name, arguments));
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// Returns the path of the description: `file`, else that of the application, else `condor.toml`.
fn description(file: Option<PathBuf>, application: &dyn Application) -> PathBuf {
    file.or_else(|| application.description())
        .unwrap_or_else(|| "condor.toml".into())
}

fn check(file: &Path, application: &dyn Application) -> Result<(), AnyError> {
    match SystemDescription::read(file, application) {
        Ok(description) => {
            let count = description.processors.len();
            println!(
                "{}: the description of `{}` has no mistakes; processors: {count}",
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
