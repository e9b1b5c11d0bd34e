//! Child processes, which are this program again.

use std::process::{Child, Command, ExitStatus, Stdio};

use rustix::process::{Pid, Signal, WaitOptions};

use super::AnyError;

/// The environment variable that says what a child is: its parent, and three numbers.
const PART: &str = "CONDOR_CLOCK_FAULTS_PART";

/// A child process; killed when it is dropped.
pub(crate) struct Process(Child);

impl Process {
    /// Starts this program to play `part`.
    ///
    /// Only from the main thread: the children die with the thread that started them.
    pub(crate) fn start([a, b, c]: [u64; 3]) -> Result<Self, AnyError> {
        let child = Command::new(std::env::current_exe()?)
            .env(PART, format!("{} {a} {b} {c}", std::process::id()))
            .stdin(Stdio::null())
            .spawn()?;
        Ok(Self(child))
    }

    pub(crate) fn kill(&mut self) -> Result<(), AnyError> {
        self.0.kill()?;
        self.0.wait()?;
        Ok(())
    }

    pub(crate) fn signal(&self, signal: Signal) -> Result<(), AnyError> {
        let pid = Pid::from_child(&self.0);
        Ok(rustix::process::kill_process(pid, signal)?)
    }

    /// Sends SIGSTOP and waits until the process has stopped.
    pub(crate) fn stop(&self) -> Result<(), AnyError> {
        self.signal(Signal::STOP)?;
        let pid = Pid::from_child(&self.0);
        match rustix::process::waitpid(Some(pid), WaitOptions::UNTRACED)? {
            Some((_, status)) if status.stopped() => Ok(()),
            other => Err(format!("the child did not stop, but {other:?}").into()),
        }
    }

    /// How the process ended, if it has.
    pub(crate) fn ended(&mut self) -> Result<Option<ExitStatus>, AnyError> {
        Ok(self.0.try_wait()?)
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // It may have ended already.
        let _ = self.kill();
    }
}

/// What this process is, if it is a child; it ends with its parent.
pub(crate) fn part() -> Result<Option<[u64; 3]>, AnyError> {
    let Ok(part) = std::env::var(PART) else {
        return Ok(None);
    };
    let numbers: Vec<u64> = part.split(' ').map(str::parse).collect::<Result<_, _>>()?;
    let [parent, a, b, c] = numbers[..] else {
        return Err(format!("nobody is {part:?}").into());
    };
    rustix::process::set_parent_process_death_signal(Some(Signal::KILL))?;
    if rustix::process::getppid() != Pid::from_raw(parent.try_into()?) {
        return Err("the parent has ended".into());
    }
    Ok(Some([a, b, c]))
}
