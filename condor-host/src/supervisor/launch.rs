//! [`Launch`]: whatever a processor's program runs on.

use core::fmt;
use std::os::fd::BorrowedFd;
use std::path::PathBuf;

use crate::harts::{ARGUMENT_BYTES, ImageError, MemoryError, cause_name};
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
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RunState {
    /// Nothing has been started.
    Idle,
    /// It runs.
    Runs,
    /// It has ended.
    Ended(Exit),
}

/// How a program ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Exit {
    /// With this status; 0 is success.
    Status(i32),
    /// By this signal.
    Signal(i32),
    /// By a trap that it does not handle.
    Fault {
        /// `mcause`.
        cause: u64,
        /// The instruction.
        pc: u64,
        /// `mtval`: the address, or the instruction.
        value: u64,
    },
    /// It was taken off its processor.
    Abandoned,
    /// It was to be taken off its processor, which does not answer.
    Unreachable,
    /// With the machine on whose processor it ran.
    MachineEnded,
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
            Self::Fault { cause, pc, value } => {
                let name = cause_name(*cause);
                write!(f, "{name} at {pc:#x}, value {value:#x}")
            }
            Self::Abandoned => f.write_str("killed: its hart is in the monitor again"),
            Self::Unreachable => f.write_str(
                "its hart does not come back to the monitor until `machine` is started again",
            ),
            Self::MachineEnded => f.write_str("its machine ended"),
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
    /// The processor belongs to a machine that is not on.
    #[error("its machine is not on, or its hart {hart} has not come up")]
    Off {
        /// Which hart.
        hart: u32,
    },
    /// The file is no program for a hart.
    #[error("{file:?} is no program for hart {hart}: {source}")]
    Image {
        /// Which hart.
        hart: u32,
        /// The file.
        file: PathBuf,
        /// What is wrong with it.
        source: ImageError,
    },
    /// More arguments than a hart takes.
    #[error(
        "the arguments have {found} bytes, each with a zero after it, and a hart takes {ARGUMENT_BYTES}"
    )]
    Arguments {
        /// What they have.
        found: usize,
    },
    /// The memory of the machine.
    #[error(transparent)]
    Memory(#[from] MemoryError),
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
