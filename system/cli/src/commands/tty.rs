//! `condor tty`.

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
use condor_host::error::AnyError;
use condor_host::services::terminals::{Keyboard, keyboard};

/// Ctrl-], as telnet has it.
const LEAVE: u8 = 0x1d;

/// The time for which a terminal is quiet when it has answered piped input.
const QUIET: Duration = Duration::from_secs(2);
/// The longest wait for the end of the answer.
const ANSWER: Duration = Duration::from_secs(30);
/// The wait until there may be room for more typed characters.
const ROOM: Duration = Duration::from_millis(20);
/// The number of typed characters of a person that may wait here for room: Ctrl-] is found in them.
const PENDING: usize = 64 * 1024;

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

/// The terminal in raw mode, as long as this value exists.
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
        let outcome = self.connect(&stream, keyboard, is_person);
        drop(raw);
        if is_person {
            eprintln!();
        }
        outcome
    }

    fn connect(
        &self,
        mut stream: &UnixStream,
        mut keyboard: Keyboard,
        is_person: bool,
    ) -> Result<(), AnyError> {
        let end = self.limit.map(|limit| Instant::now() + limit);
        let mut input = Some(std::io::stdin().lock());
        // The characters that were read and not yet typed, and the time until which answers are waited for.
        let (mut pending, mut last) = (Vec::new(), None);
        let mut quiet = Instant::now();
        let mut bytes = [0; 4096];
        loop {
            let typed = keyboard.type_in(&pending)?;
            pending.drain(..typed);
            if input.is_none() && end.is_none() {
                let now = Instant::now();
                if typed > 0 || last.is_none() {
                    (quiet, last) = (now + QUIET, last.or(Some(now + ANSWER)));
                }
            }
            // The terminal may be quiet because its program takes nothing.
            let quiet_at = if pending.is_empty() {
                Some(quiet)
            } else {
                None
            };
            let deadline = end.or(last.map(|last| quiet_at.map_or(last, |at| last.min(at))));
            let mut left = deadline.map(|at| at.saturating_duration_since(Instant::now()));
            if left.is_some_and(|left| left.is_zero()) {
                if input.is_none() && !pending.is_empty() {
                    let count = pending.len();
                    return Err(
                        format!("the program has not taken the last {count} characters").into(),
                    );
                }
                return Ok(());
            }
            if !pending.is_empty() {
                left = Some(left.map_or(ROOM, |left| left.min(ROOM)));
            }
            let limit = left.and_then(|left| Timespec::try_from(left).ok());
            // The writer of a pipe waits while the terminal is full.
            let most = if is_person { PENDING } else { 1 };
            let reads = pending.len() < most;
            let mut polled = vec![PollFd::new(stream, PollFlags::IN)];
            if let Some(input) = input.as_ref().filter(|_| reads) {
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
                    Ok(0) => return Err(
                        "the service `terminals` has ended; unless the system has, too, `start \
                     terminals` starts it again"
                            .into(),
                    ),
                    Ok(count) => self.show(bytes.get(..count).unwrap_or_default())?,
                    Err(error) if error.kind() == ErrorKind::Interrupted => {}
                    Err(error) => return Err(error.into()),
                }
                quiet = Instant::now() + QUIET;
            }
            if typed && let Some(from) = &input {
                let count = rustix::io::read(from.as_fd(), &mut bytes)?;
                let typed = bytes.get(..count).unwrap_or_default();
                if is_person && typed.contains(&LEAVE) {
                    return Ok(());
                }
                pending.extend_from_slice(typed);
                if count == 0 {
                    if is_person {
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
