//! The control socket of a running system: its protocol, and the [`ControlClient`] that commands use.
//!
//! Requests and answers are JSON objects, one per line, over the Unix socket `control` in the
//! directory of the [system](crate::system). The answer comes when the request has taken effect:
//! for a `stop`, when the program has ended; for a `start`, when it has joined. Several requests
//! may be sent without waiting; they are carried out one after the other.
//!
//! ```text
//! {"do":"stop","processor":"servo-a"}
//! {"ok":true}
//! {"do":"stop","processor":"servo-x"}
//! {"ok":false,"error":"there is no processor or service `servo-x`; there are files, terminals, master, servo-a"}
//! ```

pub(crate) mod client;
pub(crate) mod server;

pub use client::{ControlClient, ControlClientError, ControlEvents, follow, from_here, told_of};

use std::time::Duration;

use condor_mbox::Processor;
use condor_rt::linux::FileRange;
use serde::{Deserialize, Serialize};

use crate::names::word;
use crate::system::FindError;

/// The time within which a system has ended after it was told to go down, whatever its programs do. It is real time,
/// also for a system with a simulated clock.
pub const DOWN: Duration = Duration::from_secs(10);

/// A request to the supervisor of a running system. [`ControlClient::ask`] sends it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "do", rename_all = "lowercase", deny_unknown_fields)]
#[non_exhaustive]
pub enum ControlRequest {
    /// Asks for the [`SystemStatus`] of the system.
    Status {},
    /// Stops the program of a processor, or a service.
    Stop {
        /// The name or the number of the processor or service.
        processor: String,
    },
    /// Starts the program of a processor, or a service, that does not run.
    Start {
        /// The name or the number of the processor or service.
        processor: String,
    },
    /// Stops the program of a processor, or a service, if it runs, and starts it again with the same arguments.
    Restart {
        /// The name or the number of the processor or service.
        processor: String,
        /// Whether the program, which must be a process, stops before it runs, and waits for a debugger. The answer comes
        /// when it does so.
        #[serde(default, skip_serializing_if = "core::ops::Not::not")]
        held: bool,
    },
    /// Stops a processor, and starts it with another program.
    Load {
        /// The name or the number of the processor.
        processor: String,
        /// The program, written as in the description and relative to it: so a path that a person types is made
        /// absolute.
        program: String,
        /// The arguments of the program.
        #[serde(default)]
        arguments: Vec<String>,
    },
    /// Pauses the simulated clock at the present instant.
    Pause {},
    /// Lets the simulated clock run for the given time, and then pauses it.
    Step {
        /// The time to run, in simulated nanoseconds.
        ns: u64,
    },
    /// Lets the simulated clock go on after a pause.
    Resume {},
    /// Sets the speed of the simulated clock.
    Speed {
        /// The speed in thousandths of the real time; 0 means as fast as possible.
        thousandths: u64,
    },
    /// Ends the whole system. The answer comes when all programs have ended; the supervisor closes the
    /// connection when it has ended, too.
    Down {},
    /// Asks for the last lines of the log.
    Log {
        /// The greatest number of lines.
        lines: usize,
    },
    /// Asks for events: after the answer, every [`SystemEvent`] is sent as a line when it happens.
    Events {},
}

/// The answer of the supervisor to a [`ControlRequest`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct ControlAnswer {
    /// Whether the request has been carried out.
    pub ok: bool,
    /// The reason, if it was not carried out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// The state of the system, in the answer to [`ControlRequest::Status`]; otherwise `None`.
    #[serde(flatten, default, skip_serializing_if = "Option::is_none")]
    pub status: Option<SystemStatus>,
    /// The lines of the log, in the answer to [`ControlRequest::Log`], oldest first; otherwise `None`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lines: Option<Vec<String>>,
    /// The names of the processors and services that had to be killed, in the answer to
    /// [`ControlRequest::Down`]; otherwise empty.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub killed: Vec<String>,
}

/// The state of a running system, as its supervisor reports it. [`ControlClient::status`] asks for it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SystemStatus {
    /// The name of the system.
    pub system: String,
    /// The file of the description from which it was started.
    pub file: String,
    /// The size of the users' region of each processor's `data`, in bytes.
    pub window_bytes: u32,
    /// The shared memory that belongs to no processor; `None` if the system has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shared_memory: Option<FileRange>,
    /// The simulated clock; `None` if the system runs by the real one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clock: Option<ClockStatus>,
    /// The directory that the file service serves; `None` if the system has no file service.
    pub files_root: Option<String>,
    /// The process id of the supervisor.
    pub pid: u32,
    /// The seconds since the start of the system.
    pub uptime: f64,
    /// The services of the system.
    pub services: Vec<Member>,
    /// The processors, in the order of the description.
    pub processors: Vec<Member>,
}

impl SystemStatus {
    /// Returns an iterator over all processors, followed by all services.
    pub fn members(&self) -> impl Iterator<Item = &Member> + Clone {
        self.processors.iter().chain(&self.services)
    }

    /// Returns the processor or service whose name or number is `text`. A number is decimal, or hexadecimal after `0x`.
    ///
    /// # Errors
    /// Returns [`FindError::NoMember`] if no processor or service has this name or number.
    pub fn member(&self, text: &str) -> Result<&Member, FindError> {
        find(self.members(), text)
    }

    /// Returns the processor whose name or number is `text`. Services are not searched.
    ///
    /// # Errors
    /// Returns [`FindError::NoMember`] if no processor has this name or number.
    pub fn processor(&self, text: &str) -> Result<&Member, FindError> {
        find(self.processors.iter(), text)
    }
}

fn find<'m>(
    mut members: impl Iterator<Item = &'m Member> + Clone,
    text: &str,
) -> Result<&'m Member, FindError> {
    let there = members.clone();
    let number = word(text).ok();
    let is_it = |member: &&Member| member.name == text || number == Some(member.number.into());
    members.find(is_it).ok_or_else(|| FindError::NoMember {
        name: text.into(),
        there: there
            .map(|member| format!("{} ({})", member.name, member.number))
            .collect(),
    })
}

/// The state of a system's simulated clock: its time, its speed, and the processor or other reason for which it waits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ClockStatus {
    /// The present instant, in seconds since time began.
    pub seconds: f64,
    /// The speed that was set, as a multiple of the real time; `None` means as fast as possible.
    pub speed: Option<f64>,
    /// The speed that was reached in the last seconds: simulated seconds per real second.
    pub factor: f64,
    /// The speed that was reached since time began: simulated seconds per real second.
    pub overall: f64,
    /// Whether time is paused, or comes to a pause at the end of a step.
    pub paused: bool,
    /// The reason, in words, for which time does not go on at once, such as a processor that runs.
    pub waits_for: String,
}

impl core::fmt::Display for ClockStatus {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let (seconds, factor) = (self.seconds, self.factor);
        write!(
            f,
            "simulated clock {seconds:.3} s, {factor:.2} × real time ("
        )?;
        match self.speed {
            Some(speed) => write!(f, "speed {speed}")?,
            None => f.write_str("speed max")?,
        }
        f.write_str(if self.paused { ", paused)" } else { ")" })
    }
}

/// A processor or a service of a running system: its program, and the present state of that program.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Member {
    /// The number of the processor or service in the system.
    pub number: u8,
    /// The name of the processor or service, unique in the system.
    pub name: String,
    /// The kind of the processor: `process`, or the word of another kind; `service` for a service.
    pub kind: String,
    /// Whether its program runs on this machine, and so by the clock of this machine.
    pub runs_here: bool,
    /// The program: a path, or `self` for a program of the binary that the supervisor runs.
    pub program: String,
    /// The arguments of the program.
    pub arguments: Vec<String>,
    /// The process id of its program; `None` while there is no process.
    pub pid: Option<u32>,
    /// The state of its program.
    pub state: MemberState,
    /// The number of restarts after failures, since the start of the system.
    pub restarts: u32,
    /// The way in which its program ended last, such as `exit status: 1` or `killed by SIGKILL`; `None` if it
    /// has not ended yet.
    pub last_exit: Option<String>,
}

impl Member {
    /// Returns the number of the processor or service as a [`Processor`], which functions of mailboxes and of
    /// [`View`](crate::view::View) take.
    #[must_use]
    pub const fn processor(&self) -> Processor {
        Processor(self.number)
    }
}

/// The state of the program of a processor or a service, as its supervisor sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum MemberState {
    /// The processor or service waits for its turn to be started, or its program has not joined the mailbox
    /// system yet.
    Starting,
    /// The program has joined the mailbox system, and its heartbeat goes on.
    Running,
    /// Its program has stopped as it is: a debugger holds it, or it waits for one.
    Held,
    /// The program has joined the mailbox system, but its heartbeat has stopped.
    Stalled,
    /// The program has failed and is not restarted.
    Failed,
    /// A request has stopped it, or its program has ended by itself without failing.
    Stopped,
    /// The program has failed and is about to be restarted.
    Restarting,
}

impl core::fmt::Display for MemberState {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        // As in JSON.
        f.pad(match self {
            Self::Starting => "starting",
            Self::Running => "running",
            Self::Held => "held",
            Self::Stalled => "stalled",
            Self::Failed => "failed",
            Self::Stopped => "stopped",
            Self::Restarting => "restarting",
        })
    }
}

/// An event in a running system, such as the start or the failure of a program. The log of the system has a line for
/// each.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct SystemEvent {
    /// The time, in the format of RFC 3339.
    pub time: String,
    /// The name of the processor or service to which it happened, or `condor`.
    pub source: String,
    /// The description of the event.
    pub text: String,
    /// The new state of the processor, if the event changed it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub state: Option<MemberState>,
}

impl core::fmt::Display for SystemEvent {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{} {}: {}", self.time, self.source, self.text)
    }
}
