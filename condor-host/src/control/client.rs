//! [`Client`]: asks a supervisor.

use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::time::Duration;

use super::{Answer, Event, Request, Status};
use crate::system::Directory;

/// Why there is no answer, or none that was wished for.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ClientError {
    /// The supervisor says no.
    #[error("{0}")]
    Refused(String),
    /// Nobody listens.
    #[error("cannot connect to {path:?}: {source}")]
    Connect {
        /// The socket.
        path: PathBuf,
        /// The answer.
        source: std::io::Error,
    },
    /// The connection broke.
    #[error("the connection to the supervisor broke: {0}")]
    Broken(#[from] std::io::Error),
    /// The supervisor has ended.
    #[error("the supervisor ended before it answered")]
    Ended,
    /// What came is no answer.
    #[error("the supervisor answered {line:?}: {source}")]
    NoAnswer {
        /// What came.
        line: String,
        /// What is wrong with it.
        source: serde_json::Error,
    },
}

/// A connection to the supervisor of a running system.
#[derive(Debug)]
pub struct Client {
    stream: BufReader<UnixStream>,
}

impl Client {
    /// Connects to the supervisor of a system.
    ///
    /// # Errors
    /// [`ClientError::Connect`].
    pub fn connect(directory: &Directory) -> Result<Self, ClientError> {
        let path = directory.control();
        match UnixStream::connect(&path) {
            Ok(stream) => Ok(Self {
                stream: BufReader::new(stream),
            }),
            Err(source) => Err(ClientError::Connect { path, source }),
        }
    }

    /// Waits for answers for at most `timeout`, or for ever.
    ///
    /// # Errors
    /// The system's; it takes no zero.
    pub fn set_timeout(&self, timeout: Option<Duration>) -> Result<(), ClientError> {
        Ok(self.stream.get_ref().set_read_timeout(timeout)?)
    }

    /// Asks, and waits for the answer.
    ///
    /// # Errors
    /// [`ClientError`]; `Refused` is the supervisor's word, and the connection goes on.
    pub fn ask(&mut self, request: &Request) -> Result<Answer, ClientError> {
        let mut line = serde_json::to_string(request).map_err(std::io::Error::from)?;
        line.push('\n');
        self.stream.get_mut().write_all(line.as_bytes())?;
        let answer: Answer = self.read()?.ok_or(ClientError::Ended)?;
        match answer.error {
            Some(error) if !answer.ok => Err(ClientError::Refused(error)),
            _ => Ok(answer),
        }
    }

    /// How the system is.
    ///
    /// # Errors
    /// As [`ask`](Self::ask).
    pub fn status(&mut self) -> Result<Status, ClientError> {
        self.ask(&Request::Status {})?
            .status
            .ok_or(ClientError::Ended)
    }

    /// Ends the system, and waits until it has ended.
    ///
    /// # Errors
    /// As [`ask`](Self::ask).
    pub fn down(mut self) -> Result<(), ClientError> {
        self.ask(&Request::Down {})?;
        while self.read::<serde_json::Value>()?.is_some() {}
        Ok(())
    }

    /// All that happens from now on.
    ///
    /// # Errors
    /// As [`ask`](Self::ask).
    pub fn events(mut self) -> Result<Events, ClientError> {
        self.ask(&Request::Events {})?;
        Ok(Events(self))
    }

    fn read<T: serde::de::DeserializeOwned>(&mut self) -> Result<Option<T>, ClientError> {
        let mut line = String::new();
        if self.stream.read_line(&mut line)? == 0 {
            return Ok(None);
        }
        match serde_json::from_str(&line) {
            Ok(answer) => Ok(Some(answer)),
            Err(source) => Err(ClientError::NoAnswer { line, source }),
        }
    }
}

/// What happens in a system, until it ends.
#[derive(Debug)]
pub struct Events(Client);

impl Iterator for Events {
    type Item = Result<Event, ClientError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.0.read().transpose()
    }
}
