//! [`Launch`]: whatever a processor's program runs on.

use core::fmt;
use std::os::fd::BorrowedFd;
use std::path::PathBuf;

use condor_rt::linux::Environment;

/// A processor as its supervisor handles it: a process of this machine, or a hart that is held in
/// reset while its memory is loaded, or a mapped device that another one controls.
///
/// # For implementers
///
/// Nothing here waits, or takes longer the more a program does: a supervisor looks after all processors in
/// one thread. A program goes
/// through `load`, `start`, and `stop` or an end of its own; then it can be started again as it
/// was, or another one be loaded. What was stopped says so by `state`.
pub trait Launch {
    /// Makes `image` the program that the next start runs: on a processor with a memory of its
    /// own, this is the download. The program before must not run any more.
    ///
    /// # Errors
    /// [`LaunchError`]; nothing is loaded then.
    fn load(&mut self, image: &Image) -> Result<(), LaunchError>;

    /// Checks whether `image` can be loaded when the program that runs has ended.
    ///
    /// # Errors
    /// Those of [`load`](Self::load) that are known before.
    fn check(&self, image: &Image) -> Result<(), LaunchError> {
        let _ = image;
        Ok(())
    }

    /// Starts what was loaded.
    ///
    /// # Errors
    /// [`LaunchError`].
    fn start(&mut self) -> Result<(), LaunchError>;

    /// Makes the program end; of one that does not run, nothing.
    ///
    /// # Errors
    /// [`LaunchError`].
    fn stop(&mut self, how: Stop) -> Result<(), LaunchError>;

    /// Whether a start can be made now: what the processor belongs to is on. A program that is to be
    /// started waits for that.
    fn is_ready(&self) -> bool {
        true
    }

    /// Whether the program runs.
    fn state(&mut self) -> RunState;

    /// A descriptor that is readable when the program has ended. Without one, `state` is looked at
    /// now and then.
    fn ended(&self) -> Option<BorrowedFd<'_>> {
        None
    }

    /// Lines that the program wrote for its supervisor; the terminal is not among them. Whoever writes
    /// more than a turn has time for is heard again in the next one. True if there may be more now.
    fn output(&mut self, line: &mut dyn FnMut(&str)) -> bool {
        let _ = line;
        false
    }

    /// A descriptor that is readable when there is more such output.
    fn has_output(&self) -> Option<BorrowedFd<'_>> {
        None
    }

    /// The process of this machine that runs the program, or stands for it.
    fn process(&self) -> Option<u32> {
        None
    }
}

/// A program with all that it is given.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Image {
    /// The file.
    pub file: PathBuf,
    /// What it is given.
    pub arguments: Vec<String>,
    /// Which processor it is, and what belongs to that.
    pub environment: Environment,
}

impl Image {
    /// The program in `file`, with what it is given.
    #[must_use]
    pub const fn new(file: PathBuf, arguments: Vec<String>, environment: Environment) -> Self {
        Self {
            file,
            arguments,
            environment,
        }
    }
}

/// How a program is made to end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// It is told to, and may put things in order.
    Ask,
    /// It is not asked.
    Force,
}

/// Whether a program runs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum RunState {
    /// Nothing has been started.
    Idle,
    /// It runs.
    Runs,
    /// It has ended.
    Ended(Exit),
}

/// How a program ended.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Exit {
    /// With this status; 0 is success.
    Status(i32),
    /// By this signal.
    Signal(i32),
    /// With what it ran on.
    Lost,
    /// In another way, in words.
    Other(String),
    /// Nobody can say.
    Unknown,
}

impl fmt::Display for Exit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Status(status) => write!(f, "exit status {status}"),
            Self::Signal(number) => match signal_hook::low_level::signal_name(*number) {
                Some(name) => write!(f, "killed by {name}"),
                None => write!(f, "killed by signal {number}"),
            },
            Self::Lost => f.write_str("what it ran on ended"),
            Self::Other(how) => f.write_str(how),
            Self::Unknown => f.write_str("ended, nobody knows how"),
        }
    }
}

/// Why a processor does not do what it is told.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LaunchError {
    /// Nothing has been loaded.
    #[error("no program has been loaded")]
    NotLoaded,
    /// The program of before runs.
    #[error("its program runs")]
    Runs,
    /// What an extension says.
    #[error(transparent)]
    Other(Box<dyn core::error::Error + Send + Sync>),
    /// The operating system refuses.
    #[error("cannot {doing} {file:?}: {source}")]
    Os {
        /// What was tried.
        doing: &'static str,
        /// The program.
        file: PathBuf,
        /// The answer.
        source: std::io::Error,
    },
}
