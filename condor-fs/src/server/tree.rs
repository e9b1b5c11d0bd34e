//! [`Tree`]: the directory tree, which no path leaves.

use std::ffi::{CStr, CString};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::Path;

use rustix::fs::{
    AtFlags, FileType, FlockOperation, Mode, OFlags, RenameFlags, ResolveFlags, StatxFlags,
};
use rustix::io::Errno as Linux;

use super::ServerError;
use crate::errno::Errno;
use crate::wire::{Evidence, Status};

/// The server's own directory at the top of the tree.
pub(super) const OWN: &[u8] = b".condor-fs";

/// How paths of clients are followed.
const CONFINED: ResolveFlags = ResolveFlags::BENEATH
    .union(ResolveFlags::NO_MAGICLINKS)
    .union(ResolveFlags::NO_XDEV);

/// The tree, locked.
pub(super) struct Tree {
    root: OwnedFd,
    stage: OwnedFd,
    stage_is: Evidence,
    _lock: OwnedFd,
}

/// A name in a directory.
pub(super) struct Place {
    pub(super) parent: OwnedFd,
    pub(super) name: CString,
    /// The path ended with a slash.
    pub(super) directory: bool,
}

impl Tree {
    pub(super) fn open(path: &Path) -> Result<Self, ServerError> {
        let at = |errno: Linux| ServerError::at(path)(errno);
        let directory = OFlags::DIRECTORY | OFlags::CLOEXEC;
        let root = rustix::fs::open(path, directory, Mode::empty()).map_err(at)?;
        match rustix::fs::mkdirat(&root, OWN, Mode::RWXU) {
            Ok(()) | Err(Linux::EXIST) => {}
            Err(errno) => return Err(at(errno)),
        }
        let nofollow = directory | OFlags::NOFOLLOW;
        let stage =
            rustix::fs::openat2(&root, OWN, nofollow, Mode::empty(), CONFINED).map_err(at)?;
        let flags = OFlags::RDWR | OFlags::CREATE | OFlags::CLOEXEC | OFlags::NOFOLLOW;
        let lock =
            rustix::fs::openat(&stage, "lock", flags, Mode::RUSR | Mode::WUSR).map_err(at)?;
        match rustix::fs::flock(&lock, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => {}
            Err(Linux::WOULDBLOCK) => {
                return Err(ServerError::Served {
                    root: path.to_owned(),
                });
            }
            Err(errno) => return Err(at(errno)),
        }
        let (stage_is, _) = about(&stage, c"").map_err(at)?;
        Ok(Self {
            root,
            stage,
            stage_is,
            _lock: lock,
        })
    }

    pub(super) fn root(&self) -> BorrowedFd<'_> {
        self.root.as_fd()
    }

    /// The server's own directory.
    pub(super) fn stage(&self) -> BorrowedFd<'_> {
        self.stage.as_fd()
    }

    /// The directory and the last component of a path; of the directory all links are followed, as
    /// far as they stay inside.
    pub(super) fn place(&self, path: &[u8]) -> Result<Place, Errno> {
        let kept = path.len() - path.iter().rev().take_while(|byte| **byte == b'/').count();
        let (stripped, directory) = (&path[..kept], kept < path.len());
        let (parent, name) = match stripped.iter().rposition(|byte| *byte == b'/') {
            // "/name" is absolute: its directory is "/".
            Some(at) => (&stripped[..at.max(1)], &stripped[at + 1..]),
            None if stripped.is_empty() => return Err(Errno::XDEV),
            None => (&b"."[..], stripped),
        };
        if matches!(name, b"." | b"..") {
            return Err(Errno::BUSY);
        }
        let flags = OFlags::PATH | OFlags::DIRECTORY | OFlags::CLOEXEC;
        let parent = confined(&self.root, parent, flags, Mode::empty())?;
        if about(&parent, c"")?.0 == self.stage_is {
            return Err(Errno::NOENT); // By a link.
        }
        let name = CString::new(name).map_err(|_| Errno::INVAL)?;
        Ok(Place {
            parent,
            name,
            directory,
        })
    }

    /// Opens a regular file or directory; `flags` are those of Linux.
    pub(super) fn open_path(
        &self,
        path: &[u8],
        flags: OFlags,
        mode: u32,
    ) -> Result<OwnedFd, Errno> {
        // Never waits for a FIFO that was put there after the look.
        let flags = flags | OFlags::CLOEXEC | OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::NOCTTY;
        let mode = if flags.contains(OFlags::CREATE) {
            Mode::from_raw_mode(mode)
        } else {
            Mode::empty()
        };
        let (at, name, flags) = match self.place(path) {
            Ok(place) if place.directory => {
                if flags.contains(OFlags::CREATE) {
                    return Err(Errno::ISDIR);
                }
                (place.parent, place.name, flags | OFlags::DIRECTORY)
            }
            Ok(place) => (place.parent, place.name, flags),
            Err(Errno::BUSY) => {
                let name = CString::new(path).map_err(|_| Errno::INVAL)?;
                let root = self.root.try_clone().map_err(|_| Errno::NFILE)?;
                (root, name, flags)
            }
            Err(errno) => return Err(errno),
        };
        self.open_at(&at, &name, flags, mode)
    }

    pub(super) fn open_at(
        &self,
        at: impl AsFd,
        name: &CStr,
        flags: OFlags,
        mode: Mode,
    ) -> Result<OwnedFd, Errno> {
        // Opening a device can do something, and so it is not opened to see what it is.
        // A path of several components, which `statat` would follow anywhere, ends with "." or "..".
        if !name.to_bytes().contains(&b'/') {
            match rustix::fs::statat(&at, name, AtFlags::SYMLINK_NOFOLLOW) {
                Ok(stat) => check_kind(FileType::from_raw_mode(stat.st_mode))?,
                Err(Linux::NOENT) if flags.contains(OFlags::CREATE) => {}
                Err(errno) => return Err(errno.into()),
            }
        }
        let file = confined(&at, name, flags, mode)?;
        let (evidence, status) = about(&file, c"")?;
        check_kind(FileType::from_raw_mode(status.mode))?;
        if evidence == self.stage_is {
            return Err(Errno::NOENT);
        }
        if status.is_directory() && !flags.contains(OFlags::DIRECTORY) {
            return Err(Errno::ISDIR);
        }
        Ok(file)
    }

    /// Moves what has a name to a name of its own in the server's directory.
    pub(super) fn take(&self, place: &Place, unique: &CStr) -> Result<(), Linux> {
        rustix::fs::renameat_with(
            &place.parent,
            &*place.name,
            &self.stage,
            unique,
            RenameFlags::NOREPLACE,
        )
    }

    /// Moves it back, or to a path for the first time.
    pub(super) fn put(&self, unique: &CStr, place: &Place) -> Result<(), Linux> {
        rustix::fs::renameat_with(
            &self.stage,
            unique,
            &place.parent,
            &*place.name,
            RenameFlags::NOREPLACE,
        )
    }

    /// What has a unique name, if it exists.
    pub(super) fn staged(&self, unique: &CStr) -> Result<Option<(Evidence, Status)>, Linux> {
        match about(&self.stage, unique) {
            Ok(found) => Ok(Some(found)),
            Err(Linux::NOENT) => Ok(None),
            Err(errno) => Err(errno),
        }
    }

    /// Removes what has a unique name, if it exists.
    pub(super) fn discard(&self, unique: &CStr) {
        if rustix::fs::unlinkat(&self.stage, unique, AtFlags::empty()) == Err(Linux::ISDIR) {
            // What somebody put into it meanwhile is left to the next session's beginning.
            let _ = rustix::fs::unlinkat(&self.stage, unique, AtFlags::REMOVEDIR);
        }
    }
}

/// Opens what stays inside. Where `..` meets a rename elsewhere, the kernel cannot tell, and asks to
/// be asked again.
fn confined(
    at: impl AsFd,
    path: impl rustix::path::Arg + Copy,
    flags: OFlags,
    mode: Mode,
) -> Result<OwnedFd, Linux> {
    for _ in 0..128 {
        match rustix::fs::openat2(&at, path, flags, mode, CONFINED) {
            Err(Linux::AGAIN | Linux::INTR) => {}
            outcome => return outcome,
        }
    }
    Err(Linux::AGAIN)
}

/// Evidence and status of a name, or with an empty name of the open file itself.
pub(super) fn about(at: impl AsFd, name: &CStr) -> Result<(Evidence, Status), Linux> {
    let flags = AtFlags::EMPTY_PATH | AtFlags::SYMLINK_NOFOLLOW;
    let wanted = StatxFlags::BASIC_STATS | StatxFlags::BTIME;
    let found = rustix::fs::statx(at, name, flags, wanted)?;
    let device = rustix::fs::makedev(found.stx_dev_major, found.stx_dev_minor);
    Ok((
        Evidence {
            device,
            inode: found.stx_ino,
            born_s: found.stx_btime.tv_sec.cast_unsigned(),
            born_ns: found.stx_btime.tv_nsec,
        },
        Status {
            size: found.stx_size,
            modified_s: found.stx_mtime.tv_sec.cast_unsigned(),
            modified_ns: found.stx_mtime.tv_nsec,
            mode: u32::from(found.stx_mode),
            links: found.stx_nlink,
        },
    ))
}

fn check_kind(kind: FileType) -> Result<(), Errno> {
    match kind {
        FileType::RegularFile | FileType::Directory => Ok(()),
        FileType::Symlink => Err(Errno::LOOP),
        _ => Err(Errno::OPNOTSUPP),
    }
}
