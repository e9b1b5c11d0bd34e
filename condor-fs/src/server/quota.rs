//! [`Quota`]: how much a tree may grow.

use std::collections::HashSet;
use std::ffi::{CStr, CString, OsStr};
use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::ffi::OsStrExt;
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use rustix::fs::{AtFlags, Dir, FileType, Mode, OFlags, Stat};
use rustix::io::Errno as Linux;

use super::error::Stop;
use super::tree::{OWN, Tree, about};
use super::{FileServer, Steps};
use crate::errno::Errno;
use crate::wire::FileStatus;

/// The bytes that a name of a file, a directory or anything else counts: room in a directory, and an inode.
const NAME: u64 = 1024;
/// The time for which a count that found no room is believed at least.
const REST: Duration = Duration::from_secs(1);
/// And how many times as long as it took.
const SHARE: u32 = 10;
/// The number of times that a count is begun anew because programs of the host move directories.
const TRIES: usize = 8;

/// The bytes that a tree has, and their limit.
pub(super) struct Quota {
    most: Option<u64>,
    state: Mutex<QuotaState>,
}

struct QuotaState {
    used: u64,
    /// Until then the tree is not counted again.
    next: Instant,
}

impl Quota {
    /// Counts the tree, if there is a limit.
    pub(super) fn of(tree: &Tree, most: Option<u64>) -> io::Result<Self> {
        let begun = Instant::now();
        let used = match most {
            Some(_) => count(tree).map_err(|it| io::Error::new(it.errno.kind(), it))?,
            None => 0,
        };
        Ok(Self {
            most,
            state: Mutex::new(QuotaState {
                used,
                next: rested(begun, Instant::now()),
            }),
        })
    }

    /// A panic elsewhere leaves numbers that are whole.
    fn lock(&self) -> MutexGuard<'_, QuotaState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes room for `more` bytes. Programs of the host may have made some, so that without room
    /// all is counted again, though not so often that this takes the time of others.
    fn take(
        &self,
        more: u64,
        now: impl Fn() -> Instant,
        count: impl FnOnce() -> Result<u64, Linux>,
    ) -> Result<(), Stop> {
        let Some(most) = self.most else {
            return Ok(());
        };
        let mut state = self.lock();
        if state.used.saturating_add(more) > most {
            let begun = now();
            if begun < state.next {
                return Err(Errno::DQUOT.into());
            }
            let counted = count();
            state.next = rested(begun, now());
            state.used = counted?;
        }
        let used = state.used.saturating_add(more);
        if used > most {
            return Err(Errno::DQUOT.into());
        }
        state.used = used;
        Ok(())
    }

    /// Returns the number of bytes that are left; `None` if there is no limit.
    pub(super) fn left(&self) -> Option<u64> {
        Some(self.most?.saturating_sub(self.lock().used))
    }

    /// A file has become shorter by so many bytes.
    pub(super) fn release(&self, bytes: u64) {
        let mut state = self.lock();
        state.used = state.used.saturating_sub(bytes);
    }

    /// A name is gone of what had this status; if it was the last one, so is the rest.
    pub(super) fn release_name(&self, status: &FileStatus) {
        let last = status.is_file() && status.links <= 1;
        self.release(NAME + if last { status.size } else { 0 });
    }
}

fn rested(begun: Instant, ended: Instant) -> Instant {
    ended + REST.max(SHARE * ended.duration_since(begun))
}

impl<S: Steps> FileServer<S> {
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
        self.admit_bytes(size - present)
    }

    /// Whether one more name may be made; counts it.
    pub(super) fn admit_name(&self) -> Result<(), Stop> {
        self.admit_bytes(NAME)
    }

    /// Whether a name may be made, if it does not exist.
    pub(super) fn admit_new(&self, path: &[u8]) -> Result<(), Stop> {
        let is_new = |path| self.tree.place(path)?.about().map_err(Errno::from);
        if self.options.quota_bytes.is_some() && is_new(path) == Err(Errno::NOENT) {
            self.admit_name()?;
        }
        Ok(())
    }

    fn admit_bytes(&self, more: u64) -> Result<(), Stop> {
        let count = || count(&self.tree).map_err(|it| it.errno);
        self.quota.take(more, Instant::now, count)
    }

    /// Removes what has a unique name.
    pub(super) fn discard(&self, unique: &CStr) -> Result<(), Linux> {
        let found = self.tree.aside(unique)?;
        self.tree.discard(unique)?;
        if let Some((_, status)) = found {
            self.quota.release_name(&status);
        }
        Ok(())
    }
}

/// A directory on the way down to the one that is being counted.
struct Level {
    name: CString,
    is: (u64, u64),
    /// Directories in it that are left.
    left: Vec<CString>,
}

/// Counts the bytes of a tree: those of every name, and every file's size once.
fn count(tree: &Tree) -> Result<u64, Counting> {
    for _ in 0..TRIES {
        let mut walk = Walk {
            total: 0,
            linked: HashSet::new(),
            way: Vec::new(),
        };
        match walk.all(tree) {
            Ok(true) => return Ok(walk.total),
            Ok(false) => {}
            Err(errno) => {
                let way: PathBuf = (walk.way.iter())
                    .map(|level| OsStr::from_bytes(level.name.to_bytes()))
                    .collect();
                return Err(Counting { way, errno });
            }
        }
    }
    Err(Counting {
        way: ".".into(),
        errno: Linux::BUSY,
    })
}

struct Walk {
    total: u64,
    /// Files with several names that have been seen.
    linked: HashSet<(u64, u64)>,
    way: Vec<Level>,
}

impl Walk {
    /// Goes through all directories with no more than three descriptors, however many there are;
    /// `false` if one was moved meanwhile.
    fn all(&mut self, tree: &Tree) -> Result<bool, Linux> {
        let mut at = open_directory(tree.root(), c".")?;
        self.enter(&at, c".".into())?;
        while let Some(level) = self.way.last_mut() {
            if let Some(name) = level.left.pop() {
                match open_directory(&at, &name) {
                    Ok(below) => {
                        at = below;
                        self.enter(&at, name)?;
                    }
                    // The directory went away meanwhile.
                    Err(Linux::NOENT | Linux::NOTDIR | Linux::LOOP) => {}
                    Err(errno) => {
                        self.way.push(Level::of(name));
                        return Err(errno);
                    }
                }
                continue;
            }
            self.way.pop();
            if let Some(above) = self.way.last() {
                at = open_directory(&at, c"..")?;
                if identity(&rustix::fs::fstat(&at)?) != above.is {
                    return Ok(false);
                }
            }
        }
        Ok(true)
    }

    /// Counts what is in a directory, and notes the directories in it.
    fn enter(&mut self, at: &OwnedFd, name: CString) -> Result<(), Linux> {
        let is = rustix::fs::fstat(at)?;
        // The server's own files are there whatever clients do, but for those that it keeps for them.
        let own = self.way.len() == 1 && name.to_bytes() == OWN;
        self.way.push(Level {
            is: identity(&is),
            ..Level::of(name)
        });
        let mut left = Vec::new();
        for entry in Dir::read_from(at)? {
            let entry = entry?;
            let name = entry.file_name();
            if matches!(name.to_bytes(), b"." | b"..")
                || own && matches!(name.to_bytes(), b"lock" | b"journal")
            {
                continue;
            }
            let stat = match rustix::fs::statat(at, name, AtFlags::SYMLINK_NOFOLLOW) {
                Ok(stat) => stat,
                Err(Linux::NOENT) => continue, // The file went away meanwhile.
                Err(errno) => return Err(errno),
            };
            let kind = FileType::from_raw_mode(stat.st_mode);
            if stat.st_dev != is.st_dev {
                continue; // Another filesystem.
            }
            let top_own = self.way.len() == 1 && name.to_bytes() == OWN;
            if !top_own {
                self.total = self.total.saturating_add(NAME);
            }
            if kind == FileType::Directory {
                left.push(name.to_owned());
            } else if kind == FileType::RegularFile
                && (stat.st_nlink <= 1 || self.linked.insert(identity(&stat)))
            {
                let size = u64::try_from(stat.st_size).unwrap_or(0);
                self.total = self.total.saturating_add(size);
            }
        }
        if let Some(level) = self.way.last_mut() {
            level.left = left;
        }
        Ok(())
    }
}

impl Level {
    fn of(name: CString) -> Self {
        Self {
            name,
            is: (0, 0),
            left: Vec::new(),
        }
    }
}

fn identity(stat: &Stat) -> (u64, u64) {
    (stat.st_dev, stat.st_ino)
}

fn open_directory(at: impl std::os::fd::AsFd, name: &CStr) -> Result<OwnedFd, Linux> {
    let flags = OFlags::DIRECTORY | OFlags::CLOEXEC | OFlags::NOFOLLOW;
    rustix::fs::openat(at, name, flags, Mode::empty())
}

/// Which directory cannot be counted.
#[derive(Debug, thiserror::Error)]
#[error("cannot count {} for the quota: {errno}", way.display())]
struct Counting {
    way: PathBuf,
    errno: Linux,
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    #[test]
    fn at_the_limit_the_tree_is_counted_now_and_then_only() {
        let begun = Instant::now();
        let quota = Quota {
            most: Some(1000),
            state: Mutex::new(QuotaState {
                used: 900,
                next: begun,
            }),
        };
        let (time, counts) = (Cell::new(begun), Cell::new(0));
        let took = Duration::from_millis(300);
        let take = |more, counted: Result<u64, Linux>| {
            let count = || {
                counts.set(counts.get() + 1);
                time.set(time.get() + took);
                counted
            };
            quota.take(more, || time.get(), count)
        };
        assert_eq!(take(100, Ok(0)), Ok(()));
        assert_eq!(counts.get(), 0, "there was room");
        for _ in 0..100 {
            assert_eq!(take(1, Ok(1000)), Err(Errno::DQUOT.into()));
        }
        assert_eq!(counts.get(), 1);
        // What is removed by clients is room at once.
        quota.release(10);
        assert_eq!(take(10, Ok(1000)), Ok(()));
        assert_eq!(counts.get(), 1);
        // What the host has removed is noticed later.
        time.set(time.get() + (SHARE * took).saturating_sub(Duration::from_nanos(1)));
        assert_eq!(take(1, Ok(0)), Err(Errno::DQUOT.into()));
        time.set(time.get() + Duration::from_nanos(1));
        assert_eq!(take(1, Err(Linux::MFILE)), Err(Errno::MFILE.into()));
        assert_eq!(take(1, Ok(0)), Err(Errno::DQUOT.into()));
        assert_eq!(counts.get(), 2);
        time.set(time.get() + SHARE * took);
        assert_eq!(take(1000, Ok(0)), Ok(()));
    }
}
