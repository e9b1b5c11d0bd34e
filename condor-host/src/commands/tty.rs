//! `condor tty`.

use std::fs::File;
use std::io::{ErrorKind, IsTerminal, Read, Write};
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

use clap::Args;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use serde::Serialize;

use super::How;
use super::number::duration;
use super::running::Running;
use crate::error::AnyError;
use crate::services::terminals::keyboard;

/// Ctrl-], as telnet has it.
const LEAVE: u8 = 0x1d;

#[derive(Debug, Args)]
pub(crate) struct Tty {
    /// The name or the number of the processor
    processor: String,
    /// Disconnects after this time, such as 10s
    #[arg(long = "for", value_name = "TIME", value_parser = duration)]
    limit: Option<Duration>,
    #[command(flatten)]
    how: How,
}

#[derive(Serialize)]
struct Output<'o> {
    output: &'o str,
}

/// The terminal in raw mode, as long as this lives.
struct Raw;

impl Raw {
    fn enable() -> std::io::Result<Self> {
        crossterm::terminal::enable_raw_mode()?;
        Ok(Self)
    }
}

impl Drop for Raw {
    fn drop(&mut self) {
        // Nothing can be done about it any more.
        let _ = crossterm::terminal::disable_raw_mode();
    }
}

impl Tty {
    pub(crate) fn run(&self) -> Result<(), AnyError> {
        let running = Running::find(&self.how.which)?;
        let name = &running.processor(&self.processor)?.name;
        let path = running.directory.terminal(name);
        let stream = UnixStream::connect(&path).map_err(|error| {
            format!(
                "cannot connect to the terminal of {name} at {}: {error}; \
                 is the service `terminals` running?",
                path.display()
            )
        })?;
        let is_person = std::io::stdin().is_terminal();
        let raw = if is_person {
            eprintln!("Connected to the terminal of {name}; Ctrl-] disconnects.");
            Some(Raw::enable()?)
        } else {
            None
        };
        let keyboard = keyboard(&running.directory, name)?;
        let outcome = self.connect(stream, keyboard, is_person);
        drop(raw);
        if is_person {
            eprintln!();
        }
        outcome
    }

    fn connect(
        &self,
        mut stream: UnixStream,
        mut keyboard: File,
        is_person: bool,
    ) -> Result<(), AnyError> {
        let deadline = self.limit.map(|limit| Instant::now() + limit);
        let mut input = Some(std::io::stdin().lock());
        let mut bytes = [0; 4096];
        loop {
            let left = deadline.map(|at| at.saturating_duration_since(Instant::now()));
            if left.is_some_and(|left| left.is_zero()) {
                return Ok(());
            }
            let limit = left.and_then(|left| Timespec::try_from(left).ok());
            let mut polled = vec![PollFd::new(&stream, PollFlags::IN)];
            if let Some(input) = &input {
                polled.push(PollFd::from_borrowed_fd(input.as_fd(), PollFlags::IN));
            }
            match poll(&mut polled, limit.as_ref()) {
                Ok(_) => {}
                Err(Errno::INTR) => continue,
                Err(error) => return Err(error.into()),
            }
            let [shown, typed] = [0, 1].map(|place| {
                let polled = polled.get(place);
                polled.is_some_and(|polled| !polled.revents().is_empty())
            });
            drop(polled);
            if shown {
                match stream.read(&mut bytes) {
                    Ok(0) => return Err("the service `terminals` has ended".into()),
                    Ok(count) => self.show(bytes.get(..count).unwrap_or_default())?,
                    Err(error) if error.kind() == ErrorKind::Interrupted => {}
                    Err(error) => return Err(error.into()),
                }
            }
            if typed && let Some(from) = &input {
                let count = rustix::io::read(from.as_fd(), &mut bytes)?;
                let typed = bytes.get(..count).unwrap_or_default();
                if is_person && typed.contains(&LEAVE) {
                    return Ok(());
                }
                keyboard.write_all(typed)?;
                if count == 0 {
                    if is_person || deadline.is_none() {
                        return Ok(());
                    }
                    input = None;
                }
            }
        }
    }

    fn show(&self, bytes: &[u8]) -> Result<(), AnyError> {
        if self.how.json {
            let output = String::from_utf8_lossy(bytes);
            return super::print_json(&Output { output: &output });
        }
        let mut out = std::io::stdout().lock();
        out.write_all(bytes)?;
        Ok(out.flush()?)
    }
}
