//! The control socket of a running system: its protocol, and the [`Client`] that commands use.
//!
//! Requests and answers are JSON objects, one a line, over the Unix socket `control` in the
//! directory of the [system](crate::system). A request is answered when what it asks for has been
//! done: a `stop` when the program has ended, a `start` when it has joined. Several requests may be sent
//! without waiting; they are carried out one after the other.
//!
//! ```text
//! {"do":"stop","processor":"servo-a"}
//! {"ok":true}
//! {"do":"stop","processor":"servo-x"}
//! {"ok":false,"error":"there is no processor `servo-x`; there are master, servo-a"}
//! ```

pub(crate) mod client;
pub(crate) mod server;

pub use client::{Client, ClientError, Events};

use std::path::PathBuf;

use condor_mbox::Region;
use condor_mbox::linux::LinuxWindow;
use condor_rt::linux::{FileRange, ProcessError};
use serde::{Deserialize, Serialize};

/// What a supervisor is asked.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "do", rename_all = "lowercase", deny_unknown_fields)]
#[non_exhaustive]
pub enum Request {
    /// How the system is: [`Status`].
    Status {},
    /// Stops a processor or a service.
    Stop {
        /// Its name, or its number.
        processor: String,
    },
    /// Starts one that does not run.
    Start {
        /// Its name, or its number.
        processor: String,
    },
    /// Stops a processor, and starts it with another program.
    Load {
        /// Its name, or its number.
        processor: String,
        /// As in a description, relative to it; without it the same program, with other arguments.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        program: Option<String>,
        /// What the program is given.
        #[serde(default)]
        arguments: Vec<String>,
    },
    /// Ends the system; the connection is closed when that is done.
    Down {},
    /// The last lines of the log.
    Log {
        /// How many at most.
        lines: usize,
    },
    /// Answers, and then sends every [`Event`] as a line, as they happen.
    Events {},
}

/// What a supervisor answers.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Answer {
    /// Whether it has been done.
    pub ok: bool,
    /// Why not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// To [`Request::Status`].
    #[serde(flatten, default, skip_serializing_if = "Option::is_none")]
    pub status: Option<Status>,
    /// To [`Request::Log`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lines: Option<Vec<String>>,
}

/// How a system is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Status {
    /// The name of the system.
    pub system: String,
    /// The description that it was started from.
    pub file: String,
    /// Users' bytes of each processor's window.
    pub window_bytes: u32,
    /// The memory that belongs to no processor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shared_memory: Option<SharedMemory>,
    /// The directory that is served.
    pub files_root: Option<String>,
    /// The process of the supervisor.
    pub pid: u32,
    /// Seconds since it was started.
    pub uptime: f64,
    /// The services.
    pub services: Vec<Member>,
    /// The processors, in the order of the description.
    pub processors: Vec<Member>,
}

/// Where the memory lies that belongs to no processor: a file, or a part of one.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SharedMemory {
    /// The file.
    pub file: PathBuf,
    /// Where in the file it begins, in bytes.
    pub offset: u64,
    /// Its bytes; all of the file if they are not said.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bytes: Option<u64>,
}

impl SharedMemory {
    /// Maps it.
    ///
    /// # Errors
    /// The file cannot be opened or mapped.
    pub fn window(&self) -> Result<Region<LinuxWindow>, ProcessError> {
        let range = FileRange {
            path: self.file.clone(),
            offset: self.offset,
            bytes: self.bytes,
        };
        range.window()
    }
}

/// How a processor, or a service, is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Member {
    /// Its number in the system.
    pub number: u8,
    /// What it is called.
    pub name: String,
    /// What it is: `service`, `process`, or the word of another kind of processors.
    pub kind: String,
    /// Whether its programs run on this machine, and share its clock.
    pub runs_here: bool,
    /// What runs there: a path, or `self`.
    pub program: String,
    /// What the program is given.
    pub arguments: Vec<String>,
    /// The process, while there is one.
    pub pid: Option<u32>,
    /// How it is.
    pub state: MemberState,
    /// How often it was started again after a failure.
    pub restarts: u32,
    /// How its program ended the last time, such as `exit status: 1` or `killed by SIGKILL`.
    pub last_exit: Option<String>,
}

/// How a processor is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum MemberState {
    /// It waits for its turn, or its program has not joined yet.
    Starting,
    /// Its program has joined.
    Running,
    /// Its program has joined, and its heart stands still.
    Stalled,
    /// Its program failed, and is not started again.
    Failed,
    /// It was stopped, or its program has ended by itself without failing.
    Stopped,
    /// Its program failed, and is about to be started again.
    Restarting,
}

impl MemberState {
    /// The word that stands for it in JSON.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Starting => "starting",
            Self::Running => "running",
            Self::Stalled => "stalled",
            Self::Failed => "failed",
            Self::Stopped => "stopped",
            Self::Restarting => "restarting",
        }
    }
}

impl core::fmt::Display for MemberState {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.pad(self.word())
    }
}

/// Something that happened.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Event {
    /// When, as RFC 3339 says it.
    pub time: String,
    /// The processor or service, or `condor`.
    pub source: String,
    /// What.
    pub text: String,
    /// The state into which the processor came thereby.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub state: Option<MemberState>,
}

impl core::fmt::Display for Event {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{} {}: {}", self.time, self.source, self.text)
    }
}
