//! What can go wrong with a [`System`](super::System).

use core::fmt;
use std::io;
use std::path::{Path, PathBuf};

use super::window::MapError;
use crate::id::Processor;

/// What a name in a file system stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FileKind {
    /// A regular file.
    File,
    /// A FIFO, or an unnamed pipe.
    Fifo,
    /// A directory.
    Directory,
    /// A symbolic link; none is followed at the end of a path.
    Symlink,
    /// Anything else.
    Other,
}

impl fmt::Display for FileKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::File => "a regular file",
            Self::Fifo => "a FIFO",
            Self::Directory => "a directory",
            Self::Symlink => "a symbolic link",
            Self::Other => "something else",
        })
    }
}

/// An error of a [`System`](super::System).
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SystemError {
    /// A name must not be empty, nor hold a slash or a zero byte, nor be longer than a file name.
    #[error("{name:?} cannot be the name of a system")]
    BadName {
        /// The name that was given.
        name: String,
    },
    /// The memory of a number is handed out once.
    #[error("the places of {number} have been handed out: lend them to whoever else needs memory")]
    PlacesTaken {
        /// Whose memory it is.
        number: Processor,
    },
    /// The size of `data` must be a multiple of four and fit 32 bits together with its first line.
    #[error("data of {user_bytes} bytes do not consist of whole words, or are too large")]
    BadDataSize {
        /// The size that was given.
        user_bytes: u32,
    },
    /// A file has another size than in a system of this many processors and this data size.
    #[error("{path:?} has {found} bytes, expected {expected}: it belongs to another system")]
    WrongSize {
        /// The file.
        path: PathBuf,
        /// Its size in bytes.
        found: u64,
        /// The size it should have, in bytes.
        expected: u64,
    },
    /// A name stands for something of the wrong kind.
    #[error("{path:?} is {found}, expected {expected}")]
    WrongKind {
        /// The name.
        path: PathBuf,
        /// What it stands for.
        found: FileKind,
        /// What it should stand for.
        expected: FileKind,
    },
    /// The directory of a named system belongs to another user, or the file `system` that names a
    /// memory to one who is neither this user, nor root, nor the directory's owner.
    #[error("{path:?} belongs to user {found}, expected {expected}")]
    WrongOwner {
        /// The directory, or the file.
        path: PathBuf,
        /// The user id of its owner.
        found: u32,
        /// The user id of this process.
        expected: u32,
    },
    /// The number is not below the number of processors of the system.
    #[error("{number} does not exist: the system has {processors} processors")]
    NoSuchProcessor {
        /// The number that was given.
        number: Processor,
        /// How many processors the system has.
        processors: usize,
    },
    /// Somebody holds the number.
    #[error("{number} is taken by process {process_id}")]
    NumberTaken {
        /// The number.
        number: Processor,
        /// What the holder says its process id is; 0 if it did not say yet.
        process_id: u32,
    },
    /// All numbers are held.
    #[error("all {processors} numbers are taken")]
    NoFreeNumber {
        /// How many processors the system has.
        processors: usize,
    },
    /// The description of a family is not one of this system.
    #[error("the description {description:?} of a system is refused: {reason}")]
    BadDescription {
        /// What was passed.
        description: String,
        /// What is wrong with it.
        reason: &'static str,
    },
    /// The file `system` of a directory describes another system than this one.
    #[error("{path:?} describes another system: {reason}")]
    OtherSystem {
        /// The file `system`.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The memory of a system cannot be laid out as is said.
    #[error("the memory {path:?} cannot be laid out so: {reason}")]
    BadLayout {
        /// The file that is the memory.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// The file that is the memory of a system ends too early.
    #[error(
        "{object} needs {bytes} bytes at offset {offset:#x} of {path:?}, which has {found:#x} bytes"
    )]
    OutsideMemory {
        /// The file that is the memory.
        path: PathBuf,
        /// What lies there, such as `3.mail`.
        object: String,
        /// Where, in bytes from the beginning of the file.
        offset: u64,
        /// How long it is, in bytes.
        bytes: u32,
        /// The size of the file, in bytes.
        found: u64,
    },
    /// The directory of the system was removed again and again while a number was being claimed.
    #[error("{path:?} was removed {times} times while a number was being claimed")]
    Unsteady {
        /// The directory.
        path: PathBuf,
        /// How often it was tried.
        times: u32,
    },
    /// The directory holds a file that is not part of the system.
    #[error("{path:?} is not part of the system: nothing was removed")]
    ForeignFile {
        /// The file.
        path: PathBuf,
    },
    /// A file could not be mapped.
    #[error("cannot map {path:?}: {source}")]
    Map {
        /// The file.
        path: PathBuf,
        /// Why not.
        source: MapError,
    },
    /// A call to the operating system failed.
    #[error("cannot {doing} {path:?}: {source}")]
    Os {
        /// What was tried.
        doing: &'static str,
        /// With which file.
        path: PathBuf,
        /// The answer.
        source: io::Error,
    },
}

impl SystemError {
    /// Makes an error of the answer to `doing` something with `path`.
    pub(super) fn os<E: Into<io::Error>>(
        doing: &'static str,
        path: impl AsRef<Path>,
    ) -> impl FnOnce(E) -> Self {
        move |source| Self::Os {
            doing,
            path: path.as_ref().into(),
            source: source.into(),
        }
    }
}
