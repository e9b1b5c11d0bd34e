//! [`Environment`]: the settings that a supervisor passes to a process.

use std::fs::File;
use std::io;
use std::path::PathBuf;
use std::process::Command;

use condor_mbox::linux::{LinuxWindow, WindowAccess};
use condor_mbox::{Processor, Region};
use serde::{Deserialize, Serialize};

use super::error::{ProcessError, VARIABLE};
use crate::lines::FIRST_LINE;
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
#[serde(deny_unknown_fields)]
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

/// A UIO device, whose interrupts are those of a board of the program.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UioDevice {
    /// The vector that the interrupts have for the program, 1 to 127.
    pub vector: u16,
    /// The path of the device, such as `/dev/uio0`.
    #[serde(rename = "file")]
    pub path: PathBuf,
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
    /// The UIO devices whose interrupts are those of the program's boards, each with a vector of its own. In a system
    /// with a simulated clock, they are not used.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub uio: Vec<UioDevice>,
    /// The terminal device that is the [serial port](crate::SERIAL) of the program, such as `/dev/ttyUSB0`; `None` if
    /// it has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub serial: Option<PathBuf>,
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
    /// Whether the process stops at a fatal error, that is, a panic or a signal such as SIGSEGV, and waits for a
    /// debugger as it is.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub hold_exceptions: bool,
    /// Whether the process stops before its program runs, and waits for a debugger.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub hold_at_start: bool,
    /// Whether a floating-point exception in a servo loop is [fatal](crate::Machine::is_float_exception_fatal).
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub float_exceptions: bool,
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
    /// Makes the settings of a processor of the mailbox system in the directory `system`, with the defaults of all optional
    /// settings.
    #[must_use]
    pub fn new(system: PathBuf, window_bytes: u32, processor: Processor) -> Self {
        Self {
            system,
            window_bytes,
            processor,
            bus: None,
            uio: Vec::new(),
            serial: None,
            shared_memory: None,
            clock: None,
            work_ns: [0; condor_clock::LOOPS],
            loops: LoopContext::default(),
            hold_exceptions: false,
            hold_at_start: false,
            float_exceptions: false,
            cpu: None,
            priority: None,
        }
    }

    /// Reads the settings of this process from its environment.
    ///
    /// # Errors
    /// [`ProcessError::Missing`] if the variable is not set, [`ProcessError::Wrong`] if it has a setting that is not
    /// allowed.
    pub fn read() -> Result<Self, ProcessError> {
        let text = std::env::var_os(VARIABLE).ok_or(ProcessError::Missing)?;
        let text = text.to_str();
        Self::from_json(text.ok_or_else(|| ProcessError::wrong(&"it is not UTF-8"))?)
    }

    /// Reads settings from the text of the variable.
    ///
    /// # Errors
    /// [`ProcessError::Wrong`] with the first setting that is missing or not allowed.
    pub fn from_json(text: &str) -> Result<Self, ProcessError> {
        let read: Self = serde_json::from_str(text).map_err(|error| ProcessError::wrong(&error))?;
        const { assert!(PROCESSORS == 32, "the text says 0 to 31") };
        if !read.system.is_absolute() {
            let (path, must) = (read.system.display(), "must be an absolute path");
            return Err(ProcessError::wrong(&format_args!(
                "`system` is {path}; it {must}"
            )));
        }
        let ranges = [
            ("bus", &read.bus),
            ("shared_memory", &read.shared_memory),
            ("clock", &read.clock),
        ];
        let bytes = ranges.iter().flat_map(|(name, range)| {
            let numbers =
                |it: &FileRange| [("offset", it.offset), ("bytes", it.bytes.unwrap_or(0))];
            let numbers = range.iter().flat_map(numbers);
            numbers.map(move |(field, bytes)| (format!("{name}.{field}"), bytes))
        });
        let window = ("window_bytes".to_owned(), u64::from(read.window_bytes));
        let mut all = core::iter::once(window).chain(bytes);
        if let Some((name, bytes)) = all.find(|(_, bytes)| !bytes.is_multiple_of(4)) {
            let text = format!("`{name}` is {bytes}; it must be a multiple of 4");
            return Err(ProcessError::wrong(&text));
        }
        let processor = read.processor.0;
        if usize::from(processor) >= PROCESSORS {
            let text = format!("`processor` is {processor}; it must be 0 to 31");
            return Err(ProcessError::wrong(&text));
        }
        for (place, device) in read.uio.iter().enumerate() {
            let vector = device.vector;
            if !(1..FIRST_LINE.0).contains(&vector) {
                let text = format!("`uio.vector` is {vector}; it must be 1 to 127");
                return Err(ProcessError::wrong(&text));
            }
            let mut others = read.uio.iter().take(place);
            if others.any(|other| other.vector == vector) {
                let text = format!("two devices of `uio` have the vector {vector}");
                return Err(ProcessError::wrong(&text));
            }
        }
        if let Some(priority) = read.priority.filter(|it| !(1..=99).contains(it)) {
            let text = format!("`priority` is {priority}; it must be 1 to 99");
            return Err(ProcessError::wrong(&text));
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
        "uio": [{ "vector": 64, "file": "/dev/uio0" }, { "vector": 65, "file": "/dev/uio1" }],
        "serial": "/dev/ttyUSB0",
        "shared_memory": { "file": "/run/condor/shared", "offset": 0 },
        "clock": { "file": "/run/condor/clock", "offset": 24576, "bytes": 4096 },
        "work_ns": [500000, 0, 0, 0, 0, 0, 0, 7], "loops": "spin", "hold_exceptions": true,
        "hold_at_start": true, "float_exceptions": true, "cpu": 1, "priority": 80
    }"#;

    #[test]
    fn what_is_passed_is_read() {
        let all = Environment::from_json(ALL).unwrap();
        let least = r#"{ "system": "/m", "window_bytes": 4, "processor": 0 }"#;
        let least = Environment::from_json(least).unwrap();
        assert_eq!(least, Environment::new("/m".into(), 4, Processor(0)));
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
            (
                "\"/run/condor/mailbox\"",
                "\"mailbox\"",
                "`system` is mailbox; it",
            ),
            (
                "4096, \"processor\"",
                "4097, \"processor\"",
                "`window_bytes` is 4097; it must be a multiple of 4",
            ),
            ("8192", "2", "`bus.offset` is 2"),
            (
                "\"processor\": 3",
                "\"processor\": 32",
                "is 32; it must be 0 to 31",
            ),
            ("[500000,", "[\"x\",", "u64"),
            ("[500000,", "[", "an array of length 8"),
            ("\"spin\"", "\"fibres\"", "`threads`, `signals`, `spin`"),
            ("\"cpu\": 1", "\"cpu\": -1", "usize"),
            ("80", "0", "is 0; it must be 1 to 99"),
            ("64", "128", "`uio.vector` is 128; it must be 1 to 127"),
            ("64", "65", "two devices of `uio` have the vector 65"),
            ("80", "100", "is 100; it must be 1 to 99"),
            ("\"cpu\"", "\"core\"", "`core`"),
        ] {
            let error = Environment::from_json(&ALL.replace(from, to)).unwrap_err();
            let error = error.to_string();
            assert!(error.contains(text) && error.contains(VARIABLE), "{error}");
        }
    }
}
