//! The files that contestants leave in the filesystem, and their removal.

use std::path::Path;
use std::{fs, io, process};

use tempfile::TempDir;

/// The directory of the system's named shared memory.
const SHARED_MEMORY: &str = "/dev/shm";

/// A directory and a prefix of this process; everything under either is removed when dropped.
pub(super) struct Files {
    directory: TempDir,
    prefix: String,
}

impl Files {
    /// Creates the directory.
    pub(super) fn new() -> io::Result<Self> {
        Ok(Self {
            directory: tempfile::Builder::new().prefix("condor-bench-").tempdir()?,
            prefix: format!("condor-bench-{}-", process::id()),
        })
    }

    /// Returns the directory for files.
    pub(super) fn directory(&self) -> &Path {
        self.directory.path()
    }

    /// Returns the prefix for the names of files elsewhere.
    pub(super) fn prefix(&self) -> &str {
        &self.prefix
    }
}

impl Drop for Files {
    fn drop(&mut self) {
        for entry in fs::read_dir(SHARED_MEMORY).into_iter().flatten().flatten() {
            let name = entry.file_name();
            if name.as_encoded_bytes().starts_with(self.prefix.as_bytes()) {
                // If the file is already gone, the figures still count.
                let _ = fs::remove_file(entry.path());
            }
        }
    }
}
