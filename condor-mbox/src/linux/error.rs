//! Errors of a [`LinuxSystem`](super::LinuxSystem), and the kinds of files.

use core::fmt;
use std::io;
use std::path::{Path, PathBuf};

use super::window::WindowMapError;
use crate::id::Processor;
use crate::layout::BELL_BYTES;

/// The kind of a file: the one that was found, or the one that is required.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FileKind {
    /// A regular file.
    File,
    /// A FIFO, or an unnamed pipe.
    Fifo,
    /// A directory, such as that of a system's files.
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

/// The error of a function of [`LinuxSystem`](super::LinuxSystem) or [`Claim`](super::Claim).
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SystemError {
    /// A name is empty, holds a slash or a zero byte, or is longer than a file name may be.
    #[error(
        "{name:?} cannot be the name of a system: a name is a file name, without slash or zero byte"
    )]
    BadName {
        /// The name that was given.
        name: String,
    },
    /// [`Claim::places`](super::Claim::places) has already returned the allocator of this number's
    /// memory.
    #[error("the allocator of the memory of {number} was already taken: share that one")]
    PlacesTaken {
        /// The number of the processor.
        number: Processor,
    },
    /// The size of the users' region of `data` is not a multiple of four, or does not fit in 32
    /// bits together with the doorbell's line before it.
    #[error(
        "the users' region of `data` cannot have {user_bytes} bytes: it must be a multiple of 4, and at most {most}",
        most = (u32::MAX - BELL_BYTES) / 4 * 4
    )]
    BadDataSize {
        /// The size that was given, in bytes.
        user_bytes: u32,
    },
    /// A file has another size than a system of this many processors and this data size needs.
    #[error("{path:?} has {found} bytes, expected {expected}: it belongs to another system")]
    WrongSize {
        /// The file.
        path: PathBuf,
        /// The size of the file, in bytes.
        found: u64,
        /// The size it should have, in bytes.
        expected: u64,
    },
    /// A path leads to a file of the wrong kind.
    #[error("{path:?} is {found}, expected {expected}")]
    WrongKind {
        /// The path of the file that was found.
        path: PathBuf,
        /// The kind that was found.
        found: FileKind,
        /// The kind that is required.
        expected: FileKind,
    },
    /// The directory of a named system belongs to another user; or the file `system`, which names a
    /// memory, belongs to neither this user, nor root, nor the owner of the directory.
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
    #[error("{number} does not exist: the system has {processors} processors, numbered from 0")]
    NoSuchProcessor {
        /// The number that was given.
        number: Processor,
        /// The number of processors in the system.
        processors: usize,
    },
    /// Another claim holds the number, and has held it for as long as the call waits.
    #[error("{number} is taken by process {process_id}: end that process, or use another number")]
    NumberTaken {
        /// The number of the processor.
        number: Processor,
        /// The process id that the holder has written; 0 if it has not written it yet.
        process_id: u32,
    },
    /// All numbers are held.
    #[error("all {processors} processor numbers are taken: end a program that holds one")]
    NoFreeNumber {
        /// The number of processors in the system.
        processors: usize,
    },
    /// The environment variable `CONDOR_SYSTEM`, by which a parent passes a system, does not
    /// describe one of this type.
    #[error(
        "the environment variable CONDOR_SYSTEM is {description:?}, which does not describe a system that this \
     program can join: {reason}"
    )]
    BadDescription {
        /// The description that was passed.
        description: String,
        /// The reason, in words.
        reason: &'static str,
    },
    /// The file `system` of a directory describes another system than this one.
    #[error("{path:?} describes another system: {reason}")]
    OtherSystem {
        /// The file `system`.
        path: PathBuf,
        /// The difference, in words.
        reason: String,
    },
    /// The memory of a system cannot have the requested layout.
    #[error("cannot lay out the memory {path:?}: {reason}")]
    BadLayout {
        /// The file that is the memory.
        path: PathBuf,
        /// The reason, in words.
        reason: String,
    },
    /// The file that is the memory of a system ends too early.
    #[error(
        "{object} needs {bytes} bytes at offset {offset:#x} of {path:?}, which has {found:#x} bytes"
    )]
    OutsideMemory {
        /// The file that is the memory.
        path: PathBuf,
        /// The object that lies there, such as `3.mail`.
        object: String,
        /// Its offset from the beginning of the file, in bytes.
        offset: u64,
        /// Its length, in bytes.
        bytes: u32,
        /// The size of the file, in bytes.
        found: u64,
    },
    /// The directory of the system was removed again and again while a number was being claimed.
    #[error(
        "{path:?} was removed {times} times by other programs while this one claimed the number of a processor; \
         try again"
    )]
    Unsteady {
        /// The directory.
        path: PathBuf,
        /// The number of attempts.
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
        /// The reason, in words.
        source: WindowMapError,
    },
    /// A call to the operating system failed.
    #[error("cannot {doing} {path:?}: {source}")]
    Os {
        /// The operation that failed, such as `open`.
        doing: &'static str,
        /// The path of the file.
        path: PathBuf,
        /// The error of the operating system.
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
