//! [`Process`]: a processor that is a process of this machine.

use std::io::{ErrorKind, PipeReader, Read};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child, Command, Stdio};

use rustix::fs::OFlags;
use rustix::process::{Pid, PidfdFlags, Signal};

use super::launch::{Exit, Image, Launch, LaunchError, RunState, Stop};

/// A process that dies with the thread that started it, and is asked to end by SIGTERM.
#[derive(Debug, Default)]
pub struct Process {
    image: Option<Image>,
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
    /// What is not a whole line yet.
    begun: Vec<u8>,
}

/// Bytes after which a line is told though it has not ended.
const LONGEST: usize = 4096;

impl Process {
    /// A processor without a program.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    fn spawn(&mut self, image: &Image) -> std::io::Result<()> {
        let (pipe, writer) = std::io::pipe()?;
        rustix::fs::fcntl_setfl(&pipe, rustix::fs::fcntl_getfl(&pipe)? | OFlags::NONBLOCK)?;
        let mut command = Command::new(&image.file);
        image
            .environment
            .pass_to(&mut command)
            .args(&image.arguments)
            .stdin(Stdio::null())
            .stdout(writer.try_clone()?)
            .stderr(writer)
            // ^C is for the supervisor, which ends the others in order.
            .process_group(0);
        let parent = rustix::process::getpid();
        let die_with_parent = move || {
            rustix::process::set_parent_process_death_signal(Some(Signal::KILL))?;
            // It may have died before this was arranged.
            if rustix::process::getppid() != Some(parent) {
                return Err(rustix::io::Errno::SRCH.into());
            }
            Ok(())
        };
        // SAFETY: between `fork` and `exec` the closure makes two system calls, and neither
        // allocates nor takes a lock.
        unsafe { command.pre_exec(die_with_parent) };
        let child = command.spawn()?;
        let pidfd = rustix::process::pidfd_open(Pid::from_child(&child), PidfdFlags::NONBLOCK)?;
        self.running = Some(Running { child, pidfd });
        self.output = Some(Output {
            pipe,
            begun: Vec::new(),
        });
        Ok(())
    }
}

impl Launch for Process {
    fn load(&mut self, image: &Image) -> Result<(), LaunchError> {
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
        self.spawn(&image).map_err(|source| LaunchError::Os {
            doing: "start",
            file: image.file,
            source,
        })
    }

    fn stop(&mut self, how: Stop) -> Result<(), LaunchError> {
        let Some(running) = &self.running else {
            return Ok(());
        };
        let signal = match how {
            Stop::Ask => Signal::TERM,
            Stop::Force => Signal::KILL,
        };
        match rustix::process::pidfd_send_signal(&running.pidfd, signal) {
            // It has ended, and will be noticed.
            Ok(()) | Err(rustix::io::Errno::SRCH) => Ok(()),
            Err(source) => Err(LaunchError::Os {
                doing: "stop",
                file: self
                    .image
                    .as_ref()
                    .map(|image| image.file.clone())
                    .unwrap_or_default(),
                source: source.into(),
            }),
        }
    }

    fn state(&mut self) -> RunState {
        if let Some(running) = &mut self.running {
            let exit = match running.child.try_wait() {
                Ok(None) => return RunState::Runs,
                Ok(Some(status)) => match (status.code(), status.signal()) {
                    (Some(code), _) => Exit::Status(code),
                    (None, Some(signal)) => Exit::Signal(signal),
                    (None, None) => Exit::Unknown,
                },
                Err(_) => Exit::Unknown,
            };
            self.running = None;
            self.ended = Some(exit);
        }
        self.ended.map_or(RunState::Idle, RunState::Ended)
    }

    fn ended(&self) -> Option<BorrowedFd<'_>> {
        self.running.as_ref().map(|running| running.pidfd.as_fd())
    }

    fn output(&mut self, line: &mut dyn FnMut(&str)) {
        let Some(output) = &mut self.output else {
            return;
        };
        let mut piece = [0; 4096];
        loop {
            match output.pipe.read(&mut piece) {
                Ok(0) => break,
                Ok(count) => output.tell(piece.get(..count).unwrap_or_default(), line),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => return,
                Err(_) => break,
            }
        }
        output.tell(b"\n", line);
        self.output = None;
    }

    fn has_output(&self) -> Option<BorrowedFd<'_>> {
        self.output.as_ref().map(|output| output.pipe.as_fd())
    }

    fn process(&self) -> Option<u32> {
        self.running.as_ref().map(|running| running.child.id())
    }
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

impl Drop for Process {
    fn drop(&mut self) {
        if let Some(running) = &mut self.running {
            // Who drops it without having stopped it has failed.
            let _ = running.child.kill();
            let _ = running.child.wait();
        }
    }
}
