//! [`MessageCounts`]: how many messages of each channel a recorder has taken, in a file beside the recording.

use std::collections::BTreeMap;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use condor_host::error::NamedFileError;

use super::beside;

const MAGIC: &[u8] = b"CTKN";
/// The magic and the version.
const HEAD: [u8; 8] = *b"CTKN\x02\0\0\0";
/// The bytes before the counts.
const HEAD_BYTES: usize = 16;

/// The file: a head, the number of the recording, and then a count of 64 bits for each channel, from 0.
///
/// The number tells to which recording the file belongs, since recordings can be moved.
#[derive(Debug)]
pub(super) struct MessageCounts {
    file: File,
    path: PathBuf,
    counts: Vec<u64>,
}

fn path_of(recording: &Path) -> PathBuf {
    beside(recording, ".taken")
}

impl MessageCounts {
    /// Begins to count for the recording of this number.
    pub(super) fn begin(recording: &Path, number: u64) -> Result<Self, NamedFileError> {
        let path = path_of(recording);
        // A recorder whose recording was moved may still write to it: it is not overwritten.
        if std::fs::read(&path).is_ok_and(|bytes| is_ours(&bytes)) {
            remove(&path)?;
        }
        let file = File::create_new(&path).map_err(NamedFileError::at("make", &path))?;
        let written = file.write_all_at(&head(number), 0);
        written.map_err(NamedFileError::at("write", &path))?;
        Ok(Self {
            file,
            path,
            counts: Vec::new(),
        })
    }

    /// Counts a message of a channel; [`note`](Self::note) writes it down.
    pub(super) fn count(&mut self, channel: u16) {
        let place = usize::from(channel);
        if self.counts.len() <= place {
            self.counts.resize(place + 1, 0);
        }
        if let Some(count) = self.counts.get_mut(place) {
            *count += 1;
        }
    }

    /// Writes all counts. They are noted even if this process is killed at once.
    pub(super) fn note(&self) -> Result<(), NamedFileError> {
        // A write that is interrupted ends between counts: each lies in one page.
        let bytes: Vec<u8> = self.counts.iter().flat_map(|it| it.to_le_bytes()).collect();
        let written = self.file.write_all_at(&bytes, HEAD_BYTES as u64);
        written.map_err(NamedFileError::at("write", &self.path))
    }

    /// Returns the counts.
    pub(super) fn counts(&self) -> BTreeMap<u16, u64> {
        numbered(self.counts.iter().copied())
    }

    /// Reads the counts of the recording of this number; `None` if there are none that can be understood.
    pub(super) fn read(recording: &Path, number: u64) -> Option<BTreeMap<u16, u64>> {
        let bytes = std::fs::read(path_of(recording)).ok()?;
        let (counts, _) = bytes.strip_prefix(&head(number))?.as_chunks();
        Some(numbered(counts.iter().copied().map(u64::from_le_bytes)))
    }

    /// Moves the counts of a recording, if there are some, to its new name.
    pub(super) fn keep(recording: &Path, kept: &Path) -> Result<(), NamedFileError> {
        let path = path_of(recording);
        if std::fs::read(&path).is_ok_and(|bytes| bytes.starts_with(MAGIC)) {
            std::fs::rename(&path, path_of(kept)).map_err(NamedFileError::at("rename", &path))?;
        }
        Ok(())
    }

    /// Removes the counts of the recording of this number, which is complete.
    pub(super) fn end(recording: &Path, number: Option<u64>) -> Result<(), NamedFileError> {
        match number.and_then(|number| Self::read(recording, number)) {
            Some(_) => remove(&path_of(recording)),
            None => Ok(()),
        }
    }
}

/// Returns true if a file can be one with counts. After a power loss, what was not on the disk yet is missing or 0.
fn is_ours(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC) || bytes.iter().all(|byte| *byte == 0)
}

fn head(number: u64) -> [u8; HEAD_BYTES] {
    let mut head = [0; HEAD_BYTES];
    let bytes = HEAD.into_iter().chain(number.to_le_bytes());
    head.iter_mut().zip(bytes).for_each(|(to, byte)| *to = byte);
    head
}

fn remove(path: &Path) -> Result<(), NamedFileError> {
    match std::fs::remove_file(path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(NamedFileError::at("remove", path)(error))
        }
        _ => Ok(()),
    }
}

fn numbered(counts: impl Iterator<Item = u64>) -> BTreeMap<u16, u64> {
    (0..).zip(counts).collect()
}
