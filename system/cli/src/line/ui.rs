//! `condor ui`, and `condor up` with a user interface.

use std::ffi::OsString;
use std::fs::File;
use std::path::Path;
use std::process::{Child, Command, ExitCode, Stdio};
use std::time::Duration;

use clap::Args;

use super::{AnyError, Application, code};
use crate::commands::SystemChoice;
use crate::demo::Demo;
use crate::screen;
use crate::ui::{self, Tool};
use condor_host::control::ControlClient;
use condor_host::error::me;
use condor_host::plain::plain_lines;
use condor_host::reading::robot_of;
use condor_host::supervisor::{self, stat};
use condor_host::system::{self, SystemDirectory};

/// The reason why nothing is shown.
pub(super) const NO_SCREEN: &str = "the user interface needs a terminal, and TERM must not be `dumb`; without one, use `ps` and `top`";
/// Lines of the log that are shown if the system fails.
const LAST: usize = 20;
/// The time between two looks whether the supervisor is there.
const LOOK: Duration = Duration::from_millis(50);

#[derive(Debug, Args)]
pub(super) struct Ui {
    #[command(flatten)]
    tools: Tools,
    #[command(flatten)]
    which: SystemChoice,
}

#[derive(Debug, Args)]
pub(super) struct Tools {
    /// Adds a command to the actions of the user interface, such as `trace=strace -p {pid}`, where
    /// {pid} is the process of the processor, {number} its number, and {system} the name of the system;
    /// may be given several times
    #[arg(long = "tool", value_name = "NAME=COMMAND")]
    tools: Vec<Tool>,
}

impl Tools {
    fn all(&self) -> Vec<Tool> {
        [&[Tool::debugger()], self.tools.as_slice()].concat()
    }
}

impl Ui {
    pub(super) fn run(&self, application: &dyn Application) -> Result<(), AnyError> {
        let directory = system::find(self.which.system.as_deref())?;
        if !screen::is_possible() {
            return Err(NO_SCREEN.into());
        }
        let status = ControlClient::connect(&directory)?.status()?;
        let robot = robot_of(Path::new(&status.file), application)?;
        Ok(ui::run(
            &directory,
            self.tools.all(),
            robot,
            application.extensions(),
            None,
        )?)
    }
}

/// Starts the supervisor in a process of its own, which outlives this one, and shows the system.
pub(super) fn up(
    file: &Path,
    name: &str,
    limit: Option<Duration>,
    clock: &[OsString],
    tools: &Tools,
    application: &dyn Application,
    demo: Option<Demo>,
) -> Result<ExitCode, AnyError> {
    let robot = robot_of(file, application)?;
    let directory = SystemDirectory::of(name)?;
    let output = directory.path().join("output");
    let changed = || std::fs::metadata(directory.log()).and_then(|log| log.modified());
    let before = changed().ok();
    let told = || {
        // A log that is as before is that of another supervisor.
        let log = (changed().ok() != before).then(|| std::fs::read(directory.log()));
        let log = log.and_then(Result::ok).unwrap_or_default();
        let mut told = supervisor::last_lines(&log, LAST);
        told.push(std::fs::read_to_string(&output).unwrap_or_default());
        plain_lines(&told.join("\n"))
    };
    let mut supervisor = spawn(file, limit, clock, File::create(&output)?)?;
    let pid = supervisor.id();
    while !is_supervisor(&directory, pid) {
        if let Some(status) = supervisor.try_wait()? {
            eprintln!("{}", told());
            return Ok(code(status.success()));
        }
        std::thread::sleep(LOOK);
    }
    let outcome = ui::run(
        &directory,
        tools.all(),
        robot,
        application.extensions(),
        demo,
    );
    if is_supervisor(&directory, pid) {
        outcome?;
        let me = me();
        println!("The system `{name}` is still running: `{me} ui` shows it, `{me} down` stops it.");
        return Ok(ExitCode::SUCCESS);
    }
    let status = supervisor.wait()?;
    if !status.success() {
        eprintln!("{}", told());
    }
    Ok(code(status.success()))
}

fn spawn(
    file: &Path,
    limit: Option<Duration>,
    clock: &[OsString],
    output: File,
) -> Result<Child, AnyError> {
    let mut command = Command::new("setsid");
    command.arg(std::env::current_exe()?);
    command
        .arg("up")
        .arg(file)
        .args(["--headless", "--attended"])
        .args(clock);
    if let Some(limit) = limit {
        command.arg("--for").arg(format!("{}ms", limit.as_millis()));
    }
    let stderr = output.try_clone()?;
    command.stdin(Stdio::null()).stdout(output).stderr(stderr);
    let spawned = command.spawn();
    spawned.map_err(|error| format!("cannot start the supervisor with setsid: {error}").into())
}

/// Whether that process keeps the supervisor of the running system.
fn is_supervisor(directory: &SystemDirectory, keeper: u32) -> bool {
    let client = ControlClient::connect(directory);
    let status = client.and_then(|mut client| client.status());
    status.is_ok_and(|status| stat::parent(status.pid) == Some(keeper))
}
