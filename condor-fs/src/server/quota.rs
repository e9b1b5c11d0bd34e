//! [`Quota`]: how much the files of a tree may grow.

use std::os::fd::OwnedFd;
use std::sync::atomic::{AtomicU64, Ordering};

use rustix::fs::{AtFlags, Dir, FileType, Mode, OFlags};
use rustix::io::Errno as Linux;

use super::error::Stop;
use super::tree::{Tree, about};
use super::{Server, Steps};
use crate::errno::Errno;

/// The sizes of all files together, or more: what was removed is noticed when there seems to be no
/// room.
#[derive(Default)]
pub(super) struct Quota {
    used: AtomicU64,
}

impl<S: Steps> Server<S> {
    /// Whether `file` may become `size` bytes long; counts what is added.
    pub(super) fn admit(&self, file: &OwnedFd, size: u64) -> Result<(), Stop> {
        if self.options.max_file_bytes.is_none() && self.options.quota_bytes.is_none() {
            return Ok(());
        }
        let present = about(file, c"")?.1.size;
        if size <= present {
            return Ok(());
        }
        if self.options.max_file_bytes.is_some_and(|most| size > most) {
            return Err(Errno::FBIG.into());
        }
        let Some(most) = self.options.quota_bytes else {
            return Ok(());
        };
        // One thread serves; the counter is atomic because a server can be shared.
        let used = self.quota.used.load(Ordering::Relaxed);
        let mut after = used.saturating_add(size - present);
        if used == 0 || after > most {
            after = measure(&self.tree)?.saturating_add(size - present);
            if after > most {
                return Err(Errno::DQUOT.into());
            }
        }
        self.quota.used.store(after, Ordering::Relaxed);
        Ok(())
    }
}

/// The sizes of all regular files in the tree.
fn measure(tree: &Tree) -> Result<u64, Linux> {
    let open = |at: &OwnedFd, name: &std::ffi::CStr| {
        let flags = OFlags::DIRECTORY | OFlags::CLOEXEC | OFlags::NOFOLLOW;
        rustix::fs::openat(at, name, flags, Mode::empty())
    };
    let mut total = 0_u64;
    let flags = OFlags::DIRECTORY | OFlags::CLOEXEC;
    let mut left = vec![rustix::fs::openat(tree.root(), c".", flags, Mode::empty())?];
    while let Some(directory) = left.pop() {
        for entry in Dir::read_from(&directory)? {
            let entry = entry?;
            let name = entry.file_name();
            if matches!(name.to_bytes(), b"." | b"..") {
                continue;
            }
            // What goes away meanwhile does not count.
            let Ok(stat) = rustix::fs::statat(&directory, name, AtFlags::SYMLINK_NOFOLLOW) else {
                continue;
            };
            match FileType::from_raw_mode(stat.st_mode) {
                FileType::RegularFile => {
                    total = total.saturating_add(u64::try_from(stat.st_size).unwrap_or(0));
                }
                FileType::Directory => left.extend(open(&directory, name)),
                _ => {}
            }
        }
    }
    Ok(total)
}
