//! [`Journal`]: a file of records, each of which is on the disk before it counts.

use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use condor_platform::linux::{LOCK_PATIENCE, WholeFile, lock_file, read_regular};
use condor_remote::wire::{Id, RemoteState};
use serde::{Deserialize, Serialize};

/// The first line.
const HEAD: &str = "condor-gateway journal 1";
/// The number of records that may be added before the file is made anew.
const ADDED: usize = 4096;

/// A record of a [`Journal`]: a fact about one motion or one client that must survive the gateway.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "is", rename_all = "kebab-case", deny_unknown_fields)]
pub enum JournalRecord {
    /// The client has this incarnation, or had it.
    Joined {
        /// The name of the client.
        client: String,
        /// The number of the incarnation.
        incarnation: u64,
    },
    /// The motion is about to be offered to the queue, as this request of it.
    Offered {
        /// The name of the client.
        client: String,
        /// The identity of the motion.
        id: Id,
        /// A hash of its bytes.
        digest: u64,
        /// The session of the queue.
        session: u32,
        /// The number of the request in the session.
        number: u32,
    },
    /// Nothing changes any more about the motion.
    Ended {
        /// The name of the client.
        client: String,
        /// The identity of the motion.
        id: Id,
        /// A hash of its bytes; 0 if they never came.
        digest: u64,
        /// The final state of the motion.
        state: RemoteState,
        /// The reason for it.
        reason: String,
    },
    /// Motions up to this one that have no record are forgotten.
    Forgotten {
        /// The name of the client.
        client: String,
        /// The identity of the last one.
        id: Id,
    },
}

/// The reason why a [`Journal`] cannot be opened or written.
#[derive(Debug, thiserror::Error)]
pub enum JournalError {
    /// The operating system refuses.
    #[error("cannot use the journal {path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The reason.
        source: io::Error,
    },
    /// Another gateway uses it.
    #[error("the journal {path} is in use by another gateway")]
    Locked {
        /// The file.
        path: PathBuf,
    },
    /// The file is not a journal, or is damaged.
    #[error("{path}, line {line}: `{text}` is not a record of a version 1 journal")]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The number of the line, from 1.
        line: usize,
        /// The line.
        text: String,
    },
}

/// A file of records about motions, which survives a gateway that is killed. Only one process at a time can have it
/// open.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    /// Its lock; a file beside it, since the journal itself is replaced.
    _lock: File,
    /// `None` after an error: the file is made anew before the next record.
    file: Option<File>,
    added: usize,
}

impl Journal {
    /// Opens the journal in the file `path`, and returns it with its records, oldest first. There are none if the file
    /// does not exist. If the last record was not written to its end, it is dropped: the gateway has not acted on it.
    ///
    /// # Errors
    /// [`JournalError::Locked`] if another gateway uses the journal; [`JournalError::Damaged`] if a line is
    /// not a record; [`JournalError::Io`] if the operating system refuses.
    pub fn open(path: &Path) -> Result<(Self, Vec<JournalRecord>), JournalError> {
        let at = |source| JournalError::Io {
            path: path.into(),
            source,
        };
        let lock = path.with_extension("lock");
        let lock = File::options()
            .create(true)
            .append(true)
            .open(lock)
            .map_err(at)?;
        let locked = lock_file(&lock, LOCK_PATIENCE);
        if !locked.map_err(|error| at(error.into()))? {
            return Err(JournalError::Locked { path: path.into() });
        }
        let bytes = match read_regular(path) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == io::ErrorKind::NotFound => Vec::new(),
            Err(error) => return Err(at(error)),
        };
        let journal = Self {
            path: path.into(),
            _lock: lock,
            file: None,
            added: 0,
        };
        Ok((journal, records(path, &bytes)?))
    }

    /// Adds `record`, and waits until it is on the disk. Sometimes the whole file is written anew instead. `all` then
    /// returns all records that are still needed, `record` among them.
    ///
    /// # Errors
    /// Returns [`JournalError::Io`] if the operating system refuses. It is then unknown whether the file has the
    /// record, until another record was added without an error.
    pub fn add(
        &mut self,
        record: &JournalRecord,
        all: impl FnOnce() -> Vec<JournalRecord>,
    ) -> Result<(), JournalError> {
        let added = match self.file.take() {
            Some(mut file) if self.added < ADDED => {
                let written = file
                    .write_all(&line(record))
                    .and_then(|()| file.sync_data());
                written.map(|()| file)
            }
            _ => {
                self.added = 0;
                self.write_all(&all())
            }
        };
        let file = added.map_err(|source| JournalError::Io {
            path: self.path.clone(),
            source,
        })?;
        self.added += 1;
        self.file = Some(file);
        Ok(())
    }

    fn write_all(&self, records: &[JournalRecord]) -> io::Result<File> {
        let mut text = format!("{HEAD}\n").into_bytes();
        text.extend(records.iter().flat_map(line));
        WholeFile::write(&self.path, text)?;
        File::options().append(true).open(&self.path)
    }
}

fn line(record: &JournalRecord) -> Vec<u8> {
    let mut line = serde_json::to_vec(record).unwrap_or_default();
    line.push(b'\n');
    line
}

/// Reads the records of a file.
fn records(path: &Path, bytes: &[u8]) -> Result<Vec<JournalRecord>, JournalError> {
    let whole = bytes
        .iter()
        .rposition(|byte| *byte == b'\n')
        .map_or(0, |end| end + 1);
    let mut records = Vec::new();
    let lines = bytes[..whole].split_inclusive(|byte| *byte == b'\n');
    for (number, line) in (1..).zip(lines) {
        let text = line.trim_ascii_end();
        if number == 1 && text == HEAD.as_bytes() {
            continue;
        }
        let record = serde_json::from_slice(text).ok().filter(|_| number > 1);
        records.push(record.ok_or_else(|| JournalError::Damaged {
            path: path.into(),
            line: number,
            text: String::from_utf8_lossy(text).chars().take(120).collect(),
        })?);
    }
    Ok(records)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn record(number: u64) -> JournalRecord {
        let id = Id {
            incarnation: 1,
            number,
        };
        JournalRecord::Offered {
            client: "lab".into(),
            id,
            digest: 5,
            session: 3,
            number: 9,
        }
    }

    #[test]
    fn records_outlive_the_process_and_a_torn_one_is_dropped() {
        let place = tempfile::tempdir().expect("a directory");
        let path = place.path().join("journal");
        let (mut journal, before) = Journal::open(&path).expect("room");
        assert_eq!(before, []);
        let mut all = Vec::new();
        for number in 0..2 * ADDED as u64 {
            all.push(record(number));
            journal.add(&record(number), || all.clone()).expect("room");
        }
        assert!(matches!(
            Journal::open(&path),
            Err(JournalError::Locked { .. })
        ));
        drop(journal);
        let mut file = File::options().append(true).open(&path).expect("a file");
        file.write_all(br#"{"is":"offered","cli"#).expect("room");
        let (_journal, found) = Journal::open(&path).expect("a journal");
        assert_eq!(found, all);
    }

    #[test]
    fn what_is_damaged_is_refused_with_its_line() {
        let place = tempfile::tempdir().expect("a directory");
        let path = place.path().join("journal");
        for (text, line) in [
            ("condor-gateway journal 2\n", 1),
            ("condor-gateway journal 1\n{}\n", 2),
        ] {
            fs::write(&path, text).expect("room");
            match Journal::open(&path) {
                Err(JournalError::Damaged { line: found, .. }) => assert_eq!(found, line),
                other => panic!("{other:?}"),
            }
        }
    }
}
