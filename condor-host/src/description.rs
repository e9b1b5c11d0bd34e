//! The description of a system: a TOML file that says which programs run on which processors.
//!
//! | key | is | default |
//! |---|---|---|
//! | `name` | the name of the system, which its running directory has, too | |
//! | `window_bytes` | users' memory of each processor, a multiple of 4096 | |
//! | `robot` | the file with the robot's configuration, for programs that need one | none |
//! | `[bus]` `bytes` | the size of the file that all programs map as their bus, a multiple of 4096 | no bus |
//! | `[shared_memory]` `bytes` | the size of a memory that belongs to no processor and that all reach, a multiple of 4096 | none |
//! | `[…]` | the table of an [extension](crate::extension) | none |
//! | `[files]` `root` | the directory that is served, made if there is none | nothing is served |
//! | `[files]` `read_only`, `quota_bytes`, `max_file_bytes` | what the programs may do there | everything |
//! | `[terminals]` `replay_bytes` | how much of a terminal's past who attaches is shown | 65536 |
//! | `[terminals]` `log_bytes` | the size from which a terminal's log is kept as the old one, in the place of the old one of before, and a new one begins; not less than `replay_bytes` | 4194304 |
//! | `[services]` `restarts` | restarts of a service in a minute, or in a row without that it joined, after which it has failed for good | 20 |
//! | `[[processors]]` | the programs, in the order in which they are started | |
//!
//! | key of a processor | is | default |
//! |---|---|---|
//! | `number` | 0 to 11 | |
//! | `name` | what commands call it | |
//! | `program` | `"self"` for one of the program's own, or a file | |
//! | `arguments` | what the program is given | `[]` |
//! | `headless` | lines that are typed at its terminal when all programs run, without user interface | `[]` |
//! | `kind` | what the processor is: `"process"` of this machine, or the kind of an extension | `"process"` |
//! | `loops` | how servo loops run: in `"threads"`, in `"signals"` if the program allows it, or `"spin"` (see [`condor_rt::linux`]) | `"threads"` |
//! | `cpu` | the CPU that the process keeps to | any |
//! | `priority` | of `SCHED_FIFO`, 1 to 99 | no real-time scheduling |
//! | `on_failure` | `"restart"`, `"stop"` the whole system, or `"leave"` it as it is | `"restart"` |
//! | `restarts` | restarts in a minute, or in a row without that it joined, after which it has failed for good | 10 |
//! | `stall_seconds` | how long a heart may stand still before that is a failure; 0: for ever | 5 |
//!
//! `loops`, `cpu` and `priority` are for processes alone; other kinds have keys of their own.
//!
//! Paths are relative to the description. A program is looked for there, then beside the running
//! program, then in `PATH`.

mod check;
mod mistake;
mod read;
mod tree;

use std::path::PathBuf;

use crate::extension::Group;

pub use check::find_program;
pub use mistake::{Mistake, Mistakes, Problem};
pub use read::beside;
pub use tree::{At, Keys};

/// A system that passed every check.
#[derive(Debug)]
pub struct Description {
    /// The file that it was read from.
    pub file: PathBuf,
    /// What the system is called.
    pub name: String,
    /// Users' memory of each processor, in bytes.
    pub window_bytes: u32,
    /// The configuration of the robot.
    pub robot: Option<PathBuf>,
    /// Bytes of the bus on which the boards are, if there is one.
    pub bus_bytes: Option<u32>,
    /// Bytes of the memory that belongs to no processor, if there is one.
    pub shared_bytes: Option<u32>,
    /// What the file service serves.
    pub files: Option<Files>,
    /// How terminals are shown.
    pub terminals: Terminals,
    /// Restarts of a service in a minute after which it has failed for good.
    pub service_restarts: u32,
    /// The processors, in the order in which they are started.
    pub processors: Vec<ProcessorEntry>,
    /// What extensions have in the system, in the order of the application.
    pub(crate) groups: Vec<Entry>,
}

/// What an extension has in the system.
#[derive(Debug)]
pub(crate) struct Entry {
    /// The processors of this kind.
    pub(crate) kind: Option<&'static str>,
    /// The name of the service.
    pub(crate) service: Option<&'static str>,
    pub(crate) group: Box<dyn Group>,
}

/// What the file service serves.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Files {
    /// The directory.
    pub root: PathBuf,
    /// Whether nothing in it can be changed.
    pub read_only: bool,
    /// The most bytes that all files together may have.
    pub quota_bytes: Option<u64>,
    /// The most bytes that one file may have.
    pub max_file_bytes: Option<u64>,
}

/// How terminals are shown.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Terminals {
    /// How many bytes of a terminal's past who attaches is shown.
    pub replay_bytes: u32,
    /// From how many bytes on a log is kept as the old one, and a new one begins.
    pub log_bytes: u32,
}

impl Default for Terminals {
    fn default() -> Self {
        Self {
            replay_bytes: 64 * 1024,
            log_bytes: 4 * 1024 * 1024,
        }
    }
}

/// A processor and its program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ProcessorEntry {
    /// Its number, 0 to 11.
    pub number: u8,
    /// What commands call it.
    pub name: String,
    /// What runs on it.
    pub program: ProgramEntry,
    /// What the program is given.
    pub arguments: Vec<String>,
    /// What is typed at its terminal, line by line, when all programs run and nobody else is to type.
    pub headless: Vec<String>,
    /// What the processor is.
    pub kind: &'static str,
    /// Whether its programs run on this machine.
    pub runs_here: bool,
    /// What follows when its program fails.
    pub on_failure: OnFailure,
    /// Restarts in a minute after which it has failed for good.
    pub restarts: u32,
    /// Seconds that its heart may stand still before that is a failure; 0: for ever.
    pub stall_seconds: u32,
}

/// What runs on a processor.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ProgramEntry {
    /// One of the running program's own, named by the first argument.
    Own,
    /// The program in this file.
    File(PathBuf),
}

/// What follows when a program fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum OnFailure {
    /// It is started again.
    Restart,
    /// The whole system is stopped.
    Stop,
    /// Nothing.
    Leave,
}
