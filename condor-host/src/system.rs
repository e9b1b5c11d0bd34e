//! Running systems of this user, and their directories.
//!
//! A system that runs has the directory `$XDG_RUNTIME_DIR/condor/NAME`, or, without that variable,
//! `/dev/shm/condor-UID/NAME`. In it are
//!
//! | file | |
//! |---|---|
//! | `mailbox/` | the windows, as [`condor_mbox::linux::System::at`] has them |
//! | `bus` | the file that all programs map as their bus |
//! | `shared` | the memory that belongs to no processor |
//! | others | what an [extension](crate::extension) has made, such as the memory of a machine of harts |
//! | `control` | the socket of the [control protocol](crate::control) |
//! | `lock` | locked (`flock`) by the supervisor as long as it lives |
//! | `pids` | the supervisor's process, then those that it started |
//! | `log` | what happened, with times; `log.old` is that of the run before, or what was in the log when it had 1 MiB |
//! | `tty/` | the terminals, see [`services`](crate::services) |

use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};

use condor_mbox::linux::SystemError;

use crate::control::client::connect;
use condor_rt::numbers::PROCESSORS;

/// Why a system is not found.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FindError {
    /// None of that name runs.
    #[error("no system `{name}` is running; {}", Running(running))]
    NotRunning {
        /// The name.
        name: String,
        /// Those that run.
        running: Vec<String>,
    },
    /// None runs.
    #[error("no system is running; `{} up` starts one", crate::cli::me())]
    NoneRunning,
    /// Several run.
    #[error("several systems are running, name one: {}", running.join(", "))]
    SeveralRunning {
        /// Their names.
        running: Vec<String>,
    },
    /// The directory of all systems.
    #[error("cannot {doing} {path:?}: {source}")]
    Directory {
        /// What was tried.
        doing: &'static str,
        /// With which directory.
        path: PathBuf,
        /// The answer.
        source: std::io::Error,
    },
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

/// The directory of a system, which may run or not.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SystemDirectory(PathBuf);

impl SystemDirectory {
    /// That of the system `name` of this user, which is made if there is none.
    ///
    /// # Errors
    /// [`FindError::Directory`], also if another user has it.
    pub fn of(name: &str) -> Result<Self, FindError> {
        let path = all()?.join(name);
        private(&path)?;
        Ok(Self(path))
    }

    /// The one at `path`, which some supervisor has made.
    #[must_use]
    pub const fn at(path: PathBuf) -> Self {
        Self(path)
    }

    /// The directory.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.0
    }

    /// The name of the system.
    #[must_use]
    pub fn name(&self) -> String {
        let name = self.0.file_name().unwrap_or_default();
        name.to_string_lossy().into_owned()
    }

    /// Where the windows are.
    #[must_use]
    pub fn mailbox(&self) -> PathBuf {
        self.0.join("mailbox")
    }

    /// The file that is the memory which belongs to no processor.
    #[must_use]
    pub fn shared_memory(&self) -> PathBuf {
        self.0.join("shared")
    }

    /// The file that is the bus.
    #[must_use]
    pub fn bus(&self) -> PathBuf {
        self.0.join("bus")
    }

    /// The socket of the control protocol.
    #[must_use]
    pub fn control(&self) -> PathBuf {
        self.0.join("control")
    }

    /// What the supervisor locks.
    #[must_use]
    pub fn lock(&self) -> PathBuf {
        self.0.join("lock")
    }

    /// What happened.
    #[must_use]
    pub fn log(&self) -> PathBuf {
        self.0.join("log")
    }

    /// Which processes belong to the system.
    #[must_use]
    pub fn pids(&self) -> PathBuf {
        self.0.join("pids")
    }

    /// Where the terminals are.
    #[must_use]
    pub fn terminals(&self) -> PathBuf {
        self.0.join("tty")
    }

    /// The socket of the terminal of the processor `name`.
    #[must_use]
    pub fn terminal(&self, name: &str) -> PathBuf {
        self.terminals().join(format!("{name}.sock"))
    }

    /// The windows of the system, all of `window_bytes` users' bytes.
    ///
    /// # Errors
    /// As [`condor_mbox::linux::System::at`].
    pub fn system(&self, window_bytes: u32) -> Result<Windows, SystemError> {
        Windows::at(self.mailbox(), window_bytes)
    }

    /// Whether its supervisor takes connections.
    #[must_use]
    pub fn is_running(&self) -> bool {
        connect(&self.control()).is_ok()
    }
}

/// The windows of a system.
pub type Windows = condor_mbox::linux::System<PROCESSORS>;

/// The running system `name`, or the only one that runs.
///
/// # Errors
/// [`FindError`].
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

/// The running systems of this user, by name.
///
/// # Errors
/// [`FindError::Directory`].
pub fn running() -> Result<Vec<SystemDirectory>, FindError> {
    let path = all()?;
    let at = |source| FindError::Directory {
        doing: "read",
        path: path.clone(),
        source,
    };
    let mut running = Vec::new();
    for entry in std::fs::read_dir(&path).map_err(at)? {
        let directory = SystemDirectory(entry.map_err(at)?.path());
        if directory.is_running() {
            running.push(directory);
        }
    }
    running.sort_by_key(SystemDirectory::name);
    Ok(running)
}

/// The directory that has those of all systems.
fn all() -> Result<PathBuf, FindError> {
    let user = rustix::process::getuid().as_raw();
    let runtime = std::env::var_os("XDG_RUNTIME_DIR").filter(|path| Path::new(path).is_dir());
    let path = match runtime {
        Some(runtime) => Path::new(&runtime).join("condor"),
        None => PathBuf::from(format!("/dev/shm/condor-{user}")),
    };
    private(&path)?;
    Ok(path)
}

/// Makes a directory that is this user's alone, and makes sure that it is.
fn private(path: &Path) -> Result<(), FindError> {
    let at = |doing| {
        move |source| FindError::Directory {
            doing,
            path: path.into(),
            source,
        }
    };
    match std::fs::DirBuilder::new().mode(0o700).create(path) {
        Err(error) if error.kind() != std::io::ErrorKind::AlreadyExists => {
            return Err(at("make")(error));
        }
        _ => {}
    }
    let metadata = std::fs::symlink_metadata(path).map_err(at("look at"))?;
    if metadata.is_dir() && metadata.uid() == rustix::process::getuid().as_raw() {
        return Ok(());
    }
    let reason = "it is no directory of this user";
    Err(at("use")(std::io::Error::other(reason)))
}
