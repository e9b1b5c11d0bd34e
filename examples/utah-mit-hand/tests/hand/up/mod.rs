//! The system of the hand as processes in simulated time, with somebody at the master's terminal.

use std::io::Read as _;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use condor_host::control::{ControlClient, SystemStatus};
use condor_host::services::terminals::type_in;
use condor_host::system::SystemDirectory;
use rustix::process::{Pid, Signal, kill_process};
use tempfile::TempDir;

use crate::simulated_time::describe;

/// How long anything may take on a machine that has much else to do.
pub(crate) const DEADLINE: Duration = Duration::from_secs(120);

/// A system with somebody at the master's terminal.
pub(crate) struct Up {
    name: &'static str,
    place: TempDir,
    supervisor: Child,
    terminal: UnixStream,
    shown: String,
}

impl Up {
    /// Brings it up, with a changed description, at a speed as `--speed` has it.
    pub(crate) fn start(
        name: &'static str,
        speed: &str,
        change: impl FnOnce(String) -> String,
    ) -> Self {
        Self::of("system.toml", name, speed, change)
    }

    /// Brings up the shipped system in `file`, with a changed description, at a speed as `--speed` has it.
    pub(crate) fn of(
        file: &str,
        name: &'static str,
        speed: &str,
        change: impl FnOnce(String) -> String,
    ) -> Self {
        let place = tempfile::tempdir_in("/dev/shm").unwrap();
        let description = describe(file, place.path(), name);
        let text = std::fs::read_to_string(&description).unwrap();
        std::fs::write(&description, change(text)).unwrap();
        let mut supervisor = Command::new(env!("CARGO_BIN_EXE_utah-mit-hand"))
            .arg("up")
            .arg(description)
            .args(["--headless", "--speed", speed])
            .env("XDG_RUNTIME_DIR", place.path())
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let told = supervisor.stderr.take().unwrap();
        let told = std::io::BufRead::lines(std::io::BufReader::new(told));
        let mut all = Vec::new();
        for line in told {
            all.push(line.unwrap());
            if all.iter().any(|line| line.contains("have been started")) {
                break;
            }
        }
        let directory = directory(place.path(), name);
        let terminal = UnixStream::connect(directory.terminal("master"))
            .unwrap_or_else(|error| panic!("{error}: {all:?}"));
        terminal.set_read_timeout(Some(DEADLINE)).unwrap();
        Self {
            name,
            place,
            supervisor,
            terminal,
            shown: String::new(),
        }
    }

    pub(crate) fn place(&self) -> &Path {
        self.place.path()
    }

    pub(crate) fn directory(&self) -> SystemDirectory {
        directory(self.place(), self.name)
    }

    pub(crate) fn types(&self, line: &str) {
        type_in(&self.directory(), "master", format!("{line}\n").as_bytes()).unwrap();
    }

    /// Reads the terminal until it has shown `text`; returns all up to there, and forgets it.
    pub(crate) fn expect(&mut self, text: &str) -> String {
        let mut bytes = [0; 4096];
        loop {
            if let Some(at) = self.shown.find(text) {
                return self.shown.drain(..at + text.len()).collect();
            }
            let read = self.terminal.read(&mut bytes);
            let count = read.unwrap_or_else(|error| panic!("{error}: {text:?}\n{}", self.shown));
            assert!(count > 0, "the terminal has gone: {text:?}\n{}", self.shown);
            self.shown += &String::from_utf8_lossy(&bytes[..count]).replace('\r', "");
        }
    }

    pub(crate) fn status(&self) -> SystemStatus {
        let mut client = ControlClient::connect(&self.directory()).unwrap();
        client.set_timeout(Some(DEADLINE)).unwrap();
        client.status().unwrap()
    }
}

impl Drop for Up {
    fn drop(&mut self) {
        let _ = kill_process(Pid::from_child(&self.supervisor), Signal::INT);
        let _ = self.supervisor.wait();
    }
}

fn directory(place: &Path, name: &str) -> SystemDirectory {
    SystemDirectory::at(place.join("condor").join(name))
}
