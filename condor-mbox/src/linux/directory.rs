//! The files of a named system, which outlive every program.
//!
//! Each file appears at its name complete, with its size, or not at all: it is created without a
//! name and then linked. So a process that is killed leaves nothing half-done, and processes that
//! create a file at the same time end up with the same one.

use std::ffi::OsStr;
use std::io::{self, Read as _};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};
use std::os::unix::ffi::OsStrExt as _;
use std::path::{Path, PathBuf};

use rustix::fs::{AtFlags, CWD, Dir, FallocateFlags, FileType, Mode, OFlags, RawMode, Stat};
use rustix::io::Errno;
use rustix::path::Arg;

use super::error::{FileKind, SystemError};
use super::lock;
use super::window::WindowAccess;

/// More than any text of a system has.
const MOST_TEXT: u64 = 16 * 1024;
/// The number of attempts to delete a directory in which claims that are under way still make files.
const BURIALS: u32 = 1000;

/// An open directory of a system.
#[derive(Debug)]
pub(super) struct OpenDirectory {
    path: PathBuf,
    descriptor: OwnedFd,
    device_and_inode: (u64, u64),
    owner: u32,
    /// Mode for files: the directory's, without execution.
    mode: Mode,
}

impl OpenDirectory {
    /// Opens the directory at `path`, and creates it before if there is none; `None` if it was
    /// removed in between. A link at `path` itself is not followed: where others may write, one of
    /// them could have put it there.
    pub(super) fn open(path: &Path) -> Result<Option<Self>, SystemError> {
        match rustix::fs::mkdir(path, Mode::RWXU) {
            Ok(()) | Err(Errno::EXIST) => {}
            Err(errno) => return Err(SystemError::os("create", path)(errno)),
        }
        let descriptor = match open_directory(path) {
            Ok(descriptor) => descriptor,
            Err(Errno::NOENT) => return Ok(None),
            Err(errno @ (Errno::NOTDIR | Errno::LOOP)) => {
                let stat = rustix::fs::lstat(path).map_err(SystemError::os("examine", path))?;
                expect_kind(path, &stat, FileKind::Directory)?;
                return Err(SystemError::os("open", path)(errno));
            }
            Err(errno) => return Err(SystemError::os("open", path)(errno)),
        };
        let stat = rustix::fs::fstat(&descriptor).map_err(SystemError::os("examine", path))?;
        Ok(Some(Self {
            path: path.into(),
            descriptor,
            device_and_inode: identity(&stat),
            owner: stat.st_uid,
            mode: Mode::from_raw_mode(stat.st_mode as RawMode) & Mode::from_raw_mode(0o666),
        }))
    }

    /// Refuses a directory that somebody else put at this name.
    pub(super) fn expect_own(&self) -> Result<(), SystemError> {
        let expected = rustix::process::geteuid().as_raw();
        if self.owner == expected {
            return Ok(());
        }
        Err(SystemError::WrongOwner {
            path: self.path.clone(),
            found: self.owner,
            expected,
        })
    }

    /// Returns true if the directory's path still leads to it.
    pub(super) fn is_current(&self) -> Result<bool, SystemError> {
        match rustix::fs::lstat(&self.path) {
            Ok(stat) => Ok(identity(&stat) == self.device_and_inode),
            Err(Errno::NOENT) => Ok(false),
            Err(errno) => Err(SystemError::os("examine", &self.path)(errno)),
        }
    }

    pub(super) fn path_of(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    /// Opens the file `name` of `size` bytes, and creates it before if there is none.
    ///
    /// `None` if the directory was removed meanwhile.
    pub(super) fn object(
        &self,
        name: &str,
        size: u32,
        access: WindowAccess,
    ) -> Result<Option<OwnedFd>, SystemError> {
        let path = self.path_of(name);
        let file = match self.open_file(name, access) {
            Err(Errno::NOENT) => match self.create(name, size) {
                Ok(()) | Err(Errno::EXIST) => self.open_file(name, access),
                Err(errno) => return self.not_created(&path, errno),
            },
            other => other,
        };
        let file = match file {
            Ok(file) => file,
            Err(Errno::NOENT) => return Ok(None),
            Err(errno) => return Err(self.not_opened(&path, name, FileKind::File, errno)),
        };
        let stat = rustix::fs::fstat(&file).map_err(SystemError::os("examine", &path))?;
        expect_kind(&path, &stat, FileKind::File)?;
        expect_size(&path, &stat, size)?;
        Ok(Some(file))
    }

    /// Opens the FIFO `name`, and creates it before if there is none; `None` as for `object`.
    pub(super) fn fifo(&self, name: &str) -> Result<Option<OwnedFd>, SystemError> {
        let node = self.node_of_fifo(name)?;
        node.map(|node| self.open_fifo(&node, name)).transpose()
    }

    /// The FIFO that `name` stands for now, neither open for reading nor for writing.
    fn node_of_fifo(&self, name: &str) -> Result<Option<OwnedFd>, SystemError> {
        let path = self.path_of(name);
        match rustix::fs::mkfifoat(&self.descriptor, name, self.mode) {
            Ok(()) | Err(Errno::EXIST) => {}
            Err(errno) => return self.not_created(&path, errno),
        }
        let flags = OFlags::PATH | OFlags::NOFOLLOW | OFlags::CLOEXEC;
        match rustix::fs::openat(&self.descriptor, name, flags, Mode::empty()) {
            Ok(node) => Ok(Some(node)),
            Err(Errno::NOENT) => Ok(None),
            Err(errno) => Err(SystemError::os("open", path)(errno)),
        }
    }

    /// Opens the FIFO that `node` is. By now `name` may stand for something else: where others may
    /// write, one of them could have put a link there. So all is done to the node.
    fn open_fifo(&self, node: &OwnedFd, name: &str) -> Result<OwnedFd, SystemError> {
        let path = self.path_of(name);
        let stat = rustix::fs::fstat(node).map_err(SystemError::os("examine", &path))?;
        expect_kind(&path, &stat, FileKind::Fifo)?;
        let owned = stat.st_uid == rustix::process::geteuid().as_raw();
        if owned && Mode::from_raw_mode(stat.st_mode as RawMode) != self.mode {
            // The umask took permissions away, here or where the creator was killed.
            rustix::fs::chmod(nameless(node), self.mode)
                .map_err(SystemError::os("set the permissions of", &path))?;
        }
        reopen(node.as_fd(), WindowAccess::ReadWrite).map_err(SystemError::os("open", path))
    }

    /// Returns the contents of the file `name`, with the file's status; if there is none, it is created with
    /// the contents `text`. `None` if the directory was removed meanwhile.
    pub(super) fn text_or(
        &self,
        name: &str,
        text: &[u8],
    ) -> Result<Option<(Vec<u8>, Stat)>, SystemError> {
        if let Some(found) = self.text(name)? {
            return Ok(Some(found));
        }
        let written = |file: &OwnedFd| {
            let mut rest = text;
            while !rest.is_empty() {
                let count = rustix::io::retry_on_intr(|| rustix::io::write(file, rest))?;
                rest = rest.get(count..).unwrap_or_default();
            }
            Ok(())
        };
        // The file is never written again.
        let mode = self.mode & Mode::from_raw_mode(0o444);
        match self.create_with(name, mode, written) {
            Ok(()) | Err(Errno::EXIST) => self.text(name),
            Err(errno) => self.not_created(&self.path_of(name), errno),
        }
    }

    /// Returns the contents of the file `name`; `None` if there is none.
    fn text(&self, name: &str) -> Result<Option<(Vec<u8>, Stat)>, SystemError> {
        let path = self.path_of(name);
        let file = match self.open_file(name, WindowAccess::ReadOnly) {
            Ok(file) => file,
            Err(Errno::NOENT) => return Ok(None),
            Err(errno) => return Err(self.not_opened(&path, name, FileKind::File, errno)),
        };
        let stat = rustix::fs::fstat(&file).map_err(SystemError::os("examine", &path))?;
        expect_kind(&path, &stat, FileKind::File)?;
        let mut text = Vec::new();
        std::fs::File::from(file)
            .take(MOST_TEXT)
            .read_to_end(&mut text)
            .map_err(SystemError::os("read", &path))?;
        Ok(Some((text, stat)))
    }

    /// Refuses a file that belongs neither to this user, nor to root, nor to the owner of the
    /// directory, and a file that other users than its owner may write.
    pub(super) fn expect_trusted(&self, name: &str, stat: &Stat) -> Result<(), SystemError> {
        let expected = rustix::process::geteuid().as_raw();
        if ![expected, 0, self.owner].contains(&stat.st_uid) {
            return Err(SystemError::WrongOwner {
                path: self.path_of(name),
                found: stat.st_uid,
                expected,
            });
        }
        let mode = Mode::from_raw_mode(stat.st_mode as RawMode);
        if mode.intersects(Mode::WGRP | Mode::WOTH) {
            let mode = mode.as_raw_mode();
            return Err(SystemError::OtherSystem {
                path: self.path_of(name),
                reason: format!(
                    "it names the memory, but its mode {mode:o} lets others write it; use `chmod go-w`"
                ),
            });
        }
        Ok(())
    }

    /// Removes the directory and the files `names`, of which those in `mails`, of `mail_bytes`
    /// each, are locked first.
    ///
    /// Returns the index of the first of `mails` that a process holds, if there is one.
    pub(super) fn remove(
        &self,
        names: &[String],
        mails: &[String],
        mail_bytes: u32,
    ) -> Result<Option<(usize, OwnedFd)>, SystemError> {
        let grave = self.grave();
        let mut locked = Vec::new();
        for (index, name) in mails.iter().enumerate() {
            let path = self.path_of(name);
            let mut mail = self.open_file(name, WindowAccess::ReadWrite);
            if let Err(Errno::NOENT) = mail {
                // The number could be claimed from now on unless it is locked, too. Only then is a file
                // made: a removal is also to free a disk that is full.
                match self.create(name, mail_bytes) {
                    Ok(()) | Err(Errno::EXIST) => {}
                    Err(errno) => return self.not_created(&path, errno),
                }
                mail = self.open_file(name, WindowAccess::ReadWrite);
            }
            let mail = match mail {
                Ok(mail) => mail,
                Err(Errno::NOENT) => return Ok(None),
                Err(errno) => return Err(self.not_opened(&path, name, FileKind::File, errno)),
            };
            if !lock::take(&mail).map_err(SystemError::os("lock", path))? {
                return Ok(Some((index, mail)));
            }
            locked.push(mail);
        }
        // Somebody else may have removed it before it was locked; what is at its path now is
        // another one.
        if !self.is_current()? {
            return Ok(None);
        }
        let entries =
            Dir::read_from(&self.descriptor).map_err(SystemError::os("list", &self.path))?;
        for entry in entries {
            let entry = entry.map_err(SystemError::os("list", &self.path))?;
            let found = entry.file_name().to_bytes();
            if !matches!(found, b"." | b"..") && !names.iter().any(|name| name.as_bytes() == found)
            {
                let path = self.path.join(OsStr::from_bytes(found));
                return Err(SystemError::ForeignFile { path });
            }
        }
        // The whole directory goes at once, while all numbers are held: a claim that opened it
        // before finds that its path leads elsewhere, and a later one makes a new directory. What
        // an earlier removal left behind when it was killed makes room first.
        match open_directory(&grave) {
            Ok(left) => bury(&left, &grave, names)?,
            Err(Errno::NOENT) => {}
            Err(errno) => return Err(SystemError::os("open", grave)(errno)),
        }
        match rustix::fs::rename(&self.path, &grave) {
            Ok(()) => bury(&self.descriptor, &grave, names).map(|()| None),
            Err(Errno::NOENT) => Ok(None),
            Err(errno) => Err(SystemError::os("rename", &self.path)(errno)),
        }
    }

    fn grave(&self) -> PathBuf {
        let mut name = self.path.clone().into_os_string();
        name.push(".removed");
        name.into()
    }

    fn open_file(&self, name: &str, access: WindowAccess) -> Result<OwnedFd, Errno> {
        open_again(&self.descriptor, name, access, OFlags::NOFOLLOW)
    }

    /// `None` if the reason is that the directory was removed, for which filesystems have several errors.
    fn not_created<T>(&self, path: &Path, errno: Errno) -> Result<Option<T>, SystemError> {
        if self.is_current()? {
            return Err(SystemError::os("create", path)(errno));
        }
        Ok(None)
    }

    /// Creates a file of `size` bytes that has all its memory.
    fn create(&self, name: &str, size: u32) -> Result<(), Errno> {
        self.create_with(name, self.mode, |file| fill(file, size.into()))
    }

    /// Creates a file that is as `make` leaves it from the moment that it appears.
    fn create_with(
        &self,
        name: &str,
        mode: Mode,
        make: impl FnOnce(&OwnedFd) -> Result<(), Errno>,
    ) -> Result<(), Errno> {
        let flags = OFlags::TMPFILE | OFlags::RDWR | OFlags::CLOEXEC;
        let file = rustix::fs::openat(&self.descriptor, ".", flags, mode)?;
        rustix::fs::fchmod(&file, mode)?;
        make(&file)?;
        rustix::fs::linkat(
            CWD,
            nameless(&file),
            &self.descriptor,
            name,
            AtFlags::SYMLINK_FOLLOW,
        )
    }

    /// The reason why `name` could not be opened, as far as its kind is the reason.
    fn not_opened(&self, path: &Path, name: &str, kind: FileKind, errno: Errno) -> SystemError {
        let found = rustix::fs::statat(&self.descriptor, name, AtFlags::SYMLINK_NOFOLLOW);
        let wrong = found
            .ok()
            .and_then(|stat| expect_kind(path, &stat, kind).err());
        wrong.unwrap_or_else(|| SystemError::os("open", path)(errno))
    }
}

/// Sets the size of a new file to `bytes` and reserves its memory now: if memory ran short later, every program
/// that maps the file would be killed by a bus error. If the filesystem cannot allocate memory in advance, only
/// the size is set.
///
/// # Errors
/// Returns the error of the operating system if the size cannot be set, of the kind
/// [`StorageFull`](io::ErrorKind::StorageFull) if there is too little memory.
pub fn allocate(file: impl AsFd, bytes: u64) -> io::Result<()> {
    Ok(fill(file, bytes)?)
}

/// Does the same for a file that gets its name later.
pub(super) fn fill(file: impl AsFd, bytes: u64) -> Result<(), Errno> {
    let allocate = || rustix::fs::fallocate(&file, FallocateFlags::empty(), 0, bytes);
    match rustix::io::retry_on_intr(allocate) {
        Err(Errno::OPNOTSUPP) => rustix::fs::ftruncate(&file, bytes),
        other => other,
    }
}

/// Opens a directory, and not through a link.
fn open_directory(path: &Path) -> Result<OwnedFd, Errno> {
    let flags = OFlags::RDONLY | OFlags::DIRECTORY | OFlags::NOFOLLOW | OFlags::CLOEXEC;
    rustix::fs::open(path, flags, Mode::empty())
}

/// A path to what is open, whatever its names are.
fn nameless(descriptor: impl AsFd) -> String {
    format!("/proc/self/fd/{}", descriptor.as_fd().as_raw_fd())
}

/// A new open file description of `path`.
pub(super) fn open_again(
    directory: impl AsFd,
    path: impl Arg,
    access: WindowAccess,
    flags: OFlags,
) -> Result<OwnedFd, Errno> {
    let access = match access {
        WindowAccess::ReadOnly => OFlags::RDONLY,
        WindowAccess::ReadWrite => OFlags::RDWR,
    };
    // Without NONBLOCK, opening what turns out to be a FIFO could block.
    let flags = access | flags | OFlags::CLOEXEC | OFlags::NONBLOCK | OFlags::NOCTTY;
    rustix::fs::openat(directory, path, flags, Mode::empty())
}

/// A new open file description of what `descriptor` stands for.
pub(super) fn reopen(descriptor: BorrowedFd<'_>, access: WindowAccess) -> Result<OwnedFd, Errno> {
    open_again(CWD, nameless(descriptor), access, OFlags::empty())
}

pub(super) fn expect_kind(path: &Path, stat: &Stat, expected: FileKind) -> Result<(), SystemError> {
    let found = match FileType::from_raw_mode(stat.st_mode) {
        FileType::RegularFile => FileKind::File,
        FileType::Fifo => FileKind::Fifo,
        FileType::Directory => FileKind::Directory,
        FileType::Symlink => FileKind::Symlink,
        _ => FileKind::Other,
    };
    if found == expected {
        return Ok(());
    }
    Err(SystemError::WrongKind {
        path: path.into(),
        found,
        expected,
    })
}

pub(super) fn expect_size(path: &Path, stat: &Stat, expected: u32) -> Result<(), SystemError> {
    let found = u64::try_from(stat.st_size).unwrap_or(0);
    let expected = u64::from(expected);
    if found == expected {
        return Ok(());
    }
    Err(SystemError::WrongSize {
        path: path.into(),
        found,
        expected,
    })
}

#[allow(
    clippy::unnecessary_cast,
    reason = "the widths differ between architectures"
)]
fn identity(stat: &Stat) -> (u64, u64) {
    (stat.st_dev as u64, stat.st_ino as u64)
}

/// Deletes the directory at `grave`, which is open and to which no path of a system leads.
fn bury(directory: impl AsFd, grave: &Path, names: &[String]) -> Result<(), SystemError> {
    let mut attempts = 0;
    loop {
        for name in names {
            match rustix::fs::unlinkat(&directory, name, AtFlags::empty()) {
                Ok(()) | Err(Errno::NOENT) => {}
                Err(errno) => return Err(SystemError::os("delete", grave.join(name))(errno)),
            }
        }
        attempts += 1;
        match rustix::fs::rmdir(grave) {
            Ok(()) | Err(Errno::NOENT) => return Ok(()),
            // A claim that opened the directory before makes a file there, and then sees that the path leads elsewhere.
            Err(Errno::NOTEMPTY) if attempts < BURIALS => {}
            Err(errno) => return Err(SystemError::os("delete", grave)(errno)),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fs::{self, Permissions};
    use std::os::unix::fs::{PermissionsExt as _, symlink};

    use super::*;

    /// A peer that may write the directory changes what a name stands for, in the middle.
    #[test]
    fn a_link_in_the_place_of_a_bell_changes_no_permissions() {
        let kept = tempfile::tempdir().expect("a temporary directory");
        let (path, victim) = (kept.path().join("system"), kept.path().join("victim"));
        fs::write(&victim, "").expect("a file");
        fs::set_permissions(&victim, Permissions::from_mode(0o600)).expect("it is ours");
        fs::create_dir(&path).expect("a directory");
        fs::set_permissions(&path, Permissions::from_mode(0o770)).expect("it is ours");
        let mode = |path: &Path| {
            let found = fs::metadata(path).expect("it is there");
            found.permissions().mode() & 0o7777
        };
        let directory = OpenDirectory::open(&path).unwrap().expect("it is there");
        let (bell, moved) = (path.join("0.bell"), path.join("moved"));
        let node = directory.node_of_fifo("0.bell").unwrap();
        let node = node.expect("it was made");
        fs::set_permissions(&bell, Permissions::from_mode(0o600)).expect("it is ours");
        fs::rename(&bell, &moved).expect("it is ours");
        symlink(&victim, &bell).expect("a link");
        directory.open_fifo(&node, "0.bell").expect("it is a FIFO");
        assert_eq!((mode(&victim), mode(&moved)), (0o600, 0o660));
        let error = directory.fifo("0.bell").expect_err("it is a link");
        let found = FileKind::Symlink;
        assert!(
            matches!(error, SystemError::WrongKind { found: is, .. } if is == found),
            "{error}"
        );
    }
}
