//! [`Terminal`]: the terminal of a processor.

use std::io::{ErrorKind, Read as _};
use std::os::unix::net::UnixStream;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use condor_host::services::terminals::type_in;
use condor_host::system::SystemDirectory;
use pyo3::prelude::*;

use crate::failure::{Failure, seconds};
use crate::watch::SLICE;

/// The terminal of a processor, of which Python reads the output and at which it types.
#[pyclass(frozen)]
pub(crate) struct Terminal {
    directory: SystemDirectory,
    name: String,
    shown: Mutex<(UnixStream, Vec<u8>)>,
}

impl Terminal {
    pub(crate) fn open(directory: SystemDirectory, name: String) -> Result<Self, Failure> {
        let path = directory.terminal(&name);
        let stream = UnixStream::connect(&path).map_err(|error| {
            let path = path.display();
            Failure::new_other(format!(
                "cannot connect to the terminal of {name} at {path}: {error}; is the service `terminals` running?"
            ))
        })?;
        Ok(Self {
            directory,
            name,
            shown: Mutex::new((stream, Vec::new())),
        })
    }

    /// Reads output until it contains `text`, for `limit` at most. Returns the output up to the end of `text`, and
    /// forgets it; `None` if `text` has not come.
    fn take(&self, text: &[u8], limit: Duration) -> Result<Option<Vec<u8>>, Failure> {
        let mut shown = self.shown.lock().unwrap_or_else(PoisonError::into_inner);
        let (stream, kept) = &mut *shown;
        let begun = Instant::now();
        loop {
            let mut places = kept.windows(text.len().max(1));
            if let Some(at) = places.position(|it| it == text) {
                return Ok(Some(kept.drain(..at + text.len()).collect()));
            }
            let left = limit.saturating_sub(begun.elapsed());
            if left.is_zero() {
                return Ok(None);
            }
            stream.set_read_timeout(Some(left))?;
            let mut bytes = [0; 4096];
            match stream.read(&mut bytes) {
                Ok(0) => return Err(Failure::new_other("the service `terminals` has ended")),
                Ok(count) => kept.extend(bytes.get(..count).unwrap_or_default()),
                Err(error) => match error.kind() {
                    ErrorKind::WouldBlock | ErrorKind::Interrupted => {}
                    _ => return Err(error.into()),
                },
            }
        }
    }
}

#[pymethods]
impl Terminal {
    /// Types the characters of `text` at the terminal.
    fn write(&self, py: Python<'_>, text: &str) -> PyResult<()> {
        let typed = py.detach(|| type_in(&self.directory, &self.name, text.as_bytes()));
        typed.map_err(|error| {
            let name = &self.name;
            Failure::new_other(format!("cannot type at the terminal of {name}: {error}")).into()
        })
    }

    /// Waits until the terminal has shown `text`. Returns its output since the last call, up to the end of `text`.
    fn read_until(&self, py: Python<'_>, text: &str, timeout: f64) -> PyResult<String> {
        let limit = seconds("timeout", timeout)?;
        let begun = Instant::now();
        loop {
            let left = limit.saturating_sub(begun.elapsed()).min(SLICE);
            let taken = py.detach(|| self.take(text.as_bytes(), left))?;
            if let Some(taken) = taken {
                return Ok(String::from_utf8_lossy(&taken).into_owned());
            }
            if begun.elapsed() >= limit {
                let (name, limit) = (&self.name, limit.as_secs_f64());
                let text =
                    format!("the terminal of {name} has not shown {text:?} within {limit} s");
                return Err(Failure::timed_out(text).into());
            }
            py.check_signals()?;
        }
    }
}
