//! [`Environment`]: the settings that a supervisor passes to a process.

use std::fs::File;
use std::io;
use std::path::PathBuf;
use std::process::Command;

use condor_mbox::linux::{LinuxWindow, WindowAccess};
use condor_mbox::{Processor, Region};
use serde::{Deserialize, Serialize};

use super::error::{ProcessError, VARIABLE};
use crate::numbers::PROCESSORS;

/// The way in which the servo loops of a process run: in threads, in signal handlers, or where the
/// background polls. [The module](super) compares these ways.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LoopContext {
    /// Each loop runs in a thread of its own.
    #[default]
    Threads,
    /// Loops run in signal handlers.
    Signals,
    /// Loops run where the background polls the timer.
    Spin,
}

/// A file, or a part of a file, that processes map into their memory.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileRange {
    /// The path of the file.
    #[serde(rename = "file")]
    pub path: PathBuf,
    /// The beginning of the part, in bytes from the beginning of the file.
    pub offset: u64,
    /// The length of the part in bytes; `None` means up to the end of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bytes: Option<u64>,
}

impl FileRange {
    /// Makes the range that covers the whole of the file `path`.
    #[must_use]
    pub const fn whole(path: PathBuf) -> Self {
        Self {
            path,
            offset: 0,
            bytes: None,
        }
    }

    /// Opens the file and maps the range as memory that processes share, for loads and stores.
    /// Returns that memory as one region.
    ///
    /// # Errors
    /// [`ProcessError::Open`] if the file cannot be opened, [`ProcessError::MapShared`] if it
    /// cannot be mapped.
    pub fn window(&self) -> Result<Region<LinuxWindow>, ProcessError> {
        Ok(Region::whole(self.map("shared memory")?))
    }

    /// Maps it; errors call it `what`.
    pub(super) fn map(&self, what: &'static str) -> Result<LinuxWindow, ProcessError> {
        let (file, len) = self.open(what)?;
        let len = u32::try_from(len).unwrap_or(u32::MAX);
        let window = LinuxWindow::map(&file, self.offset, len, WindowAccess::ReadWrite);
        window.map_err(|source| ProcessError::MapShared {
            what,
            path: self.path.clone(),
            source,
        })
    }

    /// The file, and how many bytes the part has.
    pub(super) fn open(&self, what: &'static str) -> Result<(File, u64), ProcessError> {
        let open = || {
            let file = File::options().read(true).write(true).open(&self.path)?;
            let len = file.metadata()?.len();
            Ok((file, len))
        };
        let (file, len) = open().map_err(|source| ProcessError::Open {
            what,
            path: self.path.clone(),
            source,
        })?;
        let bytes = self.bytes.unwrap_or(len.saturating_sub(self.offset));
        Ok((file, bytes))
    }
}

/// The settings of a process that is a processor: its number, its memory, its clock, and the way in
/// which its loops run. A supervisor passes them in the environment variable `CONDOR_PROCESS`: a JSON object with the
/// names of these fields, of which optional ones may be left out.
///
/// ```
/// use condor_rt::linux::{Environment, LoopContext};
///
/// let text = r#"{"system": "/run/condor/hand/mailbox", "window_bytes": 65536, "processor": 3, "loops": "spin"}"#;
/// assert_eq!(Environment::from_json(text)?.loops, LoopContext::Spin);
/// # Ok::<(), condor_rt::linux::ProcessError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Environment {
    /// The directory of the mailbox system, as an absolute path.
    pub system: PathBuf,
    /// The size of the users' region of each processor's `data`, in bytes: a multiple of 4.
    pub window_bytes: u32,
    /// The number of the processor that this process implements, 0 to 31.
    #[serde(with = "Number")]
    pub processor: Processor,
    /// The file that is the bus of the boards, if there is one; its first byte has the bus address
    /// 0. If there is none, nothing answers on the bus.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bus: Option<FileRange>,
    /// The memory that belongs to no processor, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shared_memory: Option<FileRange>,
    /// The page of the system's [simulated clock](condor_clock); `None` if the clock is the real one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clock: Option<FileRange>,
    /// The simulated duration of one run of each loop, in nanoseconds, the loop of the highest rate
    /// first.
    #[serde(default)]
    pub work_ns: [u64; condor_clock::LOOPS],
    /// The way in which the loops run by the real clock.
    #[serde(default)]
    pub loops: LoopContext,
    /// The core on which the program runs; `None` means any core.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cpu: Option<usize>,
    /// A priority of the policy `SCHED_FIFO`, 1 to 99; `None` means the ordinary policy. [The
    /// module](super) says which thread gets it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub priority: Option<u8>,
}

/// A processor as its number.
#[derive(Serialize, Deserialize)]
#[serde(remote = "Processor")]
struct Number(u8);

impl Environment {
    /// Reads the settings of this process from its environment.
    ///
    /// # Errors
    /// [`ProcessError::Missing`] if the variable is not set, [`ProcessError::Wrong`] if it has a setting that is not
    /// allowed.
    pub fn read() -> Result<Self, ProcessError> {
        let text = std::env::var_os(VARIABLE).ok_or(ProcessError::Missing)?;
        Self::from_json(&text.to_string_lossy())
    }

    /// Reads settings from the text of the variable.
    ///
    /// # Errors
    /// [`ProcessError::Wrong`] with the first setting that is missing or not allowed.
    pub fn from_json(text: &str) -> Result<Self, ProcessError> {
        let read: Self = serde_json::from_str(text).map_err(|error| ProcessError::wrong(&error))?;
        const { assert!(PROCESSORS == 32, "the text says 0 to 31") };
        let is_aligned = |range: &Option<FileRange>| {
            let numbers = range.iter().flat_map(|it| [Some(it.offset), it.bytes]);
            numbers.flatten().all(|number| number.is_multiple_of(4))
        };
        let ranges = [&read.bus, &read.shared_memory, &read.clock];
        let priority = read.priority.unwrap_or(1);
        for (is_right, problem) in [
            (
                read.system.is_absolute(),
                "`system` must be an absolute path",
            ),
            (
                read.window_bytes.is_multiple_of(4) && ranges.into_iter().all(is_aligned),
                "numbers of bytes must be multiples of 4",
            ),
            (
                usize::from(read.processor.0) < PROCESSORS,
                "`processor` must be 0 to 31",
            ),
            ((1..=99).contains(&priority), "`priority` must be 1 to 99"),
        ] {
            if !is_right {
                return Err(ProcessError::wrong(&problem));
            }
        }
        Ok(read)
    }

    /// Sets the environment variable of `command`, so that the process that it starts [reads](Self::read) these
    /// settings. Returns `command`.
    ///
    /// # Errors
    /// Returns an error of the kind `InvalidData` if a path is not UTF-8.
    pub fn pass_to<'c>(&self, command: &'c mut Command) -> io::Result<&'c mut Command> {
        Ok(command.env(VARIABLE, serde_json::to_string(self)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: &str = r#"{
        "system": "/run/condor/mailbox", "window_bytes": 4096, "processor": 3,
        "bus": { "file": "/run/condor/bus", "offset": 8192, "bytes": 4096 },
        "shared_memory": { "file": "/run/condor/shared", "offset": 0 },
        "clock": { "file": "/run/condor/clock", "offset": 24576, "bytes": 4096 },
        "work_ns": [500000, 0, 0, 0, 0, 0, 0, 7], "loops": "spin", "cpu": 1, "priority": 80
    }"#;

    #[test]
    fn what_is_passed_is_read() {
        let all = Environment::from_json(ALL).unwrap();
        let least = r#"{ "system": "/m", "window_bytes": 4, "processor": 0 }"#;
        let least = Environment::from_json(least).unwrap();
        assert_eq!(least.loops, LoopContext::Threads);
        for passed in [all, least] {
            let mut command = Command::new("program");
            passed.pass_to(&mut command).unwrap();
            let (name, text) = command.get_envs().next().unwrap();
            assert_eq!(name, VARIABLE);
            let text = text.unwrap().to_str().unwrap();
            assert_eq!(Environment::from_json(text).unwrap(), passed);
        }
    }

    #[test]
    fn what_is_missing_or_wrong_is_named() {
        for (from, to, text) in [
            ("\"system\": \"/run/condor/mailbox\",", "", "`system`"),
            ("\"/run/condor/mailbox\"", "\"mailbox\"", "an absolute path"),
            (
                "4096, \"processor\"",
                "4097, \"processor\"",
                "multiples of 4",
            ),
            ("8192", "2", "multiples of 4"),
            ("\"processor\": 3", "\"processor\": 32", "0 to 31"),
            ("[500000,", "[\"x\",", "u64"),
            ("[500000,", "[", "an array of length 8"),
            ("\"spin\"", "\"fibres\"", "`threads`, `signals`, `spin`"),
            ("\"cpu\": 1", "\"cpu\": -1", "usize"),
            ("80", "0", "1 to 99"),
            ("80", "100", "1 to 99"),
            ("\"cpu\"", "\"core\"", "`core`"),
        ] {
            let error = Environment::from_json(&ALL.replace(from, to)).unwrap_err();
            let error = error.to_string();
            assert!(error.contains(text) && error.contains(VARIABLE), "{error}");
        }
    }
}
