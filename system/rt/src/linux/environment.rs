//! [`Environment`]: the settings that a supervisor passes to a process.

use std::ffi::{OsStr, OsString};
use std::fs::File;
use std::path::PathBuf;
use std::process::Command;
use std::str::FromStr;

use condor_mbox::linux::{LinuxWindow, WindowAccess};
use condor_mbox::{Processor, Region};

use super::error::ProcessError;
use crate::numbers::PROCESSORS;

const SYSTEM: &str = "CONDOR_SYSTEM";
const WINDOW_BYTES: &str = "CONDOR_WINDOW_BYTES";
const PROCESSOR: &str = "CONDOR_PROCESSOR";
/// Of a range of a file: path, offset and bytes.
type RangeVariables = [&'static str; 3];
const BUS: RangeVariables = ["CONDOR_BUS", "CONDOR_BUS_OFFSET", "CONDOR_BUS_BYTES"];
const SHARED: RangeVariables = [
    "CONDOR_SHARED_MEMORY",
    "CONDOR_SHARED_MEMORY_OFFSET",
    "CONDOR_SHARED_MEMORY_BYTES",
];
const CLOCK: RangeVariables = ["CONDOR_CLOCK", "CONDOR_CLOCK_OFFSET", "CONDOR_CLOCK_BYTES"];
const WORK: &str = "CONDOR_LOOP_TIMES_NS";
pub(super) const LOOPS: &str = "CONDOR_LOOPS";
const CPU: &str = "CONDOR_CPU";
const PRIORITY: &str = "CONDOR_PRIORITY";

/// The way in which the servo loops of a process run: in threads, in signal handlers, or where the
/// background polls. [The module](super) compares these ways.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LoopContext {
    /// Each loop runs in a thread of its own.
    #[default]
    Threads,
    /// Loops run in signal handlers.
    Signals,
    /// Loops run where the background polls the timer.
    Spin,
}

impl LoopContext {
    /// All ways in which loops can run, for example to find the one with a given
    /// [`word`](Self::word).
    pub const ALL: [Self; 3] = [Self::Threads, Self::Signals, Self::Spin];

    /// Returns the value of the environment variable `CONDOR_LOOPS` that selects this way:
    /// `threads`, `signals` or `spin`.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Threads => "threads",
            Self::Signals => "signals",
            Self::Spin => "spin",
        }
    }
}

/// A file, or a part of a file, that processes map into their memory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FileRange {
    /// The path of the file.
    pub path: PathBuf,
    /// The beginning of the part, in bytes from the beginning of the file.
    pub offset: u64,
    /// The length of the part in bytes; `None` means up to the end of the file.
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
/// which its loops run. A supervisor passes them in variables of the environment, which [the
/// module](super) lists.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Environment {
    /// The directory of the mailbox system.
    pub system: PathBuf,
    /// The size of the users' region of each processor's `data`, in bytes.
    pub window_bytes: u32,
    /// The number of the processor that this process implements.
    pub processor: Processor,
    /// The file that is the bus of the boards, if there is one; its first byte has the bus address
    /// 0.
    pub bus: Option<FileRange>,
    /// The memory that belongs to no processor, if there is one.
    pub shared_memory: Option<FileRange>,
    /// The page of the system's simulated clock; `None` if the clock is the real one.
    pub clock: Option<FileRange>,
    /// The simulated duration of one run of each loop, in nanoseconds, the loop of the highest rate
    /// first.
    pub work_ns: [u64; condor_clock::LOOPS],
    /// The way in which the loops run by the real clock.
    pub loops: LoopContext,
    /// The core on which the program runs; `None` means any core.
    pub cpu: Option<usize>,
    /// A priority of the policy `SCHED_FIFO`, 1 to 99; `None` means the ordinary policy. [The
    /// module](super) says which thread gets it.
    pub priority: Option<u8>,
}

impl Environment {
    /// Reads the settings of this process from its environment.
    ///
    /// # Errors
    /// [`ProcessError::Missing`] if a required variable is not set or empty,
    /// [`ProcessError::Wrong`] if a variable has a value that is not allowed.
    pub fn read() -> Result<Self, ProcessError> {
        Self::from_variables(|variable| std::env::var_os(variable))
    }

    /// Sets environment variables of `command`, so that the process that it starts
    /// [reads](Self::read) these settings. Removes the variables of optional settings that are
    /// absent here. Returns `command`.
    pub fn pass_to<'c>(&self, command: &'c mut Command) -> &'c mut Command {
        command
            .env(SYSTEM, &self.system)
            .env(WINDOW_BYTES, self.window_bytes.to_string())
            .env(PROCESSOR, self.processor.0.to_string())
            .env(LOOPS, self.loops.word());
        let range = |[path, offset, bytes]: RangeVariables, range: Option<&FileRange>| {
            let begins = range.map(|range| range.offset).filter(|&it| it > 0);
            let len = range.and_then(|range| range.bytes);
            [
                (path, range.map(|range| range.path.clone().into())),
                (offset, begins.map(|begins| begins.to_string().into())),
                (bytes, len.map(|len| len.to_string().into())),
            ]
        };
        let ranges = [
            range(BUS, self.bus.as_ref()),
            range(SHARED, self.shared_memory.as_ref()),
            range(CLOCK, self.clock.as_ref()),
        ];
        let work = self.work_ns.map(|ns| ns.to_string()).join(",");
        let work = self.work_ns.iter().any(|&ns| ns > 0).then(|| work.into());
        let optional = [
            (WORK, work),
            (CPU, self.cpu.map(|cpu| OsString::from(cpu.to_string()))),
            (PRIORITY, self.priority.map(|one| one.to_string().into())),
        ];
        for (variable, value) in ranges.into_iter().flatten().chain(optional) {
            match value {
                Some(value) => command.env(variable, value),
                None => command.env_remove(variable),
            };
        }
        command
    }

    fn from_variables(get: impl Fn(&str) -> Option<OsString>) -> Result<Self, ProcessError> {
        let optional = |variable| get(variable).filter(|value| !value.is_empty());
        let needed = |variable, expected| {
            optional(variable).ok_or(ProcessError::Missing { variable, expected })
        };
        let path = "an absolute path of a directory";
        let system = PathBuf::from(needed(SYSTEM, path)?);
        if !system.is_absolute() {
            return Err(ProcessError::Wrong {
                variable: SYSTEM,
                value: system.into(),
                expected: path,
            });
        }
        let bytes = "a number of bytes that is a multiple of 4";
        let window_bytes = needed(WINDOW_BYTES, bytes)?;
        let window_bytes = number(WINDOW_BYTES, window_bytes, bytes, |&bytes: &u32| {
            bytes.is_multiple_of(4)
        })?;
        let below = "a number of a processor, 0 to 31";
        const { assert!(PROCESSORS == 32, "the text says 0 to 31") };
        let processor = number(
            PROCESSOR,
            needed(PROCESSOR, below)?,
            below,
            |&number: &u8| usize::from(number) < PROCESSORS,
        )?;
        let loops = optional(LOOPS).map_or(Ok(LoopContext::default()), |value| {
            let known = LoopContext::ALL.into_iter().find(|one| value == one.word());
            known.ok_or(ProcessError::Wrong {
                variable: LOOPS,
                value,
                expected: "`threads`, `signals` or `spin`",
            })
        })?;
        let cpu = optional(CPU)
            .map(|value| number(CPU, value, "a number of a core, from 0 on", |_| true))
            .transpose()?;
        let priority = optional(PRIORITY)
            .map(|value| {
                let expected = "a priority of SCHED_FIFO, 1 to 99";
                number(PRIORITY, value, expected, |one| (1..=99).contains(one))
            })
            .transpose()?;
        let range = |[path, offset, len]: RangeVariables| {
            let count = |variable| {
                let value = optional(variable);
                let read = |value| number(variable, value, bytes, |it: &u64| it.is_multiple_of(4));
                value.map(read).transpose()
            };
            let (offset, bytes) = (count(offset)?.unwrap_or(0), count(len)?);
            Ok::<_, ProcessError>(optional(path).map(|path| FileRange {
                path: path.into(),
                offset,
                bytes,
            }))
        };
        let mut work_ns = [0; condor_clock::LOOPS];
        if let Some(value) = optional(WORK) {
            let text = value.to_string_lossy();
            let times: Result<Vec<u64>, _> = text.split(',').map(str::parse).collect();
            let times = times.ok().filter(|times| times.len() <= work_ns.len());
            let Some(times) = times else {
                return Err(ProcessError::Wrong {
                    variable: WORK,
                    value,
                    expected: "at most 8 numbers of nanoseconds with commas between them",
                });
            };
            for (place, time) in work_ns.iter_mut().zip(times) {
                *place = time;
            }
        }
        Ok(Self {
            system,
            window_bytes,
            processor: Processor(processor),
            bus: range(BUS)?,
            shared_memory: range(SHARED)?,
            clock: range(CLOCK)?,
            work_ns,
            loops,
            cpu,
            priority,
        })
    }
}

fn number<T: FromStr>(
    variable: &'static str,
    value: OsString,
    expected: &'static str,
    is_right: impl Fn(&T) -> bool,
) -> Result<T, ProcessError> {
    let number = OsStr::to_str(&value).and_then(|text| text.parse().ok());
    number.filter(is_right).ok_or(ProcessError::Wrong {
        variable,
        value,
        expected,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [(&str, &str); 16] = [
        (SYSTEM, "/run/condor/mailbox"),
        (WINDOW_BYTES, "4096"),
        (PROCESSOR, "3"),
        (BUS[0], "/run/condor/bus"),
        (BUS[1], "8192"),
        (BUS[2], "4096"),
        (SHARED[0], "/run/condor/shared"),
        (SHARED[1], "16384"),
        (SHARED[2], "8192"),
        (CLOCK[0], "/run/condor/clock"),
        (CLOCK[1], "24576"),
        (CLOCK[2], "4096"),
        (WORK, "500000,0,0,0,0,0,0,7"),
        (LOOPS, "spin"),
        (CPU, "1"),
        (PRIORITY, "80"),
    ];

    /// With one variable changed, or left out.
    fn with(changed: &str, value: Option<&str>) -> Result<Environment, ProcessError> {
        Environment::from_variables(|variable| {
            let usual = ALL.iter().find(|(name, _)| *name == variable);
            let usual = usual.map(|(_, value)| *value);
            let value = if variable == changed { value } else { usual };
            value.map(OsString::from)
        })
    }

    #[test]
    fn what_is_passed_is_read() {
        let all = with("", None).unwrap();
        let mut command = Command::new("program");
        all.pass_to(&mut command);
        let read = Environment::from_variables(|variable| {
            let mut variables = command.get_envs();
            let (_, value) = variables.find(|(name, _)| *name == variable)?;
            value.map(OsStr::to_owned)
        });
        assert_eq!(read.unwrap(), all);
        let least = Environment {
            bus: None,
            shared_memory: None,
            clock: None,
            work_ns: [0; condor_clock::LOOPS],
            loops: LoopContext::Threads,
            cpu: None,
            priority: None,
            ..all
        };
        for (variable, part) in [
            (BUS[0], "bus"),
            (BUS[1], "offset"),
            (BUS[2], "bytes"),
            (SHARED[0], "shared memory"),
            (SHARED[1], "its offset"),
            (SHARED[2], "its bytes"),
            (CLOCK[0], "clock"),
            (CLOCK[1], "its offset"),
            (CLOCK[2], "its bytes"),
            (WORK, "times of loops"),
            (CPU, "cpu"),
            (PRIORITY, "priority"),
            (LOOPS, "loops"),
        ] {
            let read = with(variable, None).unwrap();
            assert_ne!(read, with("", None).unwrap(), "{part}");
        }
        least.pass_to(&mut command);
        let gone = command.get_envs().filter(|(_, value)| value.is_none());
        assert_eq!(gone.count(), 12);
    }

    #[test]
    fn what_is_missing_or_wrong_is_named() {
        for (variable, value, text) in [
            (
                SYSTEM,
                None,
                "the environment has no CONDOR_SYSTEM: it must be an absolute path",
            ),
            (
                SYSTEM,
                Some("2 64 family"),
                "CONDOR_SYSTEM is \"2 64 family\"",
            ),
            (
                WINDOW_BYTES,
                Some("4097"),
                "\"4097\" in the environment: it must be a number of bytes that is a multiple of 4",
            ),
            (WINDOW_BYTES, None, "no CONDOR_WINDOW_BYTES"),
            (PROCESSOR, Some("32"), "0 to 31"),
            (PROCESSOR, Some(""), "no CONDOR_PROCESSOR"),
            (BUS[1], Some("2"), "a multiple of 4"),
            (SHARED[2], Some("all"), "a multiple of 4"),
            (WORK, Some("1,x"), "numbers of nanoseconds"),
            (WORK, Some("1,2,3,4,5,6,7,8,9"), "at most 8"),
            (LOOPS, Some("fibres"), "`threads`, `signals` or `spin`"),
            (CPU, Some("-1"), "from 0 on"),
            (PRIORITY, Some("0"), "1 to 99"),
            (PRIORITY, Some("100"), "1 to 99"),
        ] {
            let error = with(variable, value).unwrap_err().to_string();
            assert!(error.contains(text) && error.contains(variable), "{error}");
        }
    }
}
