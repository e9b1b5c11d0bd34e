//! Operations on permissions and times, and on the capacity of the filesystem.

use std::os::fd::OwnedFd;

use rustix::fs::{AtFlags, CWD, Mode, Timespec, Timestamps};

use super::error::Stop;
use super::log::Outcome;
use super::tree::{about, path_of};
use super::{FileServer, Job, Steps};
use crate::errno::Errno;
use crate::wire::{SetTime, Space, time};

/// All bits of a mode that can be set.
const ALL: u32 = 0o7777;
/// With these, a program of the host would run with the rights of the file's owner: the server.
const SET_ID: u32 = 0o6000;

impl<S: Steps> FileServer<S> {
    pub(super) fn file_mode(&self, job: &Job<'_>) -> Result<(), Stop> {
        let opened = self.opened(job)?;
        self.set_mode(job, &opened.file)
    }

    pub(super) fn path_mode(&self, job: &Job<'_>) -> Result<(), Stop> {
        let found = self.tree.find(&job.path(job.request.path)?)?;
        self.set_mode(job, &found)
    }

    pub(super) fn file_times(&self, job: &Job<'_>) -> Result<(), Stop> {
        let opened = self.opened(job)?;
        self.set_times(job, &opened.file)
    }

    pub(super) fn path_times(&self, job: &Job<'_>) -> Result<(), Stop> {
        let found = self.tree.find(&job.path(job.request.path)?)?;
        self.set_times(job, &found)
    }

    /// A repetition sets the same mode: the next incarnation does it before anybody else does something.
    fn set_mode(&self, job: &Job<'_>, of: &OwnedFd) -> Result<(), Stop> {
        self.check_writable(job)?;
        let is_file = about(of, c"")?.1.is_file();
        let mode = job.mode(is_file)?;
        self.begin(job)?;
        // By way of /proc: what was found by its path is not open.
        rustix::fs::chmod(path_of(of), Mode::from_raw_mode(mode))?;
        Ok(())
    }

    fn set_times(&self, job: &Job<'_>, of: &OwnedFd) -> Result<(), Stop> {
        self.check_writable(job)?;
        let times = job.request.times().ok_or(Errno::INVAL)?;
        let timestamps = Timestamps {
            last_access: timespec(times.accessed),
            last_modification: timespec(times.modified),
        };
        self.begin(job)?;
        rustix::fs::utimensat(CWD, path_of(of), &timestamps, AtFlags::empty())?;
        Ok(())
    }

    pub(super) fn space(&self) -> Result<Outcome, Stop> {
        let found = rustix::fs::fstatvfs(self.tree.root())?;
        let block_bytes = found.f_frsize.max(1);
        let of_quota = self.quota.left().map(|bytes| bytes / block_bytes);
        let space = Space {
            block_bytes,
            blocks: found.f_blocks,
            free: found.f_bfree,
            available: found.f_bavail.min(of_quota.unwrap_or(u64::MAX)),
            files: found.f_files,
            free_files: found.f_ffree,
            name_bytes: u32::try_from(found.f_namemax).unwrap_or(u32::MAX),
        };
        Ok(Outcome {
            space: Some(space),
            ..Outcome::default()
        })
    }
}

impl Job<'_> {
    /// The mode that the request has for a file or directory.
    pub(super) fn mode(&self, is_file: bool) -> Result<u32, Errno> {
        let mode = u32::try_from(self.request.position).map_err(|_| Errno::INVAL)?;
        if mode & !ALL != 0 {
            return Err(Errno::INVAL);
        }
        if is_file && mode & SET_ID != 0 {
            return Err(Errno::PERM);
        }
        Ok(mode)
    }
}

fn timespec(time: SetTime) -> Timespec {
    let (seconds, nanoseconds) = match time {
        SetTime::Keep => (0, time::KEEP),
        SetTime::Now => (0, time::NOW),
        SetTime::At { s, ns } => (s.cast_signed(), ns),
    };
    Timespec {
        tv_sec: seconds,
        tv_nsec: nanoseconds.into(),
    }
}
