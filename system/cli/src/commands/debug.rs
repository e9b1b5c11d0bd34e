//! `condor debug` and `condor gdb`: GDB on the program of a processor.

use std::io;
use std::net::{Ipv4Addr, TcpListener};
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::Receiver;
use std::time::Duration;

use clap::Args;
use condor_debug::gateway::{Debuggee, PacketStream, ProgramHost, Session, SessionError};
use condor_mbox::linux::LinuxWindow;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;

use super::running::Running;
use super::{SystemChoice, print};
use crate::counts;
use crate::peek;
use condor_host::application::Application;
use condor_host::control::{ControlClient, ControlRequest, Member, MemberState};
use condor_host::error::{AnyError, tell};
use condor_host::paths::beside;
use condor_host::system::SystemDirectory;
use condor_host::view::View;

/// The time that a debugger has to send something, once it has connected.
const HELLO: Duration = Duration::from_secs(10);
/// The time between two looks of the gateway whether its debugger has ended.
const LOOK: Timespec = Timespec {
    tv_sec: 0,
    tv_nsec: 200_000_000,
};
/// The debugger of this machine, and the one for other processors.
const HERE: &str = "gdb";
const ELSEWHERE: &str = "gdb-multiarch";

#[derive(Debug, Args)]
pub(crate) struct Debug {
    /// The names or the numbers of the processors, which must be harts; each is a thread of the debugger
    #[arg(required = true)]
    processors: Vec<String>,
    /// Listens at this port of the loopback address instead of the Unix socket; 0 picks a free one
    #[arg(long, value_name = "PORT")]
    tcp: Option<u16>,
    #[command(flatten)]
    which: SystemChoice,
}

#[derive(Debug, Args)]
pub(crate) struct Gdb {
    /// The name or the number of the processor; several must be harts, each of which is a thread of GDB
    #[arg(required = true)]
    processors: Vec<String>,
    #[command(flatten)]
    which: SystemChoice,
    /// Restarts the program and stops it before it runs
    #[arg(long)]
    start: bool,
    /// Uses GDB's non-stop mode: no thread stops at the beginning, each stops alone, and memory can be read
    /// while threads run
    #[arg(long, conflicts_with = "start")]
    non_stop: bool,
    /// The debugger [default: gdb-multiarch, or gdb for a process]
    #[arg(long = "gdb", value_name = "COMMAND")]
    debugger: Option<PathBuf>,
    /// Arguments of GDB, such as `-- -x commands.gdb`
    #[arg(last = true)]
    arguments: Vec<String>,
}

impl Debug {
    pub(crate) fn run(&self, application: &dyn Application) -> Result<(), AnyError> {
        let running = Running::find(&self.which)?;
        let (members, debuggees) = all(&running, &self.processors, application)?;
        if debuggees.is_empty() {
            return Err(format!(
                "{} is a process of this machine; use `gdb -p {}`",
                members[0].name,
                members[0].pid.unwrap_or_default()
            )
            .into());
        }
        let programs = programs(&running, &members, &debuggees, false);
        let session = Session::attach(debuggees)?;
        let listener = match self.tcp {
            Some(port) => Listener::tcp(port)?,
            None => Listener::unix(&running, members[0])?,
        };
        let target = format!("target remote {}", listener.address);
        let words = programs.into_iter().chain(["-ex".into(), target]);
        let words = words.map(|word| {
            if word.contains(' ') {
                format!("'{word}'")
            } else {
                word
            }
        });
        let words: Vec<String> = words.collect();
        print(format_args!("{ELSEWHERE} {}\n", words.join(" ")))?;
        serve(&running, &members, session, &listener, None)
    }
}

impl Gdb {
    pub(crate) fn run(&self, application: &dyn Application) -> Result<(), AnyError> {
        let running = Running::find(&self.which)?;
        let (members, mut debuggees) = all(&running, &self.processors, application)?;
        // Ctrl-C is GDB's.
        signal_hook::flag::register(
            signal_hook::consts::SIGINT,
            Arc::new(AtomicBool::new(false)),
        )?;
        if debuggees.is_empty() {
            return self.process(&running, members[0]);
        }
        let programs = programs(&running, &members, &debuggees, self.non_stop);
        let session = if !self.start {
            Session::attach(debuggees)?
        } else if let (Some(debuggee), [_]) = (debuggees.pop(), &*members) {
            Session::start(debuggee)?
        } else {
            return Err("--start is for one processor at a time; name only one".into());
        };
        let listener = Listener::unix(&running, members[0])?;
        let mut command = self.command(ELSEWHERE);
        if self.non_stop {
            command.args(["-iex", "set non-stop on"]);
        }
        command.args(programs);
        command.args(["-ex", &format!("target remote {}", listener.address)]);
        let gdb = spawn(command.args(&self.arguments))?;
        serve(&running, &members, session, &listener, Some(gdb))
    }

    /// Starts the debugger of this machine on a process.
    fn process(&self, running: &Running, member: &Member) -> Result<(), AnyError> {
        let mut is_held = member.state == MemberState::Held;
        let mut pid = member.pid;
        if self.start {
            // Not after the program was stopped for it.
            spawn(self.command(HERE).arg("--version").stdout(Stdio::null()))?.wait()?;
            (pid, is_held) = (start_held(running, &member.name)?, true);
        }
        let pid = pid.ok_or("the program of the processor does not run")?;
        let mut command = self.command(HERE);
        if self.non_stop {
            command.args(["-iex", "set non-stop on"]);
        }
        command.arg("-p").arg(pid.to_string());
        if is_held {
            // Otherwise the kernel stops it again when the debugger goes away.
            let ignored = "handle SIGCONT nostop noprint pass";
            let continued = format!("shell kill -CONT {pid}");
            command.args(["-ex", ignored, "-ex", &continued]);
        }
        let status = spawn(command.args(&self.arguments))?.wait()?;
        if status.success() {
            Ok(())
        } else {
            Err(format!("gdb ended: {status}").into())
        }
    }

    fn command(&self, default: &str) -> Command {
        Command::new(self.debugger.as_deref().unwrap_or(Path::new(default)))
    }
}

/// Starts the program of a process anew, so that it waits for a debugger before it runs, and returns its process id.
fn start_held(running: &Running, name: &str) -> Result<Option<u32>, AnyError> {
    let (processor, held) = (name.into(), true);
    let mut client = ControlClient::connect(&running.directory)?;
    client.ask(&ControlRequest::Restart { processor, held })?;
    Ok(client.status()?.processor(name)?.pid)
}

fn spawn(command: &mut Command) -> Result<Child, AnyError> {
    let name = command.get_program().to_string_lossy().into_owned();
    let failed = |error| {
        format!("cannot start {name}: {error}; install it, or name another debugger by `--gdb`")
            .into()
    };
    command.spawn().map_err(failed)
}

/// The processors of names, each once, and their programs for a debugger; no programs if the only one is a
/// process of this machine.
fn all<'r>(
    running: &'r Running,
    names: &[String],
    application: &dyn Application,
) -> Result<(Vec<&'r Member>, Vec<Debuggee<LinuxWindow>>), AnyError> {
    let view = running.view()?;
    let extensions = application.extensions();
    let (mut members, mut debuggees) = (Vec::<&Member>::new(), Vec::new());
    for name in names {
        let member = running.processor(name)?;
        if members.iter().any(|it| it.number == member.number) {
            continue;
        }
        members.push(member);
        if let Some(mut debuggee) = peek::debuggee(extensions, &running.directory, member, &view)? {
            // The name of the thread.
            debuggee.name = format!("{}, {}", member.name, debuggee.name);
            debuggee.host = Some(Box::new(SupervisedPrograms {
                directory: running.directory.clone(),
                processor: member.name.clone(),
            }));
            debuggees.push(debuggee);
        } else if names.len() > 1 {
            let text =
                "is a process of this machine, which needs a debugger of its own; name it alone";
            return Err(format!("{} {text}", member.name).into());
        }
    }
    Ok((members, debuggees))
}

/// The arguments by which GDB reads the symbols of programs. Each hart has its own copy at its own place. GDB
/// asks the gateway for that of the first, but not in non-stop mode.
fn programs(
    running: &Running,
    members: &[&Member],
    debuggees: &[Debuggee<LinuxWindow>],
    non_stop: bool,
) -> Vec<String> {
    let mut words = Vec::new();
    for (place, (member, debuggee)) in members.iter().zip(debuggees).enumerate() {
        let file = program(running, member).display().to_string();
        let command = match place {
            0 if !non_stop => {
                words.push(file);
                continue;
            }
            0 => {
                words.extend(["-ex".into(), format!("exec-file {file}")]);
                "symbol-file"
            }
            _ => "add-symbol-file",
        };
        let bias = debuggee.bias;
        let command = format!("with confirm off -- {command} {file} -o {bias:#x}");
        words.extend(["-ex".into(), command]);
    }
    words
}

/// Starts programs of a processor by its supervisor.
struct SupervisedPrograms {
    directory: SystemDirectory,
    processor: String,
}

impl SupervisedPrograms {
    /// Stops what the processor runs.
    fn stop(&self) -> Result<(), AnyError> {
        let status = ControlClient::connect(&self.directory)?.status()?;
        if is_alive(status.processor(&self.processor)?) {
            let processor = self.processor.clone();
            ControlClient::connect(&self.directory)?.ask(&ControlRequest::Stop { processor })?;
        }
        Ok(())
    }
}

impl ProgramHost for SupervisedPrograms {
    fn start(&self, file: Option<(&str, Vec<&str>)>) -> Result<Receiver<String>, String> {
        let processor = self.processor.clone();
        let request = if let Some((file, arguments)) = file {
            // If the file cannot be read, no program is stopped.
            ControlRequest::Load {
                processor,
                program: file.into(),
                arguments: arguments.into_iter().map(Into::into).collect(),
            }
        } else {
            self.stop().map_err(|error| error.to_string())?;
            ControlRequest::Start { processor }
        };
        let client = ControlClient::connect(&self.directory);
        let mut client = client.map_err(|error| error.to_string())?;
        let (sender, receiver) = std::sync::mpsc::channel();
        // The answer comes when the program has joined, which a debugger may not let it do.
        std::thread::spawn(move || {
            if let Err(error) = client.ask(&request) {
                // Nobody waits for it any more.
                let _ = sender.send(error.to_string());
            }
        });
        Ok(receiver)
    }

    fn vectors(&self) -> Result<String, String> {
        let vectors = || -> Result<String, AnyError> {
            let status = ControlClient::connect(&self.directory)?.status()?;
            let view = View::open(&self.directory, status.window_bytes)?;
            let member = status.processor(&self.processor)?;
            let rows = counts::vectors(&view, [member])?;
            Ok(counts::table_of_vectors(&rows).to_string())
        };
        vectors().map_err(|error| error.to_string())
    }
}

/// Whether there is a program to be stopped.
const fn is_alive(member: &Member) -> bool {
    !matches!(member.state, MemberState::Stopped | MemberState::Failed)
}

/// The file of a program.
fn program(running: &Running, member: &Member) -> PathBuf {
    beside(running.status.file.as_ref(), &member.program)
}

/// Serves debuggers one after the other, until `gdb` has ended; without it, until one has killed the
/// program, or the processor fails.
fn serve(
    running: &Running,
    members: &[&Member],
    session: Session<LinuxWindow>,
    listener: &Listener,
    gdb: Option<Child>,
) -> Result<(), AnyError> {
    let Some(mut gdb) = gdb else {
        return serve_while(running, members, session, listener, || Ok(true));
    };
    let is_there = || Ok(gdb.try_wait()?.is_none());
    let served = serve_while(running, members, session, listener, is_there);
    if let Err(error) = &served {
        // Its user reads it, and ends it.
        tell(error);
    }
    gdb.wait()?;
    served
}

fn serve_while(
    running: &Running,
    members: &[&Member],
    mut session: Session<LinuxWindow>,
    listener: &Listener,
    mut goes_on: impl FnMut() -> io::Result<bool>,
) -> Result<(), AnyError> {
    while goes_on()? {
        running.check()?;
        let Some(socket) = listener.accept()? else {
            continue;
        };
        let served = PacketStream::new(socket).map(|stream| session.serve(stream, HELLO))?;
        match served {
            Ok(false) => {}
            Ok(true) => {
                for member in members {
                    let processor = member.name.clone();
                    ControlClient::connect(&running.directory)?
                        .ask(&ControlRequest::Stop { processor })?;
                }
                return Ok(());
            }
            // The next debugger may do better.
            Err(SessionError::Connection(error)) => tell(error),
            Err(error) => return Err(error.into()),
        }
    }
    Ok(())
}

/// The socket to which debuggers connect.
struct Listener {
    socket: Socket,
    /// As GDB has it.
    address: String,
    /// To be removed.
    path: Option<PathBuf>,
}

enum Socket {
    Unix(UnixListener),
    Tcp(TcpListener),
}

impl Listener {
    /// The socket of a processor, in the directory of the system. Only this user can connect to it.
    fn unix(running: &Running, member: &Member) -> io::Result<Self> {
        let path = running
            .directory
            .path()
            .join(format!("gdb-{}", member.number));
        match std::fs::remove_file(&path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
        // Nobody else can enter the directory, either.
        let socket = UnixListener::bind(&path)?;
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o600))?;
        Ok(Self {
            socket: Socket::Unix(socket),
            address: path.display().to_string(),
            path: Some(path),
        })
    }

    fn tcp(port: u16) -> io::Result<Self> {
        let socket = TcpListener::bind((Ipv4Addr::LOCALHOST, port))?;
        let address = socket.local_addr()?.to_string();
        Ok(Self {
            socket: Socket::Tcp(socket),
            address,
            path: None,
        })
    }

    /// A connection, if one comes soon.
    fn accept(&self) -> io::Result<Option<OwnedFd>> {
        let descriptor = match &self.socket {
            Socket::Unix(socket) => socket.as_fd(),
            Socket::Tcp(socket) => socket.as_fd(),
        };
        match poll(
            &mut [PollFd::from_borrowed_fd(descriptor, PollFlags::IN)],
            Some(&LOOK),
        ) {
            Ok(0) | Err(Errno::INTR) => Ok(None),
            Ok(_) => Ok(Some(match &self.socket {
                Socket::Unix(socket) => socket.accept()?.0.into(),
                Socket::Tcp(socket) => socket.accept()?.0.into(),
            })),
            Err(error) => Err(error.into()),
        }
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        if let Some(path) = &self.path {
            // The next one removes it otherwise.
            let _ = std::fs::remove_file(path);
        }
    }
}
