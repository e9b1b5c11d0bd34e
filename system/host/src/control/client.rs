//! [`ControlClient`]: asks a supervisor.

use std::io::{BufRead, BufReader, ErrorKind, Write};
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::time::Duration;

use super::{ControlAnswer, ControlRequest, DOWN, SystemEvent, SystemStatus};
use crate::error::AnyError;
use crate::system::{ANSWER, NamedFileError, SystemDirectory};

/// The time that a request may take to take effect; programs may have to end, and others to join.
const DONE: Duration = Duration::from_secs(120);

/// The reason why the supervisor did not carry out a request, or did not answer it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ControlClientError {
    /// The supervisor refuses the request, for this reason.
    #[error("{0}")]
    Refused(String),
    /// No supervisor accepts connections.
    #[error(transparent)]
    Connect(NamedFileError),
    /// The connection to the supervisor broke.
    #[error("the connection to the supervisor broke: {0}")]
    Broken(#[from] std::io::Error),
    /// There was no answer in time; the connection is closed. The supervisor may still carry out
    /// the request.
    #[error(
        "the supervisor has not answered within {} s; it may still carry out the request",
        after.as_secs_f64()
    )]
    TimedOut {
        /// The timeout that has passed.
        after: Duration,
    },
    /// The supervisor has ended before it answered.
    #[error("the supervisor ended before it answered")]
    Ended,
    /// A line came that is not an answer.
    #[error("cannot understand the answer {line:?} of the supervisor: {source}")]
    NoAnswer {
        /// The line that came from the supervisor.
        line: String,
        /// The reason why it is not an answer.
        source: serde_json::Error,
    },
}

/// A connection to the supervisor of a running system, which carries one request after the other.
///
/// Each call waits for the answer. It fails after 15 s; after 120 s for requests that stop, start, restart or load a
/// program, since their answer comes when the program has ended or joined; and after 20 s for the end of the system.
/// [`set_timeout`](Self::set_timeout) replaces all of these times.
#[derive(Debug)]
pub struct ControlClient {
    stream: BufReader<UnixStream>,
    /// Somebody has said how long to wait.
    has_timeout: bool,
}

impl ControlClient {
    /// Connects to the supervisor of the system in `directory`.
    ///
    /// # Errors
    /// [`ControlClientError::Connect`] if no supervisor accepts the connection.
    pub fn connect(directory: &SystemDirectory) -> Result<Self, ControlClientError> {
        Ok(Self {
            stream: BufReader::new(directory.connect().map_err(ControlClientError::Connect)?),
            has_timeout: false,
        })
    }

    /// Sets the longest time for which each later call waits for an answer; `None` means to wait forever.
    ///
    /// # Errors
    /// Returns [`ControlClientError::Broken`] if `timeout` is zero, which the operating system refuses.
    pub fn set_timeout(&mut self, timeout: Option<Duration>) -> Result<(), ControlClientError> {
        self.stream.get_ref().set_read_timeout(timeout)?;
        self.has_timeout = true;
        Ok(())
    }

    /// Sends `request`, and waits for the answer. If the request changes something, the answer comes when the change
    /// has taken effect.
    ///
    /// # Errors
    /// Returns [`ControlClientError::Refused`] if the supervisor refuses the request; the connection can still be used
    /// then. Returns [`ControlClientError::TimedOut`] if no answer comes in time; [`ControlClientError::Ended`] if the
    /// supervisor ends before it answers; [`ControlClientError::Broken`] if the connection breaks;
    /// [`ControlClientError::NoAnswer`] if the line that comes is not an answer.
    pub fn ask(&mut self, request: &ControlRequest) -> Result<ControlAnswer, ControlClientError> {
        let mut line = serde_json::to_string(request).map_err(std::io::Error::from)?;
        line.push('\n');
        self.wait_for(match request {
            ControlRequest::Stop { .. }
            | ControlRequest::Start { .. }
            | ControlRequest::Restart { .. }
            | ControlRequest::Load { .. } => DONE,
            ControlRequest::Down {} => 2 * DOWN,
            _ => ANSWER,
        })?;
        self.stream.get_mut().write_all(line.as_bytes())?;
        let answer: ControlAnswer = self.read()?.ok_or(ControlClientError::Ended)?;
        match answer.error {
            Some(error) if !answer.ok => Err(ControlClientError::Refused(error)),
            _ => Ok(answer),
        }
    }

    /// Asks the supervisor for the present state of the system.
    ///
    /// # Errors
    /// [`ControlClientError::Refused`] if the supervisor refuses; another [`ControlClientError`] if there is no
    /// answer.
    pub fn status(&mut self) -> Result<SystemStatus, ControlClientError> {
        self.ask(&ControlRequest::Status {})?
            .status
            .ok_or(ControlClientError::Ended)
    }

    /// Ends the system, and waits until the supervisor has ended, too. Returns the names of the processors and services
    /// that did not end when they were asked to, and were killed. This takes at most [`DOWN`], unless the supervisor
    /// itself hangs.
    ///
    /// # Errors
    /// Returns [`ControlClientError::TimedOut`] if the system has not ended after 2 × [`DOWN`];
    /// [`ControlClientError::Ended`] if the supervisor was killed before it answered, which ends all programs, too;
    /// [`ControlClientError::Broken`] or [`ControlClientError::NoAnswer`] if the answer cannot be read.
    pub fn down(mut self) -> Result<Vec<String>, ControlClientError> {
        let killed = self.ask(&ControlRequest::Down {})?.killed;
        while self.read::<serde_json::Value>()?.is_some() {}
        Ok(killed)
    }

    /// Returns an iterator over the events from now on. The iterator waits for each event: forever, unless
    /// [`set_timeout`](Self::set_timeout) was called.
    ///
    /// # Errors
    /// [`ControlClientError::Refused`] if the supervisor refuses; another [`ControlClientError`] if there is no
    /// answer.
    pub fn events(mut self) -> Result<ControlEvents, ControlClientError> {
        self.ask(&ControlRequest::Events {})?;
        // Nothing may happen for a long time.
        if !self.has_timeout {
            self.set_timeout(None)?;
        }
        Ok(ControlEvents(self))
    }

    /// Sets the timeout of the next read to `patience`, unless the caller has chosen a timeout.
    fn wait_for(&self, patience: Duration) -> Result<(), ControlClientError> {
        if !self.has_timeout {
            self.stream.get_ref().set_read_timeout(Some(patience))?;
        }
        Ok(())
    }

    fn read<T: serde::de::DeserializeOwned>(&mut self) -> Result<Option<T>, ControlClientError> {
        let mut line = String::new();
        match self.stream.read_line(&mut line) {
            Ok(0) => return Ok(None),
            Ok(_) => {}
            Err(error) if error.kind() == ErrorKind::WouldBlock => {
                let stream = self.stream.get_ref();
                let after = stream.read_timeout()?.unwrap_or_default();
                // An answer that comes now would be taken for that to the next request.
                let _ = stream.shutdown(Shutdown::Both);
                return Err(ControlClientError::TimedOut { after });
            }
            Err(error) => return Err(error.into()),
        }
        match serde_json::from_str(&line) {
            Ok(answer) => Ok(Some(answer)),
            Err(source) => Err(ControlClientError::NoAnswer { line, source }),
        }
    }
}

/// Returns a sentence for people with the names in `killed`, the result of [`ControlClient::down`]; `None` if there are
/// no names.
#[must_use]
pub fn told_of(killed: &[String]) -> Option<String> {
    let names = killed.join(", ");
    (!killed.is_empty()).then(|| format!("killed, since they did not end in time: {names}"))
}

/// Returns the last `lines` lines of the log of the system in `directory`, oldest first, and an iterator over the
/// events after them. The iterator waits for each event, and ends with the system.
///
/// # Errors
/// Returns [`ControlClientError::Connect`] if no supervisor accepts the connection; another [`ControlClientError`] if
/// the supervisor does not answer, or if its answer cannot be read.
pub fn follow(
    directory: &SystemDirectory,
    lines: usize,
) -> Result<
    (
        Vec<String>,
        impl Iterator<Item = Result<SystemEvent, ControlClientError>> + use<>,
    ),
    ControlClientError,
> {
    // Asked for first, so that no event is missed; what happens in between comes twice.
    let events = ControlClient::connect(directory)?.events()?;
    let answer = ControlClient::connect(directory)?.ask(&ControlRequest::Log { lines })?;
    let lines = answer.lines.unwrap_or_default();
    let mut known = lines.clone();
    let news = events.filter(move |event| {
        let is_known = event
            .as_ref()
            .is_ok_and(|it| known.contains(&it.to_string()));
        if !is_known {
            known.clear();
        }
        !is_known
    });
    Ok((lines, news))
}

/// An iterator over the events of a running system. It waits for each event, and ends when the system has ended.
/// [`ControlClient::events`] returns it.
#[derive(Debug)]
pub struct ControlEvents(ControlClient);

impl Iterator for ControlEvents {
    type Item = Result<SystemEvent, ControlClientError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.0.read().transpose()
    }
}

/// Makes the path of a program absolute, for [`ControlRequest::Load`]: the supervisor has another working directory
/// than this program. A name without a slash is returned unchanged, since the supervisor searches for it.
///
/// # Errors
/// Returns the operating system's error if there is no working directory; an error that names the path if the
/// path is not UTF-8.
pub fn from_here(program: String) -> Result<String, AnyError> {
    if !program.contains('/') {
        return Ok(program);
    }
    let path = std::path::absolute(&program).map_err(|error| format!("`{program}`: {error}"))?;
    let path = path.into_os_string().into_string();
    Ok(path.map_err(|path| format!("`{}` is not UTF-8; move the program", path.display()))?)
}

#[cfg(test)]
mod tests {
    use std::os::unix::net::UnixListener;

    use super::*;

    fn listener() -> (tempfile::TempDir, SystemDirectory, UnixListener) {
        let place = tempfile::tempdir().expect("a directory");
        let directory = SystemDirectory::at(place.path().into());
        let listener = UnixListener::bind(directory.control()).expect("room");
        (place, directory, listener)
    }

    #[test]
    fn a_supervisor_that_says_nothing_is_not_waited_for() {
        let (_place, directory, _listener) = listener();
        // Nobody even takes the connection, as if the supervisor were stopped.
        let mut client = ControlClient::connect(&directory).expect("there is room");
        let short = Duration::from_millis(1);
        client.set_timeout(Some(short)).expect("it is not zero");
        let error = client.status().expect_err("there is no answer");
        assert!(
            matches!(error, ControlClientError::TimedOut { .. }),
            "{error:?}: {error}"
        );
        // An answer that comes late is that of no other request.
        let error = client.status().expect_err("there is no answer");
        assert!(
            !matches!(error, ControlClientError::TimedOut { .. }),
            "{error:?}"
        );
    }

    #[test]
    fn every_wait_has_an_end_that_nobody_has_to_set() {
        let (_place, directory, listener) = listener();
        let peer = std::thread::spawn(move || {
            let (stream, _) = listener.accept().expect("a client");
            let mut stream = BufReader::new(stream);
            for _ in 0..3 {
                stream.read_line(&mut String::new()).expect("a request");
                stream
                    .get_mut()
                    .write_all(b"{\"ok\":true}\n")
                    .expect("it reads");
            }
        });
        let mut client = ControlClient::connect(&directory).expect("there is room");
        let stop = ControlRequest::Stop {
            processor: "a".into(),
        };
        for (request, limit) in [(ControlRequest::Log { lines: 1 }, ANSWER), (stop, DONE)] {
            client.ask(&request).expect("an answer");
            let stream = client.stream.get_ref();
            assert_eq!(stream.read_timeout().expect("a socket"), Some(limit));
            assert_eq!(stream.write_timeout().expect("a socket"), Some(ANSWER));
        }
        // Events may be a long time coming.
        let events = client.events().expect("an answer");
        let stream = events.0.stream.get_ref();
        assert_eq!(stream.read_timeout().expect("a socket"), None);
        peer.join().expect("it ends");
    }
}
