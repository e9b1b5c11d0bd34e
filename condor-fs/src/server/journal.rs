//! [`Journal`]: which operation is in progress, for the next server.

use std::ffi::OsStr;
use std::io;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use condor_mbox::linux::{LinuxWindow, WindowAccess};
use condor_mbox::{AccessError, LoadOrder, MemoryWindow, Processor, StoreOrder};
use rustix::fs::{FallocateFlags, Mode, OFlags};
use rustix::io::Errno as Linux;

use super::ServerError;
use super::limit::check_file_limit;
use super::tree::{OWN, Tree};
use crate::wire::{Words, words};

/// The first two words of the file. A file of zeros is a new one.
const MAGIC: u32 = u32::from_le_bytes(*b"CFSJ");
const VERSION: u32 = 1;
/// The offset of the record, in bytes; `BYTES` is the size of the journal.
const RECORD: u32 = 8;
const BYTES: u32 = RECORD + 4 + 4 * WORDS as u32;
/// Words of a record, behind the one that says whether there is one.
const WORDS: usize = 7;
const NAME: &str = "journal";

/// A mapped file, which outlives the process that wrote it.
///
/// It has room on the disk before the first operation: a store to a hole of a full disk would go nowhere.
/// Where a store fails all the same (the file was truncated, the disk copies what is written), the
/// operation is not begun.
pub(super) struct Journal {
    window: Mutex<LinuxWindow>,
    /// Whether there may be a record: one of a former server, too.
    begun: AtomicBool,
    /// For errors.
    path: PathBuf,
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

words!(Record: processor, session, sequence, slot, table);

impl Words for Processor {
    fn put(&self, put: &mut impl FnMut(u32)) {
        put(self.0.into());
    }

    /// A number that is none becomes one that nobody has.
    fn take(next: &mut impl FnMut() -> u32) -> Self {
        Self(u8::try_from(next()).unwrap_or(u8::MAX))
    }
}

impl Journal {
    /// That of the tree at `root`, with what was in progress when its last server ended.
    pub(super) fn open(tree: &Tree, root: &Path) -> Result<Self, ServerError> {
        let path = root.join(OsStr::from_bytes(OWN)).join(NAME);
        match map(tree) {
            Ok(window) => Ok(Self {
                window: Mutex::new(window),
                begun: AtomicBool::new(true),
                path,
            }),
            Err(source) => Err(ServerError::Journal { path, source }),
        }
    }

    /// Records what is begun: a next incarnation finishes it first.
    ///
    /// # Errors
    /// Nothing is recorded, and nothing may be begun.
    pub(super) fn begin(&self, tree: &Tree, record: &Record) -> io::Result<()> {
        let mut window = self.lock();
        // Relaxed, here and below: only one operation is in progress at a time.
        self.begun.store(true, Ordering::Relaxed);
        if write(&window, record).is_ok() {
            return Ok(());
        }
        // The mapping is lost; the file need not be.
        *window = map(tree)?;
        write(&window, record).map_err(io::Error::other)
    }

    /// Records that the operation has ended. A record that stays because this fails does no harm: the slot
    /// says that the operation is done, or the client has gone on to another one.
    pub(super) fn end(&self) {
        if self.begun.load(Ordering::Relaxed) {
            let ended = self.lock().store(RECORD, 0, StoreOrder::Release);
            self.begun.store(ended.is_err(), Ordering::Relaxed);
        }
    }

    /// Returns the record of the operation in progress, if there is one.
    ///
    /// # Errors
    /// [`ServerError::Journal`] if the disk does not say.
    pub(super) fn read(&self) -> Result<Option<Record>, ServerError> {
        self.begun.store(true, Ordering::Relaxed);
        read(&self.lock()).map_err(|error| ServerError::Journal {
            path: self.path.clone(),
            source: io::Error::other(error),
        })
    }

    /// A panic elsewhere does not make it wrong.
    fn lock(&self) -> MutexGuard<'_, LinuxWindow> {
        self.window.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The file, with room on the disk, and what was in it.
fn map(tree: &Tree) -> io::Result<LinuxWindow> {
    let flags = OFlags::RDWR | OFlags::CREATE | OFlags::CLOEXEC | OFlags::NOFOLLOW;
    let file = rustix::fs::openat(tree.stage(), NAME, flags, Mode::RUSR | Mode::WUSR)?;
    check_file_limit(BYTES.into())?;
    match rustix::fs::fallocate(&file, FallocateFlags::empty(), 0, BYTES.into()) {
        Err(Linux::OPNOTSUPP) => {
            // Bytes that are written and synchronised have their room on the disk, too.
            let mut bytes = [0; BYTES as usize];
            rustix::io::pread(&file, &mut bytes, 0)?;
            rustix::io::pwrite(&file, &bytes, 0)?;
            rustix::fs::fsync(&file)?;
        }
        outcome => outcome?,
    }
    let window =
        LinuxWindow::map(&file, 0, BYTES, WindowAccess::ReadWrite).map_err(io::Error::other)?;
    check(&window)?;
    Ok(window)
}

/// Refuses a file that is none of this version, and begins a new one.
fn check(window: &LinuxWindow) -> io::Result<()> {
    let load = |at| {
        window
            .load(at, LoadOrder::Relaxed)
            .map_err(io::Error::other)
    };
    let (magic, version) = (load(0)?, load(4)?);
    match (magic, version) {
        (MAGIC, VERSION) => Ok(()),
        (0, 0) => {
            // The magic comes last: with it there is a version.
            let words = [(4, VERSION), (0, MAGIC)].into_iter();
            let mut stored = words.map(|(at, word)| window.store(at, word, StoreOrder::Release));
            stored.try_for_each(|stored| stored.map_err(io::Error::other))
        }
        _ => Err(io::Error::other(format!(
            "its magic is {magic:#x} and its version {version}; this server reads {MAGIC:#x} and {VERSION}"
        ))),
    }
}

/// The first word is 0 while the others change: half a record is none.
fn write(window: &LinuxWindow, record: &Record) -> Result<(), AccessError> {
    window.store(RECORD, 0, StoreOrder::Release)?;
    let words: [_; WORDS] = record.to_array();
    for (word, at) in words.into_iter().zip((RECORD + 4..).step_by(4)) {
        window.store(at, word, StoreOrder::Release)?;
    }
    window.store(RECORD, 1, StoreOrder::Release)
}

fn read(window: &LinuxWindow) -> Result<Option<Record>, AccessError> {
    let begun = window.load(RECORD, LoadOrder::Acquire)?;
    let mut words = [0; WORDS];
    for (word, at) in words.iter_mut().zip((RECORD + 4..).step_by(4)) {
        *word = window.load(at, LoadOrder::Acquire)?;
    }
    Ok((begun == 1).then(|| Record::of(&words)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::whole;

    const BEGUN: Record = Record {
        processor: Processor(7),
        session: u64::MAX - 1,
        sequence: whole(3, 2),
        slot: 64,
        table: 256,
    };

    #[test]
    fn what_was_begun_is_known_to_the_next_one() {
        let root = tempfile::tempdir().unwrap();
        let tree = Tree::open(root.path()).unwrap();
        let journal = Journal::open(&tree, root.path()).unwrap();
        assert_eq!(journal.read().unwrap(), None);
        journal.begin(&tree, &BEGUN).unwrap();
        let next = Journal::open(&tree, root.path()).unwrap();
        assert_eq!(next.read().unwrap(), Some(BEGUN));
        next.end();
        assert_eq!(journal.read().unwrap(), None);
    }

    #[test]
    fn a_journal_of_another_version_is_refused() {
        let root = tempfile::tempdir().unwrap();
        let tree = Tree::open(root.path()).unwrap();
        Journal::open(&tree, root.path()).unwrap();
        let path = root.path().join(".condor-fs/journal");
        let mut content = std::fs::read(&path).unwrap();
        assert_eq!(content[..8], *b"CFSJ\x01\0\0\0");
        content[4] = 9;
        std::fs::write(&path, content).unwrap();
        let Err(ServerError::Journal { source, .. }) = Journal::open(&tree, root.path()) else {
            panic!("it was taken");
        };
        let expected = "version 9; this server reads 0x4a534643 and 1";
        assert!(source.to_string().ends_with(expected), "{source}");
    }

    #[test]
    fn a_store_that_fails_is_made_again_or_reported() {
        let root = tempfile::tempdir().unwrap();
        let tree = Tree::open(root.path()).unwrap();
        let journal = Journal::open(&tree, root.path()).unwrap();
        let path = root.path().join(".condor-fs/journal");
        let file = std::fs::File::options().write(true).open(&path).unwrap();
        file.set_len(0).unwrap();
        journal.begin(&tree, &BEGUN).unwrap();
        let next = Journal::open(&tree, root.path()).unwrap();
        assert_eq!(next.read().unwrap(), Some(BEGUN));

        file.set_len(0).unwrap();
        std::fs::remove_file(&path).unwrap();
        std::fs::create_dir(&path).unwrap();
        assert!(journal.read().is_err(), "what is gone is not nothing");
        let error = journal.begin(&tree, &BEGUN).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::IsADirectory);
        let error = Journal::open(&tree, root.path()).err().unwrap();
        assert!(error.to_string().contains("journal"), "{error}");
    }
}
