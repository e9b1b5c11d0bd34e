//! The host: shows a terminal in a journal, until it is killed.

use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind, Write};
use std::path::Path;
use std::time::Duration;

use condor_mbox::linux::System;
use condor_mbox::{Messenger, Region};
use condor_tty::linux::{Host, HostError, Sink};
use condor_tty::{ReaderError, Vectors};

use super::{AnyError, HAND, HOST, N};

const LOOK: Duration = Duration::from_millis(10);

/// Records in the order in which they were shown: how many bytes were overwritten before, how many
/// follow, both as little-endian words, and these.
struct Journal {
    file: File,
    skipped: u32,
    record: Vec<u8>,
}

impl Sink for Journal {
    fn take(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if bytes.is_empty() && self.skipped == 0 {
            return Ok(0);
        }
        self.record.clear();
        self.record.extend(self.skipped.to_le_bytes());
        self.record.extend((bytes.len() as u32).to_le_bytes());
        self.record.extend(bytes);
        let end = self.file.metadata()?.len();
        if let Err(error) = self.file.write_all(&self.record) {
            // What is not taken is offered again.
            self.file.set_len(end)?;
            return Err(error);
        }
        self.skipped = 0;
        Ok(bytes.len())
    }

    fn overwritten(&mut self, bytes: u32) -> io::Result<()> {
        self.skipped += bytes;
        Ok(())
    }
}

pub(crate) fn play(journal: &Path) -> Result<(), AnyError> {
    let claim = System::<N>::inherited()?.claim(HOST)?;
    let ram = Region::users(claim.windows()[HAND.index()].data.clone())?;
    let mut mailbox = claim.mailbox()?;
    mailbox.set_vector(Vectors::DEFAULT.output, &|_| 0, "terminal output")?;
    mailbox.join()?;
    let mut tty = loop {
        let sink = Journal {
            file: OpenOptions::new().append(true).open(journal)?,
            skipped: 0,
            record: Vec::new(),
        };
        match Host::attach(ram.clone(), 0, HAND, HOST, sink) {
            Err(HostError::Reader(ReaderError::NotReady { .. })) => mailbox.serve(LOOK)?,
            attached => break attached?,
        };
    };
    loop {
        match tty.serve(&mailbox) {
            Ok(served) if served.more => {}
            Err(HostError::Sink(error)) if error.kind() != ErrorKind::StorageFull => {
                return Err(error.into());
            }
            Ok(_) | Err(HostError::Sink(_)) => drop(mailbox.serve(LOOK)?),
            Err(error) => return Err(error.into()),
        }
    }
}
