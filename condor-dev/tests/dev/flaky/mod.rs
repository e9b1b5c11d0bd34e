//! Readers and writers that move less than they are asked to, and fail, as a script says.

use std::collections::VecDeque;
use std::io;

use embedded_io::{ErrorKind, ErrorType};
use proptest::prelude::*;

/// What one call does: move at most so many bytes, or fail. At the script's end all succeeds.
pub(crate) type Script = VecDeque<Option<usize>>;

#[allow(
    dead_code,
    reason = "not all tests that share this module draw their scripts"
)]
pub(crate) fn script() -> impl Strategy<Value = Script> {
    let call = prop_oneof![3 => (1..12_usize).prop_map(Some), 1 => Just(None)];
    prop::collection::vec(call, 0..if cfg!(miri) { 8 } else { 40 }).prop_map(VecDeque::from)
}

#[derive(Debug, Default)]
pub(crate) struct Flaky {
    script: Script,
    /// What it gives, or what it was given.
    pub(crate) bytes: Vec<u8>,
    /// How many it was asked to move by each call that moved some.
    pub(crate) asked: Vec<usize>,
}

impl Flaky {
    pub(crate) fn new(script: Script, bytes: Vec<u8>) -> Self {
        Self {
            script,
            bytes,
            asked: Vec::new(),
        }
    }

    fn next(&mut self, asked: usize) -> Result<usize, ErrorKind> {
        match self.script.pop_front() {
            None => {
                self.asked.push(asked);
                Ok(asked)
            }
            Some(Some(count)) => {
                self.asked.push(asked);
                Ok(asked.min(count))
            }
            Some(None) => Err(ErrorKind::TimedOut),
        }
    }

    fn give(&mut self, into: &mut [u8]) -> Result<usize, ErrorKind> {
        let count = self.next(into.len())?.min(self.bytes.len());
        for (place, byte) in into.iter_mut().zip(self.bytes.drain(..count)) {
            *place = byte;
        }
        Ok(count)
    }

    fn take(&mut self, from: &[u8]) -> Result<usize, ErrorKind> {
        let count = self.next(from.len())?;
        self.bytes.extend(&from[..count]);
        Ok(count)
    }
}

impl ErrorType for Flaky {
    type Error = ErrorKind;
}

impl embedded_io::Read for Flaky {
    fn read(&mut self, into: &mut [u8]) -> Result<usize, ErrorKind> {
        self.give(into)
    }
}

impl embedded_io::Write for Flaky {
    fn write(&mut self, from: &[u8]) -> Result<usize, ErrorKind> {
        self.take(from)
    }

    fn flush(&mut self) -> Result<(), ErrorKind> {
        self.next(0).map(|_| ())
    }
}

/// std retries what was interrupted; nothing else has this kind.
fn timed_out(_: ErrorKind) -> io::Error {
    io::ErrorKind::TimedOut.into()
}

impl io::Read for Flaky {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        self.give(into).map_err(timed_out)
    }
}

impl io::Write for Flaky {
    fn write(&mut self, from: &[u8]) -> io::Result<usize> {
        self.take(from).map_err(timed_out)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.next(0).map(|_| ()).map_err(timed_out)
    }
}
