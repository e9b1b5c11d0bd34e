//! [`Mount`]: what the kernel asks of a filesystem, as calls of a [`Client`].
//!
//! Nothing is cached: names and attributes are forgotten at once, and reads and writes are passed on as
//! they are, where the kernel can map the pages of such files. An operation that condor-fs does not have
//! fails with `EOPNOTSUPP`.

use std::collections::HashMap;
use std::ffi::OsStr;
use std::os::unix::ffi::OsStrExt as _;
use std::path::Path;
use std::sync::mpsc::{Sender, channel};
use std::time::{Duration, SystemTime};

use condor_fs::{AllocationMode, FileError, FileStatus, OpenOptions, SetTime, Times};
use condor_mbox::linux::LinuxSystem;
use fuser::{
    BsdFileFlags, Errno, FileAttr, FileHandle, FileType, Filesystem, FopenFlags, Generation,
    INodeNo, InitFlags, KernelConfig, LockOwner, OpenFlags, RenameFlags, ReplyAttr, ReplyCreate,
    ReplyData, ReplyDirectory, ReplyEmpty, ReplyEntry, ReplyLseek, ReplyOpen, ReplyStatfs,
    ReplyWrite, Request, TimeOrNow, WriteFlags,
};

use crate::N;
use crate::client::{Client, Entry};
use crate::nodes::Nodes;

/// The time for which the kernel may keep names and attributes.
const TTL: Duration = Duration::ZERO;
/// No number of a node is used twice.
const GENERATION: Generation = Generation(0);

const UNSUPPORTED: Errno = Errno::EOPNOTSUPP;

/// The mounted filesystem. One thread is the processor; it does what the kernel asks in turn.
pub(crate) struct Mount {
    jobs: Sender<Job>,
    /// The way files are opened: past the cache of the kernel, if it can map such files.
    direct: FopenFlags,
}

type Job = Box<dyn FnOnce(&mut Inner) + Send>;

struct Inner {
    client: Client,
    nodes: Nodes,
    /// The entries of each open directory, as read at its beginning.
    directories: HashMap<u64, Vec<Entry>>,
    last_directory: u64,
}

/// The attributes of a node for the kernel, or the error.
type Found = Result<FileAttr, Errno>;

impl Mount {
    /// Connects with the server.
    pub(crate) fn new(system: &'static LinuxSystem<N>) -> Self {
        let (jobs, asked) = channel::<Job>();
        std::thread::spawn(move || {
            let mut inner = Inner {
                client: match Client::connect(system) {
                    Ok(client) => client,
                    // All that is asked then is an error.
                    Err(error) => return eprintln!("condor-suites: {error}"),
                },
                nodes: Nodes::new(),
                directories: HashMap::new(),
                last_directory: 0,
            };
            for job in asked {
                job(&mut inner);
            }
        });
        Self {
            jobs,
            direct: FopenFlags::FOPEN_DIRECT_IO,
        }
    }

    fn ask(&self, job: impl FnOnce(&mut Inner) + Send + 'static) {
        // A reply that is dropped is an error.
        let _ = self.jobs.send(Box::new(job));
    }
}

impl Inner {
    fn path(&self, node: INodeNo) -> Result<Vec<u8>, Errno> {
        self.nodes
            .path(node.0)
            .map(<[u8]>::to_vec)
            .ok_or(Errno::ESTALE)
    }

    fn child(&self, parent: INodeNo, name: &OsStr) -> Result<Vec<u8>, Errno> {
        let path = self.nodes.child(parent.0, name.as_bytes());
        path.ok_or(Errno::ENOENT)
    }

    /// Returns the attributes of the node at `path`, which the kernel knows from now on.
    fn entry(&mut self, path: Vec<u8>) -> Found {
        let status = self.client.files.status(&path).map_err(errno)?;
        let node = self.nodes.look_up(path);
        Ok(attributes(node, &status))
    }

    fn attributes_of(&self, node: INodeNo) -> Found {
        let status = self.client.status(node.0, self.nodes.path(node.0));
        Ok(attributes(node.0, &status.map_err(errno)?))
    }

    fn truncate(
        &mut self,
        node: INodeNo,
        handle: Option<FileHandle>,
        size: u64,
    ) -> Result<(), Errno> {
        if let Some(FileHandle(handle)) = handle {
            return self
                .client
                .file(handle)
                .and_then(|file| file.truncate(size))
                .map_err(errno);
        }
        let path = self.path(node)?;
        let write = OpenOptions::new().write();
        let file = self.client.files.open(path, write).map_err(errno)?;
        file.truncate(size)
            .and_then(|()| file.close())
            .map_err(errno)
    }

    fn set_mode(
        &mut self,
        node: INodeNo,
        handle: Option<FileHandle>,
        mode: u32,
    ) -> Result<(), Errno> {
        if let Some(FileHandle(handle)) = handle {
            let file = self.client.file(handle);
            return file.and_then(|file| file.set_mode(mode)).map_err(errno);
        }
        let path = self.path(node)?;
        self.client.files.set_mode(path, mode).map_err(errno)
    }

    fn set_times(
        &mut self,
        node: INodeNo,
        handle: Option<FileHandle>,
        times: Times,
    ) -> Result<(), Errno> {
        if let Some(FileHandle(handle)) = handle {
            let file = self.client.file(handle);
            return file.and_then(|file| file.set_times(times)).map_err(errno);
        }
        let path = self.path(node)?;
        self.client.files.set_times(path, times).map_err(errno)
    }

    fn open(&mut self, node: u64, path: &[u8], flags: i32) -> Result<FileHandle, Errno> {
        let handle = self.client.open(node, path, options(flags));
        handle.map(FileHandle).map_err(errno)
    }
}

fn attributes(node: u64, status: &FileStatus) -> FileAttr {
    let modified = system_time(status.modified_s, status.modified_ns);
    FileAttr {
        ino: INodeNo(node),
        size: status.size,
        blocks: status.blocks,
        atime: system_time(status.accessed_s, status.accessed_ns),
        mtime: modified,
        ctime: system_time(status.changed_s, status.changed_ns),
        crtime: modified,
        kind: kind(status.mode >> 12),
        perm: (status.mode & 0o7777) as u16,
        nlink: status.links,
        uid: status.owner,
        gid: status.group,
        rdev: 0,
        blksize: 4096,
        flags: 0,
    }
}

/// Converts a time of a status, which may be before 1970.
fn system_time(seconds: u64, nanoseconds: u32) -> SystemTime {
    let seconds = seconds.cast_signed();
    let whole = Duration::from_secs(seconds.unsigned_abs());
    let begun = if seconds < 0 {
        SystemTime::UNIX_EPOCH - whole
    } else {
        SystemTime::UNIX_EPOCH + whole
    };
    begun + Duration::new(0, nanoseconds)
}

fn set_time(time: Option<TimeOrNow>) -> SetTime {
    let time = match time {
        None => return SetTime::Keep,
        Some(TimeOrNow::Now) => return SetTime::Now,
        Some(TimeOrNow::SpecificTime(time)) => time,
    };
    match time.duration_since(SystemTime::UNIX_EPOCH) {
        Ok(since) => SetTime::At {
            s: since.as_secs(),
            ns: since.subsec_nanos(),
        },
        Err(before) => {
            let before = before.duration();
            let borrow = u64::from(before.subsec_nanos() > 0);
            SetTime::At {
                s: before.as_secs().wrapping_add(borrow).wrapping_neg(),
                ns: (1_000_000_000 - before.subsec_nanos()) % 1_000_000_000,
            }
        }
    }
}

fn errno(error: FileError) -> Errno {
    if error.errno().is_none() {
        eprintln!("condor-suites: {error}");
    }
    error
        .errno()
        .map_or(Errno::EIO, |errno| Errno::from_i32(errno.0.into()))
}

/// Converts the flags of `open(2)`.
fn options(flags: i32) -> OpenOptions {
    let mut options = OpenOptions::new();
    let access = flags & libc::O_ACCMODE;
    if access != libc::O_WRONLY {
        options = options.read();
    }
    if access != libc::O_RDONLY {
        options = options.write();
        if flags & libc::O_APPEND != 0 {
            options = options.append();
        }
        if flags & libc::O_TRUNC != 0 {
            options = options.truncate();
        }
    }
    if flags & libc::O_CREAT != 0 {
        options = options.create();
        if flags & libc::O_EXCL != 0 {
            options = options.exclusive();
        }
    }
    options
}

/// Converts the mode of `fallocate(2)`.
fn allocation(mode: i32) -> Result<AllocationMode, Errno> {
    const PUNCH: i32 = libc::FALLOC_FL_PUNCH_HOLE | libc::FALLOC_FL_KEEP_SIZE;
    const ZERO_KEPT: i32 = libc::FALLOC_FL_ZERO_RANGE | libc::FALLOC_FL_KEEP_SIZE;
    match mode {
        0 => Ok(AllocationMode::Extend),
        libc::FALLOC_FL_KEEP_SIZE => Ok(AllocationMode::KeepSize),
        PUNCH => Ok(AllocationMode::PunchHole),
        libc::FALLOC_FL_ZERO_RANGE => Ok(AllocationMode::Zero),
        ZERO_KEPT => Ok(AllocationMode::ZeroKeepSize),
        _ => Err(UNSUPPORTED),
    }
}

/// Converts the type bits of `st_mode`, shifted right by 12.
fn kind(bits: u32) -> FileType {
    match bits {
        1 => FileType::NamedPipe,
        2 => FileType::CharDevice,
        4 => FileType::Directory,
        6 => FileType::BlockDevice,
        10 => FileType::Symlink,
        12 => FileType::Socket,
        _ => FileType::RegularFile,
    }
}

/// Answers with an entry or attributes.
macro_rules! tell {
    ($reply:expr, $answer:ident, $found:expr $(, $more:expr)*) => {
        match $found {
            Ok(attributes) => $reply.$answer(&TTL, &attributes $(, $more)*),
            Err(errno) => $reply.error(errno),
        }
    };
}

fn end(reply: ReplyEmpty, outcome: Result<(), Errno>) {
    match outcome {
        Ok(()) => reply.ok(),
        Err(errno) => reply.error(errno),
    }
}

impl Filesystem for Mount {
    fn init(&mut self, _: &Request, config: &mut KernelConfig) -> std::io::Result<()> {
        let mapped = InitFlags::FUSE_DIRECT_IO_ALLOW_MMAP;
        if config.add_capabilities(mapped).is_err() {
            self.direct = FopenFlags::empty();
        }
        Ok(())
    }

    fn lookup(&self, _: &Request, parent: INodeNo, name: &OsStr, reply: ReplyEntry) {
        let name = name.to_owned();
        self.ask(move |inner| {
            let found = inner
                .child(parent, &name)
                .and_then(|path| inner.entry(path));
            tell!(reply, entry, found, GENERATION);
        });
    }

    fn getattr(&self, _: &Request, node: INodeNo, _: Option<FileHandle>, reply: ReplyAttr) {
        self.ask(move |inner| {
            tell!(reply, attr, inner.attributes_of(node));
        });
    }

    fn setattr(
        &self,
        _: &Request,
        node: INodeNo,
        mode: Option<u32>,
        uid: Option<u32>,
        gid: Option<u32>,
        size: Option<u64>,
        accessed: Option<TimeOrNow>,
        modified: Option<TimeOrNow>,
        _: Option<SystemTime>,
        handle: Option<FileHandle>,
        _: Option<SystemTime>,
        _: Option<SystemTime>,
        _: Option<SystemTime>,
        _: Option<BsdFileFlags>,
        reply: ReplyAttr,
    ) {
        self.ask(move |inner| {
            let found = inner.attributes_of(node).and_then(|now| {
                // The owner that it has already, it can be given.
                if uid.is_some_and(|uid| uid != now.uid) || gid.is_some_and(|gid| gid != now.gid) {
                    return Err(UNSUPPORTED);
                }
                if let Some(mode) = mode {
                    inner.set_mode(node, handle, mode & 0o7777)?;
                }
                if let Some(size) = size {
                    inner.truncate(node, handle, size)?;
                }
                if accessed.is_some() || modified.is_some() {
                    let times = Times {
                        accessed: set_time(accessed),
                        modified: set_time(modified),
                    };
                    inner.set_times(node, handle, times)?;
                }
                inner.attributes_of(node)
            });
            tell!(reply, attr, found);
        });
    }

    fn mknod(
        &self,
        _: &Request,
        parent: INodeNo,
        name: &OsStr,
        mode: u32,
        _: u32,
        _: u32,
        reply: ReplyEntry,
    ) {
        let name = name.to_owned();
        self.ask(move |inner| {
            if kind(mode >> 12) != FileType::RegularFile {
                return reply.error(UNSUPPORTED);
            }
            let found = inner.child(parent, &name).and_then(|path| {
                let new = OpenOptions::new().write().exclusive().mode(mode & 0o7777);
                let file = inner.client.files.open(&path, new);
                file.and_then(condor_fs::File::close).map_err(errno)?;
                inner.entry(path)
            });
            tell!(reply, entry, found, GENERATION);
        });
    }

    fn mkdir(
        &self,
        _: &Request,
        parent: INodeNo,
        name: &OsStr,
        mode: u32,
        _: u32,
        reply: ReplyEntry,
    ) {
        let name = name.to_owned();
        self.ask(move |inner| {
            let found = inner.child(parent, &name).and_then(|path| {
                let files = inner.client.files;
                files
                    .make_directory_with(&path, mode & 0o7777)
                    .map_err(errno)?;
                inner.entry(path)
            });
            tell!(reply, entry, found, GENERATION);
        });
    }

    fn unlink(&self, _: &Request, parent: INodeNo, name: &OsStr, reply: ReplyEmpty) {
        let name = name.to_owned();
        self.ask(move |inner| {
            let outcome = inner.child(parent, &name).and_then(|path| {
                inner.client.files.unlink(&path).map_err(errno)?;
                inner.nodes.remove(&path);
                Ok(())
            });
            end(reply, outcome);
        });
    }

    fn rmdir(&self, _: &Request, parent: INodeNo, name: &OsStr, reply: ReplyEmpty) {
        let name = name.to_owned();
        self.ask(move |inner| {
            let outcome = inner.child(parent, &name).and_then(|path| {
                inner.client.files.remove_directory(&path).map_err(errno)?;
                inner.nodes.remove(&path);
                Ok(())
            });
            end(reply, outcome);
        });
    }

    fn symlink(&self, _: &Request, _: INodeNo, _: &OsStr, _: &Path, reply: ReplyEntry) {
        reply.error(UNSUPPORTED);
    }

    fn link(&self, _: &Request, _: INodeNo, _: INodeNo, _: &OsStr, reply: ReplyEntry) {
        reply.error(UNSUPPORTED);
    }

    fn rename(
        &self,
        _: &Request,
        parent: INodeNo,
        name: &OsStr,
        new_parent: INodeNo,
        new_name: &OsStr,
        flags: RenameFlags,
        reply: ReplyEmpty,
    ) {
        let name = name.to_owned();
        let new_name = new_name.to_owned();
        self.ask(move |inner| {
            let outcome = inner.child(parent, &name).and_then(|from| {
                let to = inner.child(new_parent, &new_name)?;
                let files = inner.client.files;
                let renamed = if flags.is_empty() {
                    files.rename(&from, &to)
                } else if flags == RenameFlags::RENAME_NOREPLACE {
                    files.rename_new(&from, &to)
                } else if flags == RenameFlags::RENAME_EXCHANGE {
                    files.exchange(&from, &to)
                } else {
                    return Err(Errno::EINVAL);
                };
                renamed.map_err(errno)?;
                if flags == RenameFlags::RENAME_EXCHANGE {
                    inner.nodes.exchange(&from, &to);
                } else {
                    inner.nodes.rename(&from, &to);
                }
                Ok(())
            });
            end(reply, outcome);
        });
    }

    fn create(
        &self,
        _: &Request,
        parent: INodeNo,
        name: &OsStr,
        mode: u32,
        _: u32,
        flags: i32,
        reply: ReplyCreate,
    ) {
        let name = name.to_owned();
        let direct = self.direct;
        self.ask(move |inner| {
            let opened = inner.child(parent, &name).and_then(|path| {
                // Its node has no number yet.
                let options = options(flags | libc::O_CREAT).mode(mode & 0o7777);
                let handle = inner.client.open(0, &path, options);
                let handle = handle.map_err(errno)?;
                let attributes = inner.entry(path)?;
                inner.client.opened(handle, attributes.ino.0);
                Ok((attributes, FileHandle(handle)))
            });
            match opened {
                Ok((attributes, handle)) => {
                    reply.created(&TTL, &attributes, GENERATION, handle, direct);
                }
                Err(errno) => reply.error(errno),
            }
        });
    }

    fn open(&self, _: &Request, node: INodeNo, flags: OpenFlags, reply: ReplyOpen) {
        let direct = self.direct;
        self.ask(move |inner| {
            let opened = inner
                .path(node)
                .and_then(|path| inner.open(node.0, &path, flags.0));
            match opened {
                Ok(handle) => reply.opened(handle, direct),
                Err(errno) => reply.error(errno),
            }
        });
    }

    fn read(
        &self,
        _: &Request,
        _: INodeNo,
        handle: FileHandle,
        at: u64,
        len: u32,
        _: OpenFlags,
        _: Option<LockOwner>,
        reply: ReplyData,
    ) {
        self.ask(move |inner| match inner.client.read(handle.0, at, len) {
            Ok(data) => reply.data(&data),
            Err(error) => reply.error(errno(error)),
        });
    }

    fn write(
        &self,
        _: &Request,
        _: INodeNo,
        handle: FileHandle,
        at: u64,
        data: &[u8],
        _: WriteFlags,
        _: OpenFlags,
        _: Option<LockOwner>,
        reply: ReplyWrite,
    ) {
        let data = data.to_vec();
        self.ask(move |inner| match inner.client.write(handle.0, at, &data) {
            Ok(len) => reply.written(len),
            Err(error) => reply.error(errno(error)),
        });
    }

    fn flush(&self, _: &Request, _: INodeNo, _: FileHandle, _: LockOwner, reply: ReplyEmpty) {
        reply.ok();
    }

    fn fsync(&self, _: &Request, _: INodeNo, handle: FileHandle, _: bool, reply: ReplyEmpty) {
        self.ask(move |inner| {
            let file = inner.client.file(handle.0);
            end(reply, file.and_then(|file| file.sync()).map_err(errno));
        });
    }

    fn release(
        &self,
        _: &Request,
        _: INodeNo,
        handle: FileHandle,
        _: OpenFlags,
        _: Option<LockOwner>,
        _: bool,
        reply: ReplyEmpty,
    ) {
        self.ask(move |inner| {
            end(reply, inner.client.close(handle.0).map_err(errno));
        });
    }

    fn fsyncdir(&self, _: &Request, node: INodeNo, _: FileHandle, _: bool, reply: ReplyEmpty) {
        self.ask(move |inner| {
            let outcome = inner.path(node).and_then(|path| {
                let directory = inner.client.files.open_directory(path).map_err(errno)?;
                directory.sync().map_err(errno)?;
                directory.close().map_err(errno)
            });
            end(reply, outcome);
        });
    }

    fn fallocate(
        &self,
        _: &Request,
        _: INodeNo,
        handle: FileHandle,
        at: u64,
        len: u64,
        mode: i32,
        reply: ReplyEmpty,
    ) {
        self.ask(move |inner| {
            let outcome = allocation(mode).and_then(|what| {
                let file = inner.client.file(handle.0);
                file.and_then(|file| file.allocate(what, at, len))
                    .map_err(errno)
            });
            end(reply, outcome);
        });
    }

    fn lseek(
        &self,
        _: &Request,
        _: INodeNo,
        handle: FileHandle,
        at: i64,
        whence: i32,
        reply: ReplyLseek,
    ) {
        self.ask(move |inner| {
            let found = u64::try_from(at).map_err(|_| Errno::ENXIO).and_then(|at| {
                let file = inner.client.file(handle.0).map_err(errno)?;
                // The others the kernel does itself.
                let found = match whence {
                    libc::SEEK_DATA => file.next_data(at),
                    libc::SEEK_HOLE => file.next_hole(at),
                    _ => return Err(Errno::EINVAL),
                };
                found.map_err(errno)?.ok_or(Errno::ENXIO)
            });
            match found {
                Ok(position) => reply.offset(position.cast_signed()),
                Err(errno) => reply.error(errno),
            }
        });
    }

    fn statfs(&self, _: &Request, _: INodeNo, reply: ReplyStatfs) {
        self.ask(move |inner| match inner.client.files.space() {
            Ok(space) => reply.statfs(
                space.blocks,
                space.free,
                space.available,
                space.files,
                space.free_files,
                space.block_bytes as u32,
                space.name_bytes,
                space.block_bytes as u32,
            ),
            Err(error) => reply.error(errno(error)),
        });
    }

    fn opendir(&self, _: &Request, _: INodeNo, _: OpenFlags, reply: ReplyOpen) {
        self.ask(move |inner| {
            inner.last_directory += 1;
            reply.opened(FileHandle(inner.last_directory), FopenFlags::empty());
        });
    }

    fn readdir(
        &self,
        _: &Request,
        node: INodeNo,
        handle: FileHandle,
        from: u64,
        mut reply: ReplyDirectory,
    ) {
        self.ask(move |inner| {
            if from == 0 {
                let read = inner.path(node).and_then(|path| {
                    let own = [b".", &b".."[..]].map(|name| (name.to_vec(), 4));
                    let read = inner.client.entries(&path).map_err(errno)?;
                    Ok(own.into_iter().chain(read).collect())
                });
                match read {
                    Ok(entries) => inner.directories.insert(handle.0, entries),
                    Err(errno) => return reply.error(errno),
                };
            }
            let entries = inner.directories.get(&handle.0);
            let entries = (1..).zip(entries.into_iter().flatten());
            for (next, (name, bits)) in entries.skip(from as usize) {
                // The number is looked up with the attributes.
                let full = reply.add(
                    INodeNo(u64::MAX),
                    next,
                    kind(*bits),
                    OsStr::from_bytes(name),
                );
                if full {
                    break;
                }
            }
            reply.ok();
        });
    }

    fn releasedir(
        &self,
        _: &Request,
        _: INodeNo,
        handle: FileHandle,
        _: OpenFlags,
        reply: ReplyEmpty,
    ) {
        self.ask(move |inner| {
            inner.directories.remove(&handle.0);
            reply.ok();
        });
    }
}
