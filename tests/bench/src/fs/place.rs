//! [`Place`]: a directory on a disk's filesystem.

use std::path::{Path, PathBuf};

use rustix::fs::FsWord;
use tempfile::TempDir;

use crate::Result;

/// `TMPFS_MAGIC` and `RAMFS_MAGIC` of Linux: filesystems without a page cache of their own.
const IN_MEMORY: [FsWord; 2] = [0x0102_1994, 0x8584_58f6];

/// A directory that is removed when this is dropped.
pub(super) struct Place {
    directory: TempDir,
    magic: FsWord,
}

impl Place {
    /// Makes a directory in the temporary directory, or in `/var/tmp` if that one is in memory.
    ///
    /// # Errors
    /// Returns an error if neither is on a disk, or if the directory cannot be made.
    pub(super) fn new() -> Result<Self> {
        for parent in [std::env::temp_dir(), PathBuf::from("/var/tmp")] {
            let magic = rustix::fs::statfs(&parent)?.f_type;
            if !IN_MEMORY.contains(&magic) {
                let directory = tempfile::Builder::new()
                    .prefix("condor-bench-")
                    .tempdir_in(parent)?;
                return Ok(Self { directory, magic });
            }
        }
        Err("no temporary directory is on a disk: set TMPDIR".into())
    }

    /// Returns the path of the directory.
    pub(super) fn directory(&self) -> &Path {
        self.directory.path()
    }

    /// Returns the name of the filesystem of the directory.
    pub(super) fn file_system(&self) -> String {
        match self.magic {
            0xef53 => "ext4".to_owned(),
            0x5846_5342 => "xfs".to_owned(),
            0x9123_683e => "btrfs".to_owned(),
            other => format!("filesystem {other:#x}"),
        }
    }
}
