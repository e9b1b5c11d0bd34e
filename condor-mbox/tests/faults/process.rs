//! Child processes, which are this program again.

use std::io::{BufRead, BufReader};
use std::process::{Child, ChildStdout, Command, ExitStatus, Stdio};

use rustix::process::{Pid, Signal, WaitOptions};

use super::AnyError;

/// The environment variable that says which part a child plays.
const PART: &str = "CONDOR_FAULTS_PART";

/// A child process; killed when it is dropped.
pub(crate) struct Process {
    child: Child,
    stdout: Option<BufReader<ChildStdout>>,
}

impl Process {
    /// Starts this program to play `part`.
    ///
    /// Only from the main thread: the children die with the thread that started them.
    pub(crate) fn start(part: &str, prepare: impl FnOnce(&mut Command)) -> Result<Self, AnyError> {
        let mut command = Command::new(std::env::current_exe()?);
        command
            .env(PART, format!("{} {part}", std::process::id()))
            .stdin(Stdio::null())
            .stdout(Stdio::piped());
        prepare(&mut command);
        let mut child = command.spawn()?;
        Ok(Self {
            stdout: child.stdout.take().map(BufReader::new),
            child,
        })
    }

    /// The next line that the child says; `None` after its end.
    pub(crate) fn hear(&mut self) -> Result<Option<String>, AnyError> {
        let mut line = String::new();
        let heard = match &mut self.stdout {
            Some(stdout) => stdout.read_line(&mut line)?,
            None => 0,
        };
        Ok((heard > 0).then(|| line.trim_end().into()))
    }

    pub(crate) fn signal(&self, signal: Signal) -> Result<(), AnyError> {
        Ok(rustix::process::kill_process(self.pid(), signal)?)
    }

    /// Sends SIGSTOP and waits until the process has stopped.
    pub(crate) fn stop(&self) -> Result<(), AnyError> {
        self.signal(Signal::STOP)?;
        match rustix::process::waitpid(Some(self.pid()), WaitOptions::UNTRACED)? {
            Some((_, status)) if status.stopped() => Ok(()),
            other => Err(format!("the child did not stop, but {other:?}").into()),
        }
    }

    /// How the process ended, once it has.
    pub(crate) fn wait(&mut self) -> Result<ExitStatus, AnyError> {
        Ok(self.child.wait()?)
    }

    pub(crate) fn id(&self) -> u32 {
        self.child.id()
    }

    fn pid(&self) -> Pid {
        Pid::from_child(&self.child)
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The part that this process has to play, if it is a child; it ends with its parent.
pub(crate) fn part() -> Result<Option<Vec<String>>, AnyError> {
    let Ok(description) = std::env::var(PART) else {
        return Ok(None);
    };
    let mut words = description.split(' ').map(String::from);
    let parent: i32 = words.next().unwrap_or_default().parse()?;
    rustix::process::set_parent_process_death_signal(Some(Signal::KILL))?;
    if rustix::process::getppid() != Pid::from_raw(parent) {
        return Err("the parent has ended".into());
    }
    Ok(Some(words.collect()))
}
