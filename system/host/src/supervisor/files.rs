//! The directory of a system, which its running supervisor holds.

use core::fmt::Write as _;
use std::fs::File;
use std::io::ErrorKind;
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};

use condor_mbox::linux::allocate;
use condor_platform::linux::{LOCK_PATIENCE, lock_file};
use condor_rt::linux::{FileRange, MappedPage};
use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::process::{Pid, PidfdFlags, Signal};

use super::UpError;
use super::stat::{self, started_at};
use crate::description::{ClockKind, SystemDescription};
use crate::error::NamedFileError;
use crate::extension::{StartingExtension, furnish};
use crate::system::{SystemDirectory, replace};

/// The directory, locked.
pub(super) struct RunDirectory {
    pub(super) directory: SystemDirectory,
    /// The kernel drops the lock with the file, however the supervisor ends.
    _lock: File,
}

/// The files that are made before programs start.
pub(super) struct SystemFiles {
    pub(super) listener: UnixListener,
    /// That of extensions, in the order of the description's groups.
    pub(super) groups: Vec<Box<dyn StartingExtension>>,
    pub(super) bus: Option<FileRange>,
    /// The memory that belongs to no processor.
    pub(super) shared: Option<FileRange>,
    /// The page of the simulated clock, if the system has one.
    pub(super) clock: Option<FileRange>,
}

/// The time that a process of the previous run may take to die, s.
const DYING_S: i64 = 10;

impl RunDirectory {
    /// Takes the directory of the system, and removes what a run before left there.
    pub(super) fn take(name: &str) -> Result<Self, UpError> {
        let directory = SystemDirectory::of(name)?;
        let path = directory.lock();
        let lock = File::options()
            .write(true)
            .create(true)
            .truncate(false)
            .open(&path)
            .map_err(NamedFileError::at("open", &path))?;
        let locked = lock_file(&lock, LOCK_PATIENCE);
        if !locked.map_err(|error| NamedFileError::at("lock", &path)(error.into()))? {
            return Err(UpError::RunsAlready {
                name: name.into(),
                process: supervisor(&directory),
            });
        }
        // Somebody may have removed the file that the running supervisor holds.
        if let Some(process) = supervisor(&directory) {
            return Err(UpError::RunsAlready {
                name: name.into(),
                process: Some(process),
            });
        }
        let place = Self {
            directory,
            _lock: lock,
        };
        place.end_leftovers()?;
        place.clear()?;
        Ok(place)
    }

    /// Waits until the processes of the run before, which die with their supervisor, have died.
    fn end_leftovers(&self) -> Result<(), UpError> {
        for (pid, started) in processes(&self.directory.pids()).skip(1) {
            let Some(process) = i32::try_from(pid).ok().and_then(Pid::from_raw) else {
                continue;
            };
            let Ok(pidfd) = rustix::process::pidfd_open(process, PidfdFlags::empty()) else {
                // The process has died, and may have left others in its group; but the number may have gone to
                // another process since, which has left a group, too.
                self.end_group(pid);
                continue;
            };
            // The descriptor holds the process; the number may have gone to another one before.
            if started_at(pid) != Some(started) {
                continue;
            }
            let _ = rustix::process::kill_process_group(process, Signal::KILL);
            // The process may have ended just now.
            let _ = rustix::process::pidfd_send_signal(&pidfd, Signal::KILL);
            let limit = Timespec {
                tv_sec: DYING_S,
                tv_nsec: 0,
            };
            let mut polled = [PollFd::new(&pidfd, PollFlags::IN)];
            if !matches!(rustix::event::poll(&mut polled, Some(&limit)), Ok(1..)) {
                return Err(UpError::Leftover { process: pid });
            }
        }
        Ok(())
    }

    /// Kills the processes of a group whose leader is gone, as far as their environment says that they
    /// come from a program of this system.
    fn end_group(&self, group: u32) {
        let mailbox = self.directory.mailbox();
        let Ok(members) = stat::group(group) else {
            return;
        };
        for member in members {
            let Ok(pidfd) = rustix::process::pidfd_open(member, PidfdFlags::empty()) else {
                continue;
            };
            // The descriptor holds the process of which this is read.
            if stat::has_in_environment(member, mailbox.as_os_str()) {
                let _ = rustix::process::pidfd_send_signal(&pidfd, Signal::KILL);
            }
        }
    }

    /// Removes everything but the lock and the log.
    fn clear(&self) -> Result<(), NamedFileError> {
        let directory = &self.directory;
        for path in [directory.mailbox(), directory.terminals()] {
            absent(std::fs::remove_dir_all(&path)).map_err(NamedFileError::at("remove", &path))?;
        }
        let typing = directory.typing();
        absent(std::fs::remove_file(&typing)).map_err(NamedFileError::at("remove", &typing))?;
        self.silence()
    }

    /// Removes everything but the lock, the logs, of the terminals too, the record of typing, and the choices in the
    /// user interface.
    pub(super) fn clear_but_logs(&self) -> Result<(), NamedFileError> {
        let path = self.directory.mailbox();
        absent(std::fs::remove_dir_all(&path)).map_err(NamedFileError::at("remove", &path))?;
        let path = self.directory.terminals();
        for entry in std::fs::read_dir(&path).map_err(NamedFileError::at("read", &path))? {
            let path = entry.map_err(NamedFileError::at("read", &path))?.path();
            if path.extension().is_none_or(|extension| extension != "log") {
                absent(std::fs::remove_file(&path)).map_err(NamedFileError::at("remove", &path))?;
            }
        }
        self.silence()
    }

    /// Removes what makes others believe that the system runs: all files but the lock, the logs, the
    /// record of typing, and the choices in the user interface.
    fn silence(&self) -> Result<(), NamedFileError> {
        let path = self.directory.path();
        for entry in std::fs::read_dir(path).map_err(NamedFileError::at("read", path))? {
            let entry = entry.map_err(NamedFileError::at("read", path))?;
            let name = entry.file_name();
            let stays = ["lock", "log", "log.old", "typing", "ui"]
                .iter()
                .any(|it| name == *it);
            let path = entry.path();
            if !stays && !path.is_dir() {
                absent(std::fs::remove_file(&path)).map_err(NamedFileError::at("remove", &path))?;
            }
        }
        Ok(())
    }

    /// Makes what the programs need before they start.
    pub(super) fn furnish(&self, description: &SystemDescription) -> Result<SystemFiles, UpError> {
        let directory = &self.directory;
        for path in [directory.mailbox(), directory.terminals()] {
            std::fs::create_dir(&path).map_err(NamedFileError::at("make", &path))?;
        }
        let groups = description.groups.iter();
        let groups = groups.map(|entry| (entry.name, &*entry.group));
        let groups = furnish(groups, directory).map_err(UpError::Prepare)?;
        let bus = groups.iter().find_map(|it| it.bus());
        let bus = memory(bus, description.bus_bytes, directory.bus())?;
        let shared = groups.iter().find_map(|it| it.shared_memory());
        let shared = memory(shared, description.shared_bytes, directory.shared_memory())?;
        let clock = match description.clock {
            ClockKind::Real => None,
            ClockKind::Simulated(_) => match groups.iter().find_map(|it| it.clock()) {
                Some(range) => Some(range),
                None => Some(page_file(directory)?),
            },
        };
        if let Some(files) = &description.files {
            std::fs::create_dir_all(&files.root)
                .map_err(NamedFileError::at("make", &files.root))?;
        }
        let path = directory.control();
        let listener = UnixListener::bind(&path).map_err(NamedFileError::at("listen at", &path))?;
        Ok(SystemFiles {
            listener,
            groups,
            bus,
            shared,
            clock,
        })
    }

    /// Notes which processes belong to the system, the supervisor first.
    pub(super) fn note_processes(
        &self,
        others: impl Iterator<Item = u32>,
    ) -> Result<(), NamedFileError> {
        let mut text = String::new();
        for pid in core::iter::once(std::process::id()).chain(others) {
            // One that has gone already needs no entry.
            if let Some(started) = started_at(pid) {
                // A string takes everything.
                let _ = writeln!(text, "{pid} {started}");
            }
        }
        let path = self.directory.pids();
        // The file is for the next supervisor if this one is killed. A loss of power ends all of these
        // processes, so nobody waits for the disk.
        replace(&path, &text).map_err(NamedFileError::at("write", &path))
    }
}

/// Returns the memory that an extension provides, or else makes the file for it.
fn memory(
    provided: Option<FileRange>,
    bytes: Option<u32>,
    path: PathBuf,
) -> Result<Option<FileRange>, NamedFileError> {
    let (None, Some(bytes)) = (&provided, bytes) else {
        return Ok(provided);
    };
    Ok(Some(allocated(path, bytes.into())?))
}

/// The file of a page that no extension provides.
fn page_file(directory: &SystemDirectory) -> Result<FileRange, NamedFileError> {
    let path = directory.clock().with_extension("page");
    allocated(path, MappedPage::BYTES.next_multiple_of(4096).into())
}

/// Makes a file of zeros whose memory is there from the beginning.
fn allocated(path: PathBuf, bytes: u64) -> Result<FileRange, NamedFileError> {
    let file = File::create_new(&path).map_err(NamedFileError::at("make", &path))?;
    allocate(&file, bytes).map_err(NamedFileError::at("find room for", &path))?;
    Ok(FileRange::whole(path))
}

/// Returns the process id of the supervisor that runs the system in `directory`; `None` if the system does not run, or
/// if this process is its supervisor.
#[must_use]
pub fn supervisor(directory: &SystemDirectory) -> Option<u32> {
    let (process, started) = processes(&directory.pids()).next()?;
    let is_other = process != std::process::id() && started_at(process) == Some(started);
    (is_other && !stat::has_ended(process)).then_some(process)
}

/// Process and time of its start, as the supervisor noted them.
fn processes(path: &Path) -> impl Iterator<Item = (u32, u64)> + use<> {
    let text = std::fs::read_to_string(path).unwrap_or_default();
    let entries: Vec<_> = text
        .lines()
        .filter_map(|line| {
            let (pid, started) = line.split_once(' ')?;
            Some((pid.parse().ok()?, started.parse().ok()?))
        })
        .collect();
    entries.into_iter()
}

fn absent(result: std::io::Result<()>) -> std::io::Result<()> {
    match result {
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(()),
        other => other,
    }
}
