//! What contestants leave in the file system, and its removal.

use std::path::{Path, PathBuf};
use std::{env, fs, io, process};

/// Where the system keeps named shared memory.
const SHARED_MEMORY: &str = "/dev/shm";

/// What the names begin with, before the process id.
const NAME: &str = "condor-bench-";

/// A directory and a prefix of this process; everything under either is removed when dropped.
pub(super) struct Files {
    directory: PathBuf,
    prefix: String,
}

impl Files {
    /// Creates the directory, and removes what killed runs have left.
    pub(super) fn new() -> io::Result<Self> {
        remove(|pid| !Path::new("/proc").join(pid).exists());
        let id = process::id();
        let directory = env::temp_dir().join(format!("{NAME}{id}"));
        fs::create_dir_all(&directory)?;
        Ok(Self {
            directory,
            prefix: format!("{NAME}{id}-"),
        })
    }

    /// For files.
    pub(super) fn directory(&self) -> &Path {
        &self.directory
    }

    /// For the names of files elsewhere.
    pub(super) fn prefix(&self) -> &str {
        &self.prefix
    }
}

impl Drop for Files {
    fn drop(&mut self) {
        let own = process::id().to_string();
        remove(|pid| pid == own);
    }
}

/// Removes the files of those processes that `gone` picks by their id.
fn remove(gone: impl Fn(&str) -> bool) {
    for place in [env::temp_dir(), PathBuf::from(SHARED_MEMORY)] {
        for entry in fs::read_dir(place).into_iter().flatten().flatten() {
            let name = entry.file_name();
            let rest = name
                .to_str()
                .and_then(|name| name.strip_prefix(NAME))
                .unwrap_or_default();
            let pid = rest.split_once('-').map_or(rest, |(pid, _)| pid);
            if !pid.is_empty() && pid.bytes().all(|byte| byte.is_ascii_digit()) && gone(pid) {
                // What cannot be removed, or has gone already, is no reason to lose the figures.
                let _ = fs::remove_file(entry.path());
                let _ = fs::remove_dir_all(entry.path());
            }
        }
    }
}
