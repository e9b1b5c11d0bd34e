//! [`Launch`]: the supervisor's control over the program of a processor.

pub(crate) mod process;

pub use process::ChildProcess;

use core::fmt;
use std::os::fd::BorrowedFd;
use std::path::PathBuf;

use condor_rt::linux::Environment;

use crate::error::NamedFileError;

/// A processor as its supervisor handles it: a process of this machine, a hart that is held in reset while its memory
/// is loaded, or a mapped device that another processor controls.
///
/// # For implementers
///
/// No method may wait, and no method may take longer if a program does more: a supervisor handles all processors in one
/// thread. A program goes through `load`, `start`, and then `stop` or its own end. After that, it can be started again
/// unchanged, or another one can be loaded. After `stop`, the supervisor polls `state` until it returns `Ended`.
pub trait Launch {
    /// Makes `image` the program for the next start. On a processor with its own memory, this
    /// downloads it. The previous program must not run any more.
    ///
    /// # Errors
    /// [`LaunchError::Runs`] if the previous program runs; otherwise the operating system or the
    /// extension has failed. Nothing is loaded then.
    fn load(&mut self, image: &ProgramImage) -> Result<(), LaunchError>;

    /// Checks whether `image` can be loaded after the running program has ended.
    ///
    /// # Errors
    /// The errors of [`load`](Self::load) that can be found before. The default finds none.
    fn check(&self, image: &ProgramImage) -> Result<(), LaunchError> {
        let _ = image;
        Ok(())
    }

    /// Starts the loaded program.
    ///
    /// # Errors
    /// [`LaunchError::NotLoaded`] if no program was loaded, [`LaunchError::Runs`] if it runs
    /// already; otherwise the operating system or the extension has failed.
    fn start(&mut self) -> Result<(), LaunchError>;

    /// Tells the program to end, or kills it; does nothing if it does not run.
    ///
    /// # Errors
    /// [`LaunchError`] if the program cannot be reached.
    fn stop(&mut self, how: StopMethod) -> Result<(), LaunchError>;

    /// Returns true if a program can be started now: false while the machine that has this
    /// processor is off. The supervisor waits until it is true.
    fn is_ready(&self) -> bool {
        true
    }

    /// Returns the state of the program.
    fn state(&mut self) -> RunState;

    /// Returns true if the program has stopped to wait for a debugger, or one holds it, apart from a debugger of this machine
    /// that traces its [`process`](Self::process).
    fn is_held(&self) -> bool {
        false
    }

    /// Returns a descriptor that becomes readable when the program has ended. With `None`, `state`
    /// is polled.
    fn ended(&self) -> Option<BorrowedFd<'_>> {
        None
    }

    /// Passes to `line` each line that the program wrote for its supervisor; the output of its
    /// terminal is not among them. Returns true if there may be more lines now. They are passed in
    /// the next call, so that a program that writes a lot does not hold up the others.
    fn output(&mut self, line: &mut dyn FnMut(&str)) -> bool {
        let _ = line;
        false
    }

    /// Returns a descriptor that becomes readable when there is more for [`output`](Self::output)
    /// to pass; `None` if there is no such descriptor.
    fn has_output(&self) -> Option<BorrowedFd<'_>> {
        None
    }

    /// Returns the process id of the process of this machine that runs the program, or represents
    /// it; `None` if there is none.
    fn process(&self) -> Option<u32> {
        None
    }
}

/// A program that [`Launch::load`] can load on a processor: its file, its arguments and its environment.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct ProgramImage {
    /// The file of the program.
    pub file: PathBuf,
    /// The arguments of the program.
    pub arguments: Vec<String>,
    /// The processor's number and its other settings.
    pub environment: Environment,
}

impl ProgramImage {
    /// Makes the image of the program in `file`, with its arguments and its environment.
    #[must_use]
    pub const fn new(file: PathBuf, arguments: Vec<String>, environment: Environment) -> Self {
        Self {
            file,
            arguments,
            environment,
        }
    }
}

/// The way in which [`Launch::stop`] ends a program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StopMethod {
    /// The program is asked to end, and may clean up.
    Ask,
    /// The program is killed.
    Force,
}

/// The state of the program of a processor, as [`Launch::state`] returns it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum RunState {
    /// No program has been started.
    Idle,
    /// The program runs.
    Runs,
    /// The program has ended.
    Ended(Exit),
}

/// The way in which a program has ended.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Exit {
    /// The program returned this exit status; 0 is success.
    Status(i32),
    /// This signal, by its number, killed the program.
    Signal(i32),
    /// The machine on which it ran, such as an emulator, has ended.
    Lost,
    /// The program ended in another way, which this text describes.
    Other(String),
    /// The way in which the program ended is not known.
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
            Self::Lost => f.write_str("the machine on which it ran ended"),
            Self::Other(how) => f.write_str(how),
            Self::Unknown => f.write_str("ended in an unknown way"),
        }
    }
}

/// The reason why a program cannot be loaded, started or stopped.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LaunchError {
    /// No program has been loaded.
    #[error("no program has been loaded yet; `load` loads one")]
    NotLoaded,
    /// The previous program still runs.
    #[error("the program of the processor is still running; stop it first")]
    Runs,
    /// An error of an extension.
    #[error(transparent)]
    Other(Box<dyn core::error::Error + Send + Sync>),
    /// The operating system refuses.
    #[error(transparent)]
    Os(#[from] NamedFileError),
}
