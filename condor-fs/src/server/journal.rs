//! [`Journal`]: which operation is in progress, for the next server.

use std::io;

use condor_mbox::linux::{Access, LinuxWindow};
use condor_mbox::{LoadOrder, MemoryWindow, Processor, StoreOrder};
use rustix::fs::{Mode, OFlags};

use super::tree::Tree;
use crate::wire::{halves, whole};

const BYTES: u32 = 32;

/// A mapped file, which outlives the process that wrote it.
pub(super) struct Journal {
    window: LinuxWindow,
}

/// An operation in progress.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Record {
    pub(super) processor: Processor,
    pub(super) session: u64,
    pub(super) sequence: u64,
    pub(super) slot: u32,
    pub(super) table: u32,
}

impl Journal {
    pub(super) fn open(tree: &Tree) -> io::Result<Self> {
        let flags = OFlags::RDWR | OFlags::CREATE | OFlags::CLOEXEC | OFlags::NOFOLLOW;
        let mode = Mode::RUSR | Mode::WUSR;
        let file = rustix::fs::openat(tree.stage(), "journal", flags, mode)?;
        rustix::fs::ftruncate(&file, u64::from(BYTES))?;
        let window =
            LinuxWindow::map(&file, 0, BYTES, Access::ReadWrite).map_err(io::Error::other)?;
        Ok(Self { window })
    }

    /// A journal that cannot be written, because its file was truncated, is missed by a next life
    /// only.
    pub(super) fn begin(&self, record: &Record) {
        let ([session, session_high], number) =
            (halves(record.session), u32::from(record.processor.0));
        let [sequence, sequence_high] = halves(record.sequence);
        let words = [
            number,
            session,
            session_high,
            sequence,
            sequence_high,
            record.slot,
            record.table,
        ];
        for (word, at) in words.into_iter().zip((4..).step_by(4)) {
            let _ = self.window.store(at, word, StoreOrder::Release);
        }
        let _ = self.window.store(0, 1, StoreOrder::Release);
    }

    pub(super) fn end(&self) {
        let _ = self.window.store(0, 0, StoreOrder::Release);
    }

    pub(super) fn read(&self) -> Option<Record> {
        let word = |n: u32| self.window.load(4 * n, LoadOrder::Acquire).ok();
        if word(0)? != 1 {
            return None;
        }
        Some(Record {
            processor: Processor(word(1)?.try_into().ok()?),
            session: whole(word(2)?, word(3)?),
            sequence: whole(word(4)?, word(5)?),
            slot: word(6)?,
            table: word(7)?,
        })
    }
}
