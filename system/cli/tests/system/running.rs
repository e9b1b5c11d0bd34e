//! A system that runs for a test, and who looks at it.

use std::io::{BufRead, BufReader, Read};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::Mutex;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use condor_host::control::{
    ControlClient, ControlClientError, ControlEvents, ControlRequest, Member, MemberState,
    SystemStatus,
};
use condor_host::system::SystemDirectory;
use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::process::{Pid, PidfdFlags, Signal};

/// How long anything may take on a machine that has much else to do.
pub(crate) const DEADLINE: Duration = Duration::from_secs(120);

const CONDOR: &str = env!("CARGO_BIN_EXE_condor");
const STARTED: &str = " have been started";

/// A running `condor up`, which is killed with all its descendants when the test ends.
pub(crate) struct Up {
    place: tempfile::TempDir,
    /// The keeper of the supervisor.
    child: Child,
    /// What it writes to standard error.
    told: Mutex<Receiver<String>>,
    options: Vec<String>,
    /// The program that is `condor`.
    condor: PathBuf,
}

impl Up {
    /// Brings up a system with these processors, and waits until all have been started.
    pub(crate) fn start(processors: &str, options: &[&str]) -> Self {
        let up = Self::launch(processors, options, |_| {});
        up.wait_until_started();
        up
    }

    /// Brings up a system with these processors, in a directory that is prepared before.
    pub(crate) fn launch(processors: &str, options: &[&str], prepare: impl FnOnce(&Path)) -> Self {
        Self::launch_by(CONDOR.as_ref(), processors, options, prepare)
    }

    /// The same by the example `extension`.
    pub(crate) fn extended(processors: &str) -> Self {
        let condor = Path::new(CONDOR).with_file_name("examples/extension");
        let up = Self::launch_by(&condor, processors, &[], |_| {});
        up.wait_until_started();
        up
    }

    fn launch_by(
        condor: &Path,
        processors: &str,
        options: &[&str],
        prepare: impl FnOnce(&Path),
    ) -> Self {
        let place = tempfile::tempdir().unwrap();
        let script = format!(
            "#!/bin/sh\nCONDOR_TEST_PROGRAM=\"$*\" exec {this} --exact programs::program --ignored --nocapture >&2\n",
            this = std::env::current_exe().unwrap().display(),
        );
        let program = place.path().join("program");
        std::fs::write(&program, script).unwrap();
        std::fs::set_permissions(&program, PermissionsExt::from_mode(0o755)).unwrap();
        let head = "name = \"tested\"\nwindow_bytes = 65536\n[files]\nroot = \"files\"\n";
        let text = format!("{head}{}", processors.replace("THIS", this()));
        std::fs::write(place.path().join("tested.toml"), text).unwrap();
        let options: Vec<_> = options.iter().map(|&option| option.into()).collect();
        prepare(place.path());
        let (child, told) = spawn(condor, &place, &options);
        Self {
            place,
            child,
            told,
            options,
            condor: condor.into(),
        }
    }

    /// Waits until all programs have been started that can be.
    pub(crate) fn wait_until_started(&self) {
        self.wait_until_told(STARTED);
    }

    /// Waits until a line is told that has this text.
    pub(crate) fn wait_until_told(&self, text: &str) -> String {
        let end = Instant::now() + DEADLINE;
        let (lines, mut told) = (self.told.lock().unwrap(), String::new());
        loop {
            let left = end.saturating_duration_since(Instant::now());
            match lines.recv_timeout(left) {
                Ok(line) if line.contains(text) => return line,
                Ok(line) => told += &line,
                Err(error) => panic!("no {text:?}, {error}:\n{told}"),
            }
        }
    }

    /// Brings the same system up again, after its supervisor was killed.
    pub(crate) fn again(mut self) -> Self {
        self.child.wait().unwrap();
        (self.child, self.told) = spawn(&self.condor, &self.place, &self.options);
        self.wait_until_started();
        self
    }

    pub(crate) fn directory(&self) -> SystemDirectory {
        SystemDirectory::at(self.place.path().join("condor/tested"))
    }

    /// Where something is beside the description.
    pub(crate) fn path(&self, path: &str) -> PathBuf {
        self.place.path().join(path)
    }

    /// The text of a file beside the description.
    pub(crate) fn file(&self, path: &str) -> String {
        std::fs::read_to_string(self.path(path)).unwrap()
    }

    pub(crate) fn client(&self) -> ControlClient {
        let mut client = ControlClient::connect(&self.directory()).unwrap();
        client.set_timeout(Some(DEADLINE)).unwrap();
        client
    }

    pub(crate) fn status(&self) -> SystemStatus {
        self.client().status().unwrap()
    }

    pub(crate) fn events(&self) -> ControlEvents {
        self.client().events().unwrap()
    }

    pub(crate) fn refused(&self, request: &ControlRequest) -> String {
        match self.client().ask(request) {
            Err(ControlClientError::Refused(error)) => error,
            other => panic!("{request:?} is answered with {other:?}"),
        }
    }

    /// The processes of all programs and services.
    pub(crate) fn processes(&self) -> Vec<u32> {
        let status = self.status();
        let members = status.services.iter().chain(&status.processors);
        members.filter_map(|member| member.pid).collect()
    }

    /// A command of `condor` for this system.
    pub(crate) fn command(&self, arguments: &[&str]) -> Command {
        let mut command = command(&self.condor, &self.place);
        command.args(arguments);
        if arguments == ["up", "--headless"] {
            command.arg(self.place.path().join("tested.toml"));
        }
        command
    }

    /// Runs a command, which must succeed.
    pub(crate) fn run(&self, arguments: &[&str]) -> Output {
        let output = self.command(arguments).output().unwrap();
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "condor {arguments:?}: {text}");
        output
    }

    pub(crate) fn kill_keeper(&self) {
        kill(self.child.id());
    }

    /// As ^C does.
    pub(crate) fn interrupt(&self) {
        signal(self.child.id(), Signal::INT);
    }

    /// Waits for the end, and leaves the directory.
    pub(crate) fn wait_for_end(&self) {
        wait_for_end(self.child.id());
    }

    /// Waits for the end; the exit status, and what was written to standard output.
    pub(crate) fn end(self) -> (Option<i32>, String) {
        let (code, text, _) = self.end_telling();
        (code, text)
    }

    /// The same, and what was written to standard error since it was last looked at.
    pub(crate) fn end_telling(mut self) -> (Option<i32>, String, String) {
        wait_for_end(self.child.id());
        let mut text = String::new();
        let mut output = self.child.stdout.take().unwrap();
        output.read_to_string(&mut text).unwrap();
        let told = self.told.lock().unwrap().iter().collect();
        (self.child.wait().unwrap().code(), text, told)
    }

    /// Attaches to a terminal.
    pub(crate) fn terminal(&self, name: &str) -> UnixStream {
        let stream = UnixStream::connect(self.directory().terminal(name)).unwrap();
        stream.set_read_timeout(Some(DEADLINE)).unwrap();
        stream
    }

    /// Reads a terminal until `text` has come.
    pub(crate) fn read_terminal(&self, name: &str, text: &str) {
        read_until(&mut self.terminal(name), text);
    }

    /// How many whole lines the log of a writer has; each must be there once, in order.
    pub(crate) fn lines(&self, name: &str) -> usize {
        let log = self.directory().terminals().join(format!("{name}.log"));
        let text = std::fs::read_to_string(log).unwrap();
        // The service may not have come to it yet.
        let Some((begun, rest)) = text.split_once("]\r\n") else {
            return 0;
        };
        assert!(begun.starts_with("[began at "), "{begun}");
        let whole = rest.rsplit_once("\r\n").map_or("", |(whole, _)| whole);
        let lines: Vec<_> = whole.split("\r\n").collect();
        for (number, line) in lines.iter().enumerate() {
            assert_eq!(*line, format!("writer {number}"));
        }
        lines.len()
    }
}

impl Drop for Up {
    fn drop(&mut self) {
        // The keeper ends what is left.
        let pids = std::fs::read_to_string(self.directory().pids()).unwrap_or_default();
        let supervisor = pids.split_whitespace().next().map(str::parse::<i32>);
        match supervisor.and_then(|it| Pid::from_raw(it.ok()?)) {
            Some(supervisor) => {
                let _ = rustix::process::kill_process(supervisor, Signal::KILL);
            }
            None => {
                let _ = self.child.kill();
            }
        }
        let _ = self.child.wait();
    }
}

/// The program, as the description and `load` name it: relative to the description.
pub(crate) const fn this() -> &'static str {
    "program"
}

fn command(condor: &Path, place: &tempfile::TempDir) -> Command {
    let mut command = Command::new(condor);
    command.env("XDG_RUNTIME_DIR", place.path());
    command
}

fn spawn(
    condor: &Path,
    place: &tempfile::TempDir,
    options: &[String],
) -> (Child, Mutex<Receiver<String>>) {
    let description: PathBuf = place.path().join("tested.toml");
    let mut child = command(condor, place)
        .arg("up")
        .arg(description)
        .arg("--headless")
        .args(options)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let lines = BufReader::new(child.stderr.take().unwrap());
    let (teller, told) = channel();
    std::thread::spawn(move || {
        for line in lines.lines().map_while(Result::ok) {
            // It writes on, whether anybody wants to know or not.
            let _ = teller.send(line + "\n");
        }
    });
    (child, Mutex::new(told))
}

/// The state of a processor or service. One whose heart stands still for a moment, on a loaded machine, runs.
pub(crate) fn state(member: &Member) -> MemberState {
    match member.state {
        MemberState::Stalled => MemberState::Running,
        state => state,
    }
}

/// Waits until a processor has come into a state.
pub(crate) fn wait(mut events: ControlEvents, name: &str, state: MemberState) -> ControlEvents {
    let mut told = String::new();
    for event in events.by_ref() {
        let event = event.unwrap_or_else(|error| panic!("{error}; before:\n{told}"));
        if event.source == name && event.state == Some(state) {
            return events;
        }
        told += &event.to_string();
        told.push('\n');
    }
    panic!("the system ended:\n{told}");
}

pub(crate) fn read_until(stream: &mut impl Read, text: &str) {
    let mut all = Vec::new();
    let mut piece = [0; 4096];
    loop {
        let count = stream.read(&mut piece).unwrap_or_else(|error| {
            panic!("{error}, not {text:?}: {}", String::from_utf8_lossy(&all))
        });
        assert!(count > 0, "no {text:?}: {}", String::from_utf8_lossy(&all));
        all.extend_from_slice(&piece[..count]);
        if String::from_utf8_lossy(&all).contains(text) {
            return;
        }
    }
}

pub(crate) fn kill(process: u32) {
    signal(process, Signal::KILL);
}

pub(crate) fn signal(process: u32, signal: Signal) {
    let process = Pid::from_raw(process.cast_signed()).unwrap();
    rustix::process::kill_process(process, signal).unwrap();
}

/// Waits until a process has ended, of which somebody may still ask how.
pub(crate) fn wait_for_end(process: u32) {
    let process = Pid::from_raw(process.cast_signed()).unwrap();
    let Ok(pidfd) = rustix::process::pidfd_open(process, PidfdFlags::empty()) else {
        return;
    };
    let limit = Timespec::try_from(DEADLINE).unwrap();
    let mut polled = [PollFd::new(&pidfd, PollFlags::IN)];
    let ended = rustix::event::poll(&mut polled, Some(&limit)).unwrap();
    assert_eq!(ended, 1, "{process:?} does not end");
}
