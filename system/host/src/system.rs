//! Running systems of this user, and their directories.
//!
//! A running system has the directory `$XDG_RUNTIME_DIR/condor/NAME`, or, without that variable,
//! `/dev/shm/condor-UID/NAME`. It contains:
//!
//! | file | purpose |
//! |---|---|
//! | `mailbox/` | has the windows, as in [`condor_mbox::linux::LinuxSystem::at`] |
//! | `bus` | is the file that all programs map as their bus |
//! | `shared` | is the memory that belongs to no processor |
//! | `clock` | says in which file the page of the simulated clock is: in `clock.page`, or in the memory of an extension |
//! | others | are made by an [extension](crate::extension), such as the memory of a machine of harts |
//! | `typing` | is the record of the characters that are typed in simulated time, see [`Script`](crate::services::terminals::Script); that of the last run stays |
//! | `replay` | is the record that is typed again |
//! | `control` | is the socket of the [control protocol](crate::control) |
//! | `lock` | is locked (`flock`) by the supervisor as long as it runs |
//! | `pids` | lists the supervisor's process, and then those that it started |
//! | `log` | lists events with their times; `log.old` is the log of the previous run, or of this run before the log reached 1 MiB |
//! | `ui` | has the choices that a person has made in the user interface; it stays |
//! | `tty/` | has the terminals, see [`services`](crate::services) |

use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::Duration;

use condor_mbox::linux::SystemError;
use rustix::net::sockopt::{Timeout, set_socket_timeout};
use rustix::net::{AddressFamily, SocketAddrUnix, SocketFlags, SocketType};

pub use crate::error::NamedFileError;
use crate::error::me;
use condor_rt::linux::{FileRange, MappedPage, ProcessError};
use condor_rt::numbers::PROCESSORS;

/// The time that a supervisor may take to answer a request that it answers at once.
pub(crate) const ANSWER: Duration = Duration::from_secs(15);

/// The reason why [`find`] returns no running system.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FindError {
    /// No system of that name runs.
    #[error("no system `{name}` is running; {}", Running(running))]
    NotRunning {
        /// The name that was asked for.
        name: String,
        /// The names of the running systems.
        running: Vec<String>,
    },
    /// No system runs.
    #[error("no system is running; `{} up` starts one", me())]
    NoneRunning,
    /// Several systems run, and none was named.
    #[error("several systems are running; name one with --system: {}", running.join(", "))]
    SeveralRunning {
        /// The names of the running systems.
        running: Vec<String>,
    },
    /// The system has no processor, or service, of this name or number.
    #[error("there is no processor `{name}`; there are {}", there.join(", "))]
    NoMember {
        /// The name or number that was asked for.
        name: String,
        /// The names and numbers that there are.
        there: Vec<String>,
    },
    /// The directory of all systems cannot be used.
    #[error(transparent)]
    Directory(#[from] NamedFileError),
}

struct Running<'a>(&'a [String]);

impl core::fmt::Display for Running<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self.0 {
            [] => f.write_str("none is"),
            names => write!(f, "there are {}", names.join(", ")),
        }
    }
}

/// The directory with the files of a system, such as its log and its sockets. The system need not be running.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SystemDirectory(PathBuf);

impl SystemDirectory {
    /// Returns the directory of the system `name` of this user. Makes the directory if it does not exist.
    ///
    /// # Errors
    /// Returns [`NamedFileError`] if the directory cannot be made, or belongs to another user.
    pub fn of(name: &str) -> Result<Self, NamedFileError> {
        let path = all()?.join(name);
        private(&path)?;
        Ok(Self(path))
    }

    /// Returns the directory at `path`, which a supervisor has made. The directory is neither checked nor made.
    #[must_use]
    pub const fn at(path: PathBuf) -> Self {
        Self(path)
    }

    /// Returns the path of the directory.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.0
    }

    /// Returns the name of the system, which is the last part of the path.
    #[must_use]
    pub fn name(&self) -> String {
        let name = self.0.file_name().unwrap_or_default();
        name.to_string_lossy().into_owned()
    }

    /// Returns the path of the directory of the windows, which are the memories that the processors share.
    #[must_use]
    pub fn mailbox(&self) -> PathBuf {
        self.0.join("mailbox")
    }

    /// Returns the path of the file with the shared memory that belongs to no processor.
    #[must_use]
    pub fn shared_memory(&self) -> PathBuf {
        self.0.join("shared")
    }

    /// Returns the path of the file that programs map as their bus, by which they reach the boards.
    #[must_use]
    pub fn bus(&self) -> PathBuf {
        self.0.join("bus")
    }

    /// Returns the path of a small file that names the memory in which the simulated clock keeps its state. That memory
    /// is called the page of the clock; [`clock_page`](Self::clock_page) opens it.
    #[must_use]
    pub fn clock(&self) -> PathBuf {
        self.0.join("clock")
    }

    /// Opens the page of the simulated clock, the memory in which that clock keeps its state. Returns `None` if the
    /// system runs by the real clock.
    ///
    /// # Errors
    /// [`ProcessError`] if there is a page but it cannot be mapped, or has another version.
    pub fn clock_page(&self) -> Result<Option<MappedPage>, ProcessError> {
        let text = std::fs::read_to_string(self.clock());
        let place = text.ok().and_then(|text| serde_json::from_str(&text).ok());
        let place: Option<FileRange> = place;
        place.as_ref().map(MappedPage::open).transpose()
    }

    /// Returns the path of the record of the characters that people type while the system runs in simulated time: see
    /// [`Script`](crate::services::terminals::Script).
    #[must_use]
    pub fn typing(&self) -> PathBuf {
        self.0.join("typing")
    }

    /// Returns the path of the record that is typed again.
    pub(crate) fn replay(&self) -> PathBuf {
        self.0.join("replay")
    }

    /// Returns the path of the socket at which the supervisor accepts [requests](crate::control).
    #[must_use]
    pub fn control(&self) -> PathBuf {
        self.0.join("control")
    }

    /// Returns the path of the file that the supervisor keeps locked as long as it runs.
    #[must_use]
    pub fn lock(&self) -> PathBuf {
        self.0.join("lock")
    }

    /// Returns the path of the log, a text file with a line for each event of the system.
    #[must_use]
    pub fn log(&self) -> PathBuf {
        self.0.join("log")
    }

    /// Returns the path of the file with the process ids of the supervisor and of the processes that it started.
    #[must_use]
    pub fn pids(&self) -> PathBuf {
        self.0.join("pids")
    }

    /// Returns the path of the directory with the sockets and the logs of the processors' terminals.
    #[must_use]
    pub fn terminals(&self) -> PathBuf {
        self.0.join("tty")
    }

    /// Returns the path of the socket of the terminal of the processor `name`.
    #[must_use]
    pub fn terminal(&self, name: &str) -> PathBuf {
        self.terminals().join(format!("{name}.sock"))
    }

    /// Opens the windows of the system, which are the memories that its processors share. `window_bytes` is the size of
    /// the users' region of each processor's `data`, in bytes: see
    /// [`SystemStatus`](crate::control::SystemStatus::window_bytes).
    ///
    /// # Errors
    /// Returns [`SystemError::BadDataSize`] if `window_bytes` is not a whole number of words,
    /// [`SystemError::OtherSystem`] if the windows have another size, [`SystemError::Os`] if the operating system
    /// refuses.
    pub fn system(&self, window_bytes: u32) -> Result<SystemWindows, SystemError> {
        SystemWindows::at(self.mailbox(), window_bytes)
    }

    /// Returns true if the supervisor of the system accepts connections.
    #[must_use]
    pub fn is_running(&self) -> bool {
        self.connect().is_ok()
    }

    /// Connects to its supervisor, which may be stopped, and take no connection.
    pub(crate) fn connect(&self) -> Result<UnixStream, NamedFileError> {
        let path = self.control();
        connect(&path).map_err(|error| NamedFileError::at("connect to", path)(error.into()))
    }
}

fn connect(path: &Path) -> rustix::io::Result<UnixStream> {
    let flags = SocketFlags::CLOEXEC;
    let socket = rustix::net::socket_with(AddressFamily::UNIX, SocketType::STREAM, flags, None)?;
    // This one bounds the wait for room among those that are not taken yet, too.
    set_socket_timeout(&socket, Timeout::Send, Some(ANSWER))?;
    rustix::net::connect(&socket, &SocketAddrUnix::new(path)?)?;
    Ok(socket.into())
}

/// The windows of a system, which are the memories that its processors share.
pub type SystemWindows = condor_mbox::linux::LinuxSystem<PROCESSORS>;

/// Returns the directory of the running system `name`. Without a name, returns that of the only system that runs.
///
/// # Errors
/// [`FindError::NotRunning`] if no system of that name runs, [`FindError::NoneRunning`] or
/// [`FindError::SeveralRunning`] if there is no name and not exactly one system,
/// [`FindError::Directory`] if the directory cannot be used.
pub fn find(name: Option<&str>) -> Result<SystemDirectory, FindError> {
    let mut running = running()?;
    let names = |running: &[SystemDirectory]| running.iter().map(SystemDirectory::name).collect();
    if let Some(name) = name {
        let place = running
            .iter()
            .position(|directory| directory.name() == name);
        return place
            .map(|place| running.swap_remove(place))
            .ok_or_else(|| FindError::NotRunning {
                name: name.into(),
                running: names(&running),
            });
    }
    match (running.pop(), running.is_empty()) {
        (None, _) => Err(FindError::NoneRunning),
        (Some(only), true) => Ok(only),
        (Some(last), false) => {
            running.push(last);
            let running = names(&running);
            Err(FindError::SeveralRunning { running })
        }
    }
}

/// Returns the directories of all running systems of this user, sorted by name.
///
/// # Errors
/// [`NamedFileError`] if the directory of all systems cannot be read.
pub fn running() -> Result<Vec<SystemDirectory>, NamedFileError> {
    let path = all()?;
    let mut running = Vec::new();
    for entry in std::fs::read_dir(&path).map_err(NamedFileError::at("read", &path))? {
        let directory = SystemDirectory(entry.map_err(NamedFileError::at("read", &path))?.path());
        if directory.is_running() {
            running.push(directory);
        }
    }
    running.sort_by_key(SystemDirectory::name);
    Ok(running)
}

/// The directory that has those of all systems.
fn all() -> Result<PathBuf, NamedFileError> {
    let user = rustix::process::getuid().as_raw();
    let runtime = std::env::var_os("XDG_RUNTIME_DIR").filter(|path| {
        // A relative one is another directory for each program, and counts as missing.
        Path::new(path).is_absolute() && Path::new(path).is_dir()
    });
    let path = match runtime {
        Some(runtime) => Path::new(&runtime).join("condor"),
        None => PathBuf::from(format!("/dev/shm/condor-{user}")),
    };
    private(&path)?;
    Ok(path)
}

/// Makes a directory that is this user's alone, and makes sure that it is.
fn private(path: &Path) -> Result<(), NamedFileError> {
    match std::fs::DirBuilder::new().mode(0o700).create(path) {
        Err(error) if error.kind() != std::io::ErrorKind::AlreadyExists => {
            return Err(NamedFileError::at("make", path)(error));
        }
        _ => {}
    }
    let metadata = std::fs::symlink_metadata(path).map_err(NamedFileError::at("look at", path))?;
    if metadata.is_dir() && metadata.uid() == rustix::process::getuid().as_raw() {
        return Ok(());
    }
    let reason = "it is no directory of this user";
    Err(NamedFileError::at("use", path)(std::io::Error::other(
        reason,
    )))
}

/// Writes a file that replaces a former one in one step: whoever reads it finds the former text or this one. Nobody
/// waits for the disk, so a loss of power may leave either, or none.
pub(crate) fn replace(path: &Path, text: &str) -> std::io::Result<()> {
    let part = path.with_extension("part");
    std::fs::write(&part, text)?;
    std::fs::rename(part, path)
}
