//! [`Tree`]: the directory tree, which no path leaves.

use std::ffi::{CStr, CString};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};
use std::path::Path;

use condor_platform::linux::{LOCK_PATIENCE, lock_file};
use rustix::fs::{
    AtFlags, CWD, FileType, FlockOperation, Mode, OFlags, RenameFlags, ResolveFlags, StatxFlags,
};
use rustix::io::Errno as Linux;

use super::ServerError;
use crate::errno::Errno;
use crate::wire::{FileIdentity, FileStatus};

/// The server's own directory at the top of the tree.
pub(super) const OWN: &[u8] = b".condor-fs";

/// The way in which paths of clients are followed.
const CONFINED: ResolveFlags = ResolveFlags::BENEATH
    .union(ResolveFlags::NO_MAGICLINKS)
    .union(ResolveFlags::NO_XDEV);

/// Lets go of the lock by itself: a process that another thread forks has the file, too, until it
/// executes its program.
struct Lock(OwnedFd);

impl Drop for Lock {
    fn drop(&mut self) {
        let _ = rustix::fs::flock(&self.0, FlockOperation::Unlock);
    }
}

/// The tree, locked.
pub(super) struct Tree {
    root: OwnedFd,
    root_is: FileIdentity,
    stage: OwnedFd,
    stage_is: FileIdentity,
    _lock: Lock,
}

/// A name in a directory.
pub(super) struct NameIn {
    pub(super) parent: OwnedFd,
    pub(super) name: CString,
    /// The path ended with a slash.
    pub(super) directory: bool,
}

impl NameIn {
    /// The same, if it is a name that can be made and removed; else what Linux answers to `.` and
    /// to `..` in its place.
    pub(super) fn named(self, dot: Errno, dots: Errno) -> Result<Self, Errno> {
        match self.name.to_bytes() {
            b"." => Err(dot),
            b".." => Err(dots),
            _ => Ok(self),
        }
    }

    /// Whether it can be a directory alone, also one that a link leads to.
    pub(super) fn is_directory(&self) -> bool {
        self.directory || matches!(self.name.to_bytes(), b"." | b"..")
    }

    /// Makes a file that has no name yet in the directory of the place, as one that is made there
    /// with the name: its group, attributes and access list come from the directory.
    pub(super) fn make_unnamed(&self, flags: OFlags, mode: u32) -> Result<OwnedFd, Linux> {
        unnamed(&self.parent, flags | OFlags::CLOEXEC, mode)
    }

    /// Links the file to the name, unless that is taken.
    pub(super) fn give_name(&self, file: &OwnedFd) -> Result<(), Linux> {
        let flags = AtFlags::SYMLINK_FOLLOW;
        rustix::fs::linkat(CWD, path_of(file), &self.parent, &*self.name, flags)
    }

    /// Evidence and status of the name.
    pub(super) fn about(&self) -> Result<(FileIdentity, FileStatus), Linux> {
        about(&self.parent, &self.name)
    }
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
        if !lock_file(&lock, LOCK_PATIENCE).map_err(at)? {
            return Err(ServerError::Served {
                root: path.to_owned(),
            });
        }
        let lock = Lock(lock);
        let (root_is, _) = about(&root, c"").map_err(at)?;
        let (stage_is, _) = about(&stage, c"").map_err(at)?;
        Ok(Self {
            root,
            root_is,
            stage,
            stage_is,
            _lock: lock,
        })
    }

    /// Finds out whether files that are made with these permissions could be opened again.
    pub(super) fn check_mode(&self, mode: u32) -> Result<(), Linux> {
        let flags = OFlags::RDWR | OFlags::CLOEXEC;
        let file = unnamed(&self.stage, flags, mode)?;
        rustix::fs::open(path_of(&file), flags, Mode::empty()).map(drop)
    }

    pub(super) fn root(&self) -> BorrowedFd<'_> {
        self.root.as_fd()
    }

    /// Whether an open directory is the tree itself.
    pub(super) fn is_root(&self, directory: impl AsFd) -> Result<bool, Linux> {
        Ok(about(directory, c"")?.0 == self.root_is)
    }

    /// The server's own directory.
    pub(super) fn stage(&self) -> BorrowedFd<'_> {
        self.stage.as_fd()
    }

    /// The directory and the last component of a path; of the directory all links are followed, as
    /// far as they stay inside.
    pub(super) fn place(&self, path: &[u8]) -> Result<NameIn, Errno> {
        let kept = path.len() - path.iter().rev().take_while(|byte| **byte == b'/').count();
        let (stripped, directory) = (&path[..kept], kept < path.len());
        let (parent, name) = match stripped.iter().rposition(|byte| *byte == b'/') {
            // "/name" is absolute: its directory is "/".
            Some(at) => (&stripped[..at.max(1)], &stripped[at + 1..]),
            None if stripped.is_empty() => return Err(Errno::XDEV),
            None => (&b"."[..], stripped),
        };
        let flags = OFlags::PATH | OFlags::DIRECTORY | OFlags::CLOEXEC;
        let parent = confined(&self.root, parent, flags, Mode::empty())?;
        let (parent_is, _) = about(&parent, c"")?;
        if parent_is == self.stage_is || (parent_is == self.root_is && name == OWN) {
            return Err(Errno::NOENT);
        }
        let name = CString::new(name).map_err(|_| Errno::INVAL)?;
        Ok(NameIn {
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
        let place = self.place(path)?;
        // Never waits for a FIFO that was put there after the look.
        let opening =
            flags | OFlags::CLOEXEC | OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::NOCTTY;
        if !place.is_directory() {
            let mode = if flags.contains(OFlags::CREATE) {
                Mode::from_raw_mode(mode)
            } else {
                Mode::empty()
            };
            return self.open_at(&place.parent, &place.name, opening, mode);
        }
        if flags.contains(OFlags::CREATE) {
            return Err(Errno::ISDIR);
        }
        let directory = self.open_directory(path, opening)?;
        if flags.contains(OFlags::DIRECTORY) {
            Ok(directory)
        } else {
            Err(Errno::ISDIR)
        }
    }

    /// The regular file or directory at a path, without opening it: no permission of its own is
    /// needed.
    pub(super) fn find(&self, path: &[u8]) -> Result<OwnedFd, Errno> {
        let place = self.place(path)?;
        if place.is_directory() {
            return self.open_directory(path, OFlags::PATH);
        }
        let flags = OFlags::PATH | OFlags::NOFOLLOW | OFlags::CLOEXEC;
        let found = confined(&place.parent, &*place.name, flags, Mode::empty())?;
        let (evidence, status) = about(&found, c"")?;
        check_kind(FileType::from_raw_mode(status.mode), OFlags::empty())?;
        if evidence == self.stage_is {
            return Err(Errno::NOENT);
        }
        Ok(found)
    }

    /// Opens the directory that a whole path leads to, as one with a slash behind it does.
    pub(super) fn open_directory(&self, path: &[u8], flags: OFlags) -> Result<OwnedFd, Errno> {
        let flags = flags | OFlags::DIRECTORY | OFlags::CLOEXEC;
        let directory = confined(&self.root, path, flags, Mode::empty())?;
        if about(&directory, c"")?.0 == self.stage_is {
            return Err(Errno::NOENT); // By a link.
        }
        Ok(directory)
    }

    pub(super) fn open_at(
        &self,
        at: impl AsFd,
        name: &CStr,
        flags: OFlags,
        mode: Mode,
    ) -> Result<OwnedFd, Errno> {
        // Opening a device can do something, and so it is not opened to see what it is.
        match rustix::fs::statat(&at, name, AtFlags::SYMLINK_NOFOLLOW) {
            Ok(stat) => check_kind(FileType::from_raw_mode(stat.st_mode), flags)?,
            Err(Linux::NOENT) if flags.contains(OFlags::CREATE) => {}
            Err(errno) => return Err(errno.into()),
        }
        let file = confined(&at, name, flags, mode)?;
        let (evidence, status) = about(&file, c"")?;
        check_kind(FileType::from_raw_mode(status.mode), flags)?;
        if evidence == self.stage_is {
            return Err(Errno::NOENT);
        }
        if status.is_directory() && !flags.contains(OFlags::DIRECTORY) {
            return Err(Errno::ISDIR);
        }
        Ok(file)
    }

    /// Moves what has a name to a name of its own in the server's directory.
    pub(super) fn set_aside(&self, place: &NameIn, unique: &CStr) -> Result<(), Linux> {
        let flags = RenameFlags::NOREPLACE;
        rustix::fs::renameat_with(&place.parent, &*place.name, &self.stage, unique, flags)
    }

    /// Returns the file that has a unique name, if it exists.
    pub(super) fn aside(&self, unique: &CStr) -> Result<Option<(FileIdentity, FileStatus)>, Linux> {
        match about(&self.stage, unique) {
            Ok(found) => Ok(Some(found)),
            Err(Linux::NOENT) => Ok(None),
            Err(errno) => Err(errno),
        }
    }

    /// Removes what has a unique name.
    pub(super) fn discard(&self, unique: &CStr) -> Result<(), Linux> {
        rustix::fs::unlinkat(&self.stage, unique, AtFlags::empty())
    }
}

/// A file that is gone when it is closed, unless it is given a name before.
fn unnamed(directory: &OwnedFd, flags: OFlags, mode: u32) -> Result<OwnedFd, Linux> {
    let mode = Mode::from_raw_mode(mode);
    rustix::fs::openat(directory, c".", flags | OFlags::TMPFILE, mode)
}

/// The path by which the kernel finds an open file, whatever its name is.
pub(super) fn path_of(file: &OwnedFd) -> String {
    format!("/proc/self/fd/{}", file.as_raw_fd())
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
pub(super) fn about(at: impl AsFd, name: &CStr) -> Result<(FileIdentity, FileStatus), Linux> {
    let flags = AtFlags::EMPTY_PATH | AtFlags::SYMLINK_NOFOLLOW;
    let wanted = StatxFlags::BASIC_STATS | StatxFlags::BTIME;
    let found = rustix::fs::statx(at, name, flags, wanted)?;
    let device = rustix::fs::makedev(found.stx_dev_major, found.stx_dev_minor);
    Ok((
        FileIdentity {
            device,
            inode: found.stx_ino,
            born_s: found.stx_btime.tv_sec.cast_unsigned(),
            born_ns: found.stx_btime.tv_nsec,
        },
        FileStatus {
            size: found.stx_size,
            modified_s: found.stx_mtime.tv_sec.cast_unsigned(),
            modified_ns: found.stx_mtime.tv_nsec,
            mode: u32::from(found.stx_mode),
            links: found.stx_nlink,
            device,
            inode: found.stx_ino,
            accessed_s: found.stx_atime.tv_sec.cast_unsigned(),
            accessed_ns: found.stx_atime.tv_nsec,
            changed_s: found.stx_ctime.tv_sec.cast_unsigned(),
            changed_ns: found.stx_ctime.tv_nsec,
            blocks: found.stx_blocks,
            owner: found.stx_uid,
            group: found.stx_gid,
        },
    ))
}

fn check_kind(kind: FileType, flags: OFlags) -> Result<(), Errno> {
    match kind {
        FileType::RegularFile | FileType::Directory => Ok(()),
        _ if flags.contains(OFlags::DIRECTORY) => Err(Errno::NOTDIR),
        FileType::Symlink => Err(Errno::LOOP),
        _ => Err(Errno::OPNOTSUPP),
    }
}
