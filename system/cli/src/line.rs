//! The command line of `condor`, and of programs that are `condor` with programs of their own.

mod clock;
mod demo;
mod help;
mod log;
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
use clap_complete::Shell;

use crate::commands::{self, SystemChoice};
use condor_host::application::Application;
use condor_host::description::{
    DeclaredLoop, ProcessorEntry, SystemDescription, response_times_us,
};
use condor_host::error::{AnyError, me, tell};
use condor_host::gateway::INSTALL;
use condor_host::paths::find_program;
use condor_host::plain::plain_lines;
use condor_host::services;

/// Starts a robot's programs, on processors that share memory, and watches them.
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
    /// Checks the description of a system and explains every mistake
    Check {
        /// The file of the description; by default the one for which this program was built, or else `condor.toml`
        file: Option<PathBuf>,
    },
    /// Starts a system: its services and the programs of its processors
    Up(up::Up),
    /// Starts a system and shows what it can do, step by step
    ///
    /// It shows the user interface, types at terminals, and says what it does, as the file demo.toml beside the description
    /// of the system prescribes. A person can type meanwhile. F10 leaves, as in the user interface.
    Demo(demo::DemoArguments),
    /// Stops the program of a processor, or a service
    Stop(requests::OneProcessor),
    /// Starts a program or service that was stopped or has failed
    Start(requests::OneProcessor),
    /// Stops a program or service, and starts it again
    Restart(requests::OneProcessor),
    /// Replaces the program of a processor by another one
    Load(requests::Load),
    /// Stops a system: all its programs and services
    ///
    /// It takes 10 s at most. Programs and services that do not end when they are asked to are killed, and named.
    Down(SystemChoice),
    /// Shows a running system on this terminal
    ///
    /// It shows the terminals of processors, servo loops, messages, plots and the log. F1 explains the keys.
    Ui(ui::Ui),
    /// Shows the state of processors and services
    Ps(commands::Ps),
    /// Shows servo loops: rates, run times, lateness; Ctrl-C ends it
    ///
    /// Percentiles are since a loop began. They are at most half longer than the exact ones. Loops that take longer than
    /// the description declares in `servo_loops` are named.
    Top(commands::Top),
    /// Shows, pauses, steps or resumes the simulated clock
    Clock(clock::Clock),
    /// Sends a message to a vector (a numbered message handler)
    Send(commands::Send),
    /// Shows vectors (numbered message handlers), counts messages
    ///
    /// With --follow, it shows each message as it comes: when it was heard, its sender, receiver, vector and data. The
    /// receiver gets it all the same.
    Vectors(commands::Vectors),
    /// Shows variables and parameters, and sets parameters
    ///
    /// Variables are values of servo loops, and fields of published cells: values that programs share. Parameters are
    /// values that can be set while loops run.
    #[command(subcommand)]
    Vars(commands::Vars),
    /// Shows a running system in browsers
    ///
    /// Viewers such as Foxglove and Lichtblick can connect, too.
    View(commands::View),
    /// Records variables and events into an MCAP file
    ///
    /// Ctrl-C ends the recording.
    Record(commands::Record),
    /// Writes a recording as a table (CSV) or as a drawing (SVG)
    Export(commands::Export),
    /// Draws variables over time on this terminal, and the robot
    Plot(commands::Plot),
    /// Tries postures and motions of a robot that does not run
    ///
    /// A page for browsers shows the robot as its configuration describes it. With --check, a motion is checked
    /// instead: limits, torques, efforts, collisions.
    Sim(commands::Sim),
    /// Connects this terminal to that of a processor; Ctrl-] leaves
    ///
    /// With piped input, all of it is typed, and the command ends when the terminal has been quiet for 2 s, or 30 s
    /// after the input at most; with --for, after that time.
    Tty(commands::Tty),
    /// Prints static variables of a running program
    ///
    /// Each is given by its name in the source; the debug information of the program tells where it is.
    Print(commands::Print),
    /// Starts GDB on the program of a processor
    ///
    /// A processor is a process of this machine, or a hart (a core of a RISC-V machine).
    Gdb(commands::Gdb),
    /// Serves GDB's protocol, so that an editor can debug harts
    Debug(commands::Debug),
    /// Shows the log of a running system
    Log(log::Log),
    /// Prints a script by which a shell completes commands
    Completions {
        /// The shell
        shell: Shell,
    },
    /// Writes manual pages, one for each command
    Man {
        /// The directory to write to
        directory: PathBuf,
    },
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
    // clap exits by itself, with 2, if the arguments cannot be understood.
    let matches = command(application).get_matches();
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
            tell(plain_lines(&error.to_string()));
            ExitCode::FAILURE
        }
    }
}

/// Returns the command line with the commands of an application. Its help and errors use the name by which this program
/// was called.
fn command(application: &dyn Application) -> clap::Command {
    let me = me();
    let mut command = Line::command();
    for (name, about, _) in application.commands() {
        let arguments = Arg::new(ARGUMENTS)
            .num_args(0..)
            .trailing_var_arg(true)
            .allow_hyphen_values(true);
        let own = clap::Command::new(name).about(about).arg(arguments);
        command = command.subcommand(own.disable_help_flag(true));
    }
    let remote =
        format!("`{me} --remote ROBOT COMMAND` runs a command for a robot that is elsewhere.");
    help::with_help(command, &me)
        .bin_name(me)
        .after_help(remote)
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
    tell(error);
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
            command(application).print_help()?;
            return Ok(ExitCode::from(2));
        }
        None => return up::run(None, &line.up, application),
        Some(Command::New(new)) => new.run()?,
        Some(Command::Check { file }) => check(&description(file, application), application)?,
        Some(Command::Up(up)) => return up::run(up.file, &up.how, application),
        Some(Command::Demo(demo)) => return demo.run(application),
        Some(Command::Stop(one)) => requests::stop(one)?,
        Some(Command::Start(one)) => requests::start(one)?,
        Some(Command::Restart(one)) => requests::restart(one)?,
        Some(Command::Load(load)) => requests::load(load)?,
        Some(Command::Down(which)) => requests::down(&which)?,
        Some(Command::Log(log)) => log.run()?,
        Some(Command::Completions { shell }) => {
            let out = &mut std::io::stdout();
            help::complete(command(application), &me(), shell, out)?;
        }
        Some(Command::Man { directory }) => {
            help::write_pages(command(application), &me(), &directory)?;
        }
        Some(Command::Ui(ui)) => ui.run(application)?,
        Some(Command::Ps(ps)) => ps.run()?,
        Some(Command::Top(top)) => top.run(application)?,
        Some(Command::Clock(clock)) => clock.run()?,
        Some(Command::Send(send)) => send.run()?,
        Some(Command::Vectors(vectors)) => vectors.run()?,
        Some(Command::Vars(vars)) => return vars.run(application),
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
                let known = match application.programs().join(", ") {
                    none if none.is_empty() => "it contains none".into(),
                    known => format!("it contains {known}"),
                };
                tell(format_args!(
                    "this binary contains no program `{name}`; {known}"
                ));
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

/// Returns a line for each loop that a processor's description declares.
fn loads(processor: &ProcessorEntry) -> String {
    let line = |(one, response): (&DeclaredLoop, Option<u64>)| {
        let response = response?;
        let (of, name) = (&processor.name, &one.name);
        let (hz, worst_us, period_us) = (one.hz, one.worst_us, 1_000_000 / one.hz);
        let text = format!(
            "{of}: `{name}` at {hz} Hz runs for up to {worst_us} µs and ends within {response} of {period_us} µs"
        );
        Some(plain_lines(&text) + "\n")
    };
    let loops = &processor.servo_loops;
    loops
        .iter()
        .zip(response_times_us(loops))
        .filter_map(line)
        .collect()
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
            for processor in &description.processors {
                print!("{}", loads(processor));
            }
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
