//! [`ChildProcess`]: a processor that is a process of this machine.

use std::io::{ErrorKind, PipeReader, Read};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child, Command, Stdio};

use rustix::fs::OFlags;
use rustix::process::{Pid, PidfdFlags, Signal, WaitId, WaitIdOptions};

use super::{Exit, Launch, LaunchError, ProgramImage, RunState, StopMethod};
use crate::error::NamedFileError;

/// A [`Launch`] of a processor that is a process of this machine. SIGTERM asks the process to end, and it is killed
/// when the thread that started it ends. A process that has stopped itself by SIGTSTP counts as held for a debugger, and
/// is killed when it is to end.
///
/// The process has a process group of its own. Processes that are still in this group when it has ended are killed. A
/// descendant that has made a group of its own is not killed here, but by the keeper process of the program `condor`.
#[derive(Debug, Default)]
pub struct ChildProcess {
    image: Option<ProgramImage>,
    running: Option<Running>,
    ended: Option<Exit>,
    output: Option<Output>,
}

#[derive(Debug)]
struct Running {
    child: Child,
    pidfd: OwnedFd,
}

/// Standard output and error of the process.
#[derive(Debug)]
struct Output {
    pipe: PipeReader,
    /// The begin of a line whose end has not come yet.
    begun: Vec<u8>,
}

/// Bytes after which a line is told though it has not ended.
const LONGEST: usize = 4096;
/// Bytes that are read in a turn while the process runs.
const AT_ONCE: usize = 16 * 1024;
/// Bytes of a pipe: what a process that has ended can have left.
const PIPE: usize = 64 * 1024;

impl ChildProcess {
    /// Makes a processor on which no program is loaded yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    fn spawn(&mut self, image: &ProgramImage) -> std::io::Result<()> {
        let (pipe, writer) = std::io::pipe()?;
        rustix::fs::fcntl_setfl(&pipe, rustix::fs::fcntl_getfl(&pipe)? | OFlags::NONBLOCK)?;
        let mut command = Command::new(&image.file);
        image
            .environment
            .pass_to(&mut command)?
            .args(&image.arguments)
            .stdin(Stdio::null())
            .stdout(writer.try_clone()?)
            .stderr(writer)
            // ^C is for the supervisor, which ends the others in order.
            .process_group(0);
        die_with_parent(&mut command, Signal::KILL, false);
        let open = |process| rustix::process::pidfd_open(process, PidfdFlags::NONBLOCK);
        self.running = Some(Running::watch(command.spawn()?, open)?);
        self.output = Some(Output {
            pipe,
            begun: Vec::new(),
        });
        Ok(())
    }
}

impl Launch for ChildProcess {
    fn load(&mut self, image: &ProgramImage) -> Result<(), LaunchError> {
        if self.running.is_some() {
            return Err(LaunchError::Runs);
        }
        self.image = Some(image.clone());
        Ok(())
    }

    fn start(&mut self) -> Result<(), LaunchError> {
        if self.running.is_some() {
            return Err(LaunchError::Runs);
        }
        let image = self.image.clone().ok_or(LaunchError::NotLoaded)?;
        self.ended = None;
        let started = self.spawn(&image);
        Ok(started.map_err(NamedFileError::at("start", image.file))?)
    }

    fn stop(&mut self, how: StopMethod) -> Result<(), LaunchError> {
        let Some(running) = &self.running else {
            return Ok(());
        };
        let signal = match how {
            StopMethod::Ask if !self.is_held() => Signal::TERM,
            // One that is held could not take the other signal.
            StopMethod::Ask | StopMethod::Force => Signal::KILL,
        };
        match rustix::process::pidfd_send_signal(&running.pidfd, signal) {
            // The process has ended, and that will be noticed.
            Ok(()) | Err(rustix::io::Errno::SRCH) => Ok(()),
            Err(error) => {
                let file = self.image.as_ref().map(|image| image.file.clone());
                Err(NamedFileError::at("stop", file.unwrap_or_default())(error.into()).into())
            }
        }
    }

    fn state(&mut self) -> RunState {
        if let Some(running) = &mut self.running {
            let Some(exit) = running.exit() else {
                return RunState::Runs;
            };
            self.running = None;
            self.ended = Some(exit);
        }
        self.ended.clone().map_or(RunState::Idle, RunState::Ended)
    }

    fn is_held(&self) -> bool {
        self.running.as_ref().is_some_and(Running::is_held)
    }

    fn ended(&self) -> Option<BorrowedFd<'_>> {
        self.running.as_ref().map(|running| running.pidfd.as_fd())
    }

    fn output(&mut self, line: &mut dyn FnMut(&str)) -> bool {
        let Some(output) = &mut self.output else {
            return false;
        };
        // A process that has ended writes no more.
        let mut left = if self.running.is_some() {
            AT_ONCE
        } else {
            PIPE
        };
        let mut piece = [0; 4096];
        while left > 0 {
            match output.pipe.read(&mut piece) {
                Ok(0) => break,
                Ok(count) => {
                    output.tell(piece.get(..count).unwrap_or_default(), line);
                    left = left.saturating_sub(count);
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => return false,
                Err(_) => break,
            }
        }
        if left == 0 && self.running.is_some() {
            return true;
        }
        output.tell(b"\n", line);
        self.output = None;
        false
    }

    fn has_output(&self) -> Option<BorrowedFd<'_>> {
        self.output.as_ref().map(|output| output.pipe.as_fd())
    }

    fn process(&self) -> Option<u32> {
        self.running.as_ref().map(|running| running.child.id())
    }
}

impl Running {
    /// Kills the child if it cannot be watched: nobody else would ever end it.
    fn watch(
        mut child: Child,
        open: impl FnOnce(Pid) -> rustix::io::Result<OwnedFd>,
    ) -> std::io::Result<Self> {
        match open(Pid::from_child(&child)) {
            Ok(pidfd) => Ok(Self { child, pidfd }),
            Err(error) => {
                end(&mut child);
                Err(error.into())
            }
        }
    }

    /// Returns true if it has stopped itself for a debugger, by the signal of
    /// [`hold_for_debugger`](condor_platform::linux::hold_for_debugger).
    fn is_held(&self) -> bool {
        let flags = WaitIdOptions::STOPPED | WaitIdOptions::NOHANG | WaitIdOptions::NOWAIT;
        let process = WaitId::Pid(Pid::from_child(&self.child));
        let stopped = rustix::process::waitid(process, flags).ok().flatten();
        let signal = stopped.and_then(|status| status.stopping_signal());
        signal == Some(Signal::TSTP.as_raw())
    }

    /// Returns the way in which it ended, if it has; then its group has ended, too.
    fn exit(&mut self) -> Option<Exit> {
        let flags = WaitIdOptions::EXITED | WaitIdOptions::NOHANG | WaitIdOptions::NOWAIT;
        let process = Pid::from_child(&self.child);
        // As long as nobody has asked how it ended, its number is that of its group and of no other.
        match rustix::process::waitid(WaitId::Pid(process), flags) {
            Ok(None) => return None,
            Ok(Some(_)) => end_group(process),
            Err(_) => return Some(Exit::Unknown),
        }
        Some(match self.child.try_wait() {
            Ok(Some(status)) => match (status.code(), status.signal()) {
                (Some(code), _) => Exit::Status(code),
                (None, Some(signal)) => Exit::Signal(signal),
                (None, None) => Exit::Unknown,
            },
            _ => Exit::Unknown,
        })
    }
}

/// Has the process of a command get `signal` when the thread that starts it dies, and begin a session of its
/// own if that is wished for.
pub(crate) fn die_with_parent(command: &mut Command, signal: Signal, session: bool) {
    let parent = rustix::process::getpid();
    let prepare = move || {
        if session {
            rustix::process::setsid()?;
        }
        rustix::process::set_parent_process_death_signal(Some(signal))?;
        // The parent may have died before this was arranged.
        if rustix::process::getppid() != Some(parent) {
            return Err(rustix::io::Errno::SRCH.into());
        }
        Ok(())
    };
    // SAFETY: between `fork` and `exec` the closure makes three system calls, and neither
    // allocates nor takes a lock.
    unsafe { command.pre_exec(prepare) };
}

/// Kills a process and its group.
fn end(child: &mut Child) {
    end_group(Pid::from_child(child));
    // The child may have ended already.
    let _ = child.kill();
    let _ = child.wait();
}

/// Kills all processes of the group of a process whose number cannot have gone to another one.
fn end_group(leader: Pid) {
    // Nobody may be left in it.
    let _ = rustix::process::kill_process_group(leader, Signal::KILL);
}

impl Output {
    fn tell(&mut self, bytes: &[u8], line: &mut dyn FnMut(&str)) {
        for &byte in bytes {
            if byte != b'\n' {
                self.begun.push(byte);
            }
            if byte == b'\n' || self.begun.len() >= LONGEST {
                let text = String::from_utf8_lossy(&self.begun);
                if !text.trim().is_empty() {
                    line(text.trim_end());
                }
                self.begun.clear();
            }
        }
    }
}

impl Drop for ChildProcess {
    fn drop(&mut self) {
        if let Some(running) = &mut self.running {
            // The owner has failed if it drops a program that was not stopped.
            end(&mut running.child);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_child_that_cannot_be_watched_is_killed() {
        let child = Command::new("sleep")
            .arg("1000")
            .process_group(0)
            .spawn()
            .expect("there is `sleep`");
        let process = Pid::from_child(&child);
        let refused = Running::watch(child, |_| Err(rustix::io::Errno::MFILE));
        assert_eq!(
            refused.expect_err("it is refused").kind(),
            std::io::Error::from(rustix::io::Errno::MFILE).kind()
        );
        let there = rustix::process::test_kill_process(process);
        assert_eq!(there, Err(rustix::io::Errno::SRCH), "it is leaked");
    }
}
