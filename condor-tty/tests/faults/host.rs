//! The host: shows a terminal in a journal, until it is killed.

use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind, Write};
use std::path::Path;
use std::time::Duration;

use condor_mbox::linux::LinuxSystem;
use condor_mbox::{Messenger, Region};
use condor_tty::linux::{HostError, Piece, Sink, TerminalHost};
use condor_tty::{TerminalReaderError, TerminalVectors};

use super::{AnyError, HAND, HOST, N};

const LOOK: Duration = Duration::from_millis(10);

/// Records in the order in which they were shown: how many bytes were overwritten before, how many
/// follow, both as little-endian words, and these.
struct Journal {
    file: File,
    record: Vec<u8>,
}

impl Sink for Journal {
    fn take(&mut self, piece: Piece<'_>) -> io::Result<usize> {
        self.record.clear();
        self.record.extend(piece.overwritten.to_le_bytes());
        self.record.extend((piece.bytes.len() as u32).to_le_bytes());
        self.record.extend(piece.bytes);
        let end = self.file.metadata()?.len();
        if let Err(error) = self.file.write_all(&self.record) {
            // What is not taken is offered again.
            self.file.set_len(end)?;
            return Err(error);
        }
        Ok(piece.bytes.len())
    }
}

pub(crate) fn play(journal: &Path) -> Result<(), AnyError> {
    let claim = LinuxSystem::<N>::inherited()?.claim(HOST)?;
    let ram = Region::users(claim.windows()[HAND.index()].data.clone())?;
    let mut mailbox = claim.mailbox()?;
    mailbox.set_vector(TerminalVectors::DEFAULT.output, &|_| 0, "terminal output")?;
    mailbox.join()?;
    let mut journal = Journal {
        file: OpenOptions::new().append(true).open(journal)?,
        record: Vec::new(),
    };
    let mut tty = loop {
        match TerminalHost::attach(ram.clone(), 0, HAND, HOST) {
            Err(TerminalReaderError::NotReady { .. }) => mailbox.serve(LOOK)?,
            attached => break attached?,
        };
    };
    loop {
        match tty.serve(&mailbox, &mut journal) {
            Ok(served) if served.more => {}
            Err(HostError::Sink(error)) if error.kind() != ErrorKind::StorageFull => {
                return Err(error.into());
            }
            Ok(_) | Err(HostError::Sink(_)) => drop(mailbox.serve(LOOK)?),
            Err(error) => return Err(error.into()),
        }
    }
}
