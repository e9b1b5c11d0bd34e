//! Child processes: the test program again, told by its environment which part to play.
//!
//! A child says `name value` in lines and waits at its standard input; so whatever happens to it
//! happens at a known place, and nobody sleeps.

use std::env;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, ExitStatus, Stdio};

const PART: &str = "CONDOR_TEST_PART";

/// The part that this process has to play, if it is a child.
pub(crate) fn part() -> Option<String> {
    env::var(PART).ok()
}

/// Tells the parent something.
pub(crate) fn say(what: &str) {
    // Not `println!`, which the test harness may keep for itself.
    let mut out = io::stdout().lock();
    writeln!(out, "\n: {what}")
        .and_then(|()| out.flush())
        .expect("the parent listens");
}

/// Waits until the parent lets this process go.
pub(crate) fn wait_for_parent() {
    let _ = io::stdin().read(&mut [0]);
}

/// A process that plays a part; killed when it is dropped.
pub(crate) struct Actor {
    process: Child,
    stdin: Option<ChildStdin>,
    stdout: BufReader<ChildStdout>,
}

impl Actor {
    /// Starts `part` in the test `entry` of this program.
    pub(crate) fn start(entry: &str, part: &str, prepare: impl FnOnce(&mut Command)) -> Self {
        let mut command = Command::new(env::current_exe().expect("a test has a program"));
        command
            .args([entry, "--exact", "--nocapture"])
            .env(PART, part);
        command
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null());
        prepare(&mut command);
        let mut process = command.spawn().expect("the test program starts again");
        let stdout = BufReader::new(process.stdout.take().expect("it is piped"));
        Self {
            stdin: process.stdin.take(),
            stdout,
            process,
        }
    }

    /// The next thing that the child says; `None` after its end.
    pub(crate) fn hear(&mut self) -> Option<String> {
        let mut line = String::new();
        while self.stdout.read_line(&mut line).expect("lines are text") > 0 {
            if let Some(said) = line.strip_prefix(": ") {
                return Some(said.trim_end().into());
            }
            line.clear();
        }
        None
    }

    /// Lets the child go on.
    pub(crate) fn release(&mut self) {
        drop(self.stdin.take());
    }

    /// Kills the child; gives back when it is gone.
    pub(crate) fn kill(&mut self) {
        self.process.kill().expect("it is our child");
        self.process.wait().expect("it is our child");
    }

    pub(crate) fn wait(&mut self) -> ExitStatus {
        self.process.wait().expect("it is our child")
    }

    pub(crate) fn id(&self) -> u32 {
        self.process.id()
    }
}

impl Drop for Actor {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
