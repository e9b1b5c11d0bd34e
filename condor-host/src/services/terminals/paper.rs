//! [`Paper`]: what a terminal writes, and what is typed there, both in files that outlive the service.

use std::io;
use std::path::Path;

use condor_tty::linux::Sink;

use super::record::Record;
use super::typing::Typing;

/// The two files of a terminal.
#[derive(Debug)]
pub(super) struct Paper {
    pub(super) record: Record,
    typing: Typing,
}

impl Paper {
    pub(super) fn open(log: &Path, log_bytes: u64) -> io::Result<Self> {
        Ok(Self {
            record: Record::open(log, log_bytes)?,
            typing: Typing::open(log)?,
        })
    }
}

impl Sink for Paper {
    fn take(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.record.take(bytes)
    }

    fn overwritten(&mut self, bytes: u32) -> io::Result<()> {
        self.record.overwritten(bytes)
    }

    fn typed(&mut self, into: &mut [u8]) -> io::Result<usize> {
        self.typing.read(into)
    }

    fn typing(&mut self, life: u32, taken: u32, waiting: usize) -> io::Result<()> {
        self.typing.begin(life, taken, waiting)
    }

    fn dropped(&mut self, taken: u32, count: usize) -> io::Result<()> {
        self.typing.drop_next(taken, count)
    }

    fn restarted(&mut self) {
        self.record.restarted();
    }

    fn attached(&mut self, life: u32, position: u32) {
        self.record.attached(life, position);
    }
}
