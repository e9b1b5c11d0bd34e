//! The master restarts errant programs: what is typed at its terminal, in a system of processes and in
//! simulated time.

use std::io::Read as _;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use condor_host::control::{Client, Status};
use condor_host::services::terminals::type_in;
use condor_host::system::SystemDirectory;
use rustix::process::{Pid, Signal, kill_process};
use tempfile::TempDir;

use crate::simulated_time::describe;

/// How long anything may take on a machine that has much else to do.
const DEADLINE: Duration = Duration::from_secs(120);

/// A system with somebody at the master's terminal.
struct Up {
    place: TempDir,
    supervisor: Child,
    terminal: UnixStream,
    shown: String,
}

impl Up {
    fn start(name: &str, change: impl FnOnce(String) -> String) -> Self {
        let place = tempfile::tempdir_in("/dev/shm").unwrap();
        let description = describe(place.path(), name);
        let text = std::fs::read_to_string(&description).unwrap();
        std::fs::write(&description, change(text)).unwrap();
        let mut supervisor = Command::new(env!("CARGO_BIN_EXE_utah-mit-hand"))
            .arg("up")
            .arg(description)
            .args(["--headless", "--speed", "max"])
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
            place,
            supervisor,
            terminal,
            shown: String::new(),
        }
    }

    fn types(&self, name: &str, line: &str) {
        let directory = directory(self.place.path(), name);
        type_in(&directory, "master", format!("{line}\n").as_bytes()).unwrap();
    }

    /// Reads the terminal until it has shown `text`, and forgets all up to there.
    fn expect(&mut self, text: &str) {
        let mut bytes = [0; 4096];
        loop {
            if let Some(at) = self.shown.find(text) {
                self.shown.drain(..at + text.len());
                return;
            }
            let read = self.terminal.read(&mut bytes);
            let count = read.unwrap_or_else(|error| panic!("{error}: {text:?}\n{}", self.shown));
            assert!(count > 0, "the terminal has gone: {text:?}\n{}", self.shown);
            self.shown += &String::from_utf8_lossy(&bytes[..count]).replace('\r', "");
        }
    }

    fn status(&self, name: &str) -> Status {
        let mut client = Client::connect(&directory(self.place.path(), name)).unwrap();
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

fn process(status: &Status, name: &str) -> Option<u32> {
    let mut members = status.members();
    members.find(|it| it.name == name).and_then(|it| it.pid)
}

/// "(c) … or restart errant programs."
#[test]
fn c_it_can_restart_errant_programs() {
    const NAME: &str = "restarts";
    let mut up = Up::start(NAME, |text| text);
    up.expect("wave is done\n");
    let before = up.status(NAME);
    // The program that serves ring and thumb is another one now, which serves nothing.
    up.types(NAME, "load servo-b self table");
    up.expect("processor 2 is gone: nothing controls ring and thumb\n");
    up.expect("load servo-b: done\n");
    up.types(NAME, "status");
    up.expect("ring   gone");
    up.types(NAME, "load 2 self servo");
    up.expect("load 2: done\n");
    up.types(NAME, "enable");
    up.types(NAME, "status");
    up.expect("ring   follows");
    let loaded = up.status(NAME);
    assert_ne!(process(&loaded, "servo-b"), process(&before, "servo-b"));
    // And the same program again, by its name and by its number.
    up.types(NAME, "restart servo-a");
    up.expect("restart servo-a: done\n");
    up.types(NAME, "restart 2");
    up.expect("restart 2: done\n");
    let after = up.status(NAME);
    for (name, restarted) in [
        ("servo-a", true),
        ("servo-b", true),
        ("table", false),
        ("plant", false),
        ("master", false),
        ("files", false),
    ] {
        let is_other = process(&after, name) != process(&loaded, name);
        assert_eq!(is_other, restarted, "{name}");
    }
    up.types(NAME, "enable");
    up.types(NAME, "run open");
    up.expect("open is done\n");
    up.types(NAME, "restart servo-x");
    up.expect(
        "restart servo-x: there is no processor `servo-x`; \
         there are files, terminals, plant, servo-a, servo-b, table, master\n",
    );
    up.types(NAME, "load servo-a /bin/sh");
    up.expect("a processor may load `self` and the programs that the description names");
}

#[test]
fn a_master_that_may_not_restart_programs_is_told_which_key_is_missing() {
    const NAME: &str = "no-restarts";
    let mut up = Up::start(NAME, |text| text.replace("may_ask = ", "# may_ask = "));
    up.types(NAME, "restart servo-a");
    up.expect(
        "the description does not let `master` ask for a restart: \
         its processor needs `may_ask = [\"restart\"]`\n",
    );
}
