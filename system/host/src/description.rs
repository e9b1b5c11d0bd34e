//! The description of a system: a TOML file that says which programs run on which processors.
//!
//! | key | meaning | default |
//! |---|---|---|
//! | `name` | the name of the system, and of its running directory | |
//! | `window_bytes` | the size of the users' region of each processor's `data`, in bytes, a multiple of 4096 | |
//! | `robot` | the file with the robot's configuration, for programs that need one | none |
//! | `[clock]` `kind` | `"real"`, or `"simulated"`: one time for all processors that no other program hurries or delays (see [`condor_clock`]) | `"real"` |
//! | `[clock]` `speed` | the speed of a simulated clock, as a multiple of the real time such as `0.5`, or `"max"` | 1 |
//! | `[bus]` `bytes` | the size of the file that all programs map as their bus, in bytes, a multiple of 4096 | no bus |
//! | `[shared_memory]` `bytes` | the size of a memory that belongs to no processor and that all processors reach, in bytes, a multiple of 4096; its first 20480 bytes are for the log of the programs, `condor log --shared` | none |
//! | `[…]` | the table of an [extension](crate::extension) | none |
//! | `[files]` `root` | the directory that the file service serves; it is made if it does not exist | nothing is served |
//! | `[files]` `read_only`, `quota_bytes`, `max_file_bytes` | the limits of programs there | no limits |
//! | `[terminals]` `replay_bytes` | how much of a terminal's earlier output a new viewer gets, in bytes | 65536 |
//! | `[terminals]` `log_bytes` | the size in bytes at which the log of a terminal is rotated; one previous log is kept. It is at least `replay_bytes` | 4194304 |
//! | `[services]` `restarts` | the greatest number of restarts of a service in a minute, or in a row if it does not join; then it has failed for good | 20 |
//! | `[[processors]]` | the processors with their programs, in the order in which they are started | |
//!
//! | key of a processor | meaning | default |
//! |---|---|---|
//! | `number` | its number, 0 to 11 | |
//! | `name` | its name in commands | |
//! | `program` | `"self"` for a program of the running binary, or a file | |
//! | `arguments` | the arguments of the program | `[]` |
//! | `hold_exceptions` | whether a fatal error, such as a memory access that is not allowed, or a panic, stops the program as it is until a debugger comes, instead of ending it as `on_failure` says. A panic of one servo loop stops it, too, and in simulated time all others wait | `true` if the system is brought up in the user interface and `on_failure` is `"restart"`, otherwise `false` |
//! | `float_exceptions` | whether an invalid floating-point operation, a division by zero or an overflow in a servo loop is a fatal error; so is the conversion of a number that is too large for an integer type | `false` |
//! | `headless` | lines that are typed at its terminal when all programs run, in a run without user interface | `[]` |
//! | `kind` | `"process"` of this machine, or the kind of an extension | `"process"` |
//! | `loops` | the way in which servo loops run: in `"threads"`, in `"signals"` if the program allows it, or `"spin"` (see [`condor_rt::linux`]) | `"threads"` |
//! | `cpu` | the CPU to which the process is pinned | any |
//! | `priority` | a priority of `SCHED_FIFO`, 1 to 99 | no real-time scheduling |
//! | `uio` | UIO devices whose interrupts are those of the program's boards, such as `[{ vector = 64, file = "/dev/uio0" }]`; vectors are 1 to 127, and different. They are not used in simulated time | `[]` |
//! | `serial` | the terminal device that is the serial port of the program ([`condor_rt::SERIAL`]), such as `"/dev/ttyUSB0"`. The program does not start without the device | none |
//! | `on_failure` | `"restart"` the program, `"stop"` the whole system, or `"leave"` it as it is | `"restart"` |
//! | `restarts` | the greatest number of restarts in a minute, or in a row if the program does not join; then it has failed for good | 10 |
//! | `loop_times_us` | how long its servo loops take in simulated time, in microseconds, the fastest loop first | they take no time |
//! | `servo_loops` | its servo loops, to check that they end in time ([`response_times_us`]), such as `[{ name = "servo", hz = 400, worst_us = 300, blocked_us = 20 }]`: the longest time of a run, and the longest for which slower loops and the background mask interrupts or hold locks (0 without it), both in microseconds | not checked |
//! | `may_ask` | the requests of its program, by message, that the supervisor carries out: `"restart"` of any processor's program, `"load"` of a program that this description names (see [`condor_rt::supervisor`]) | `[]` |
//! | `serves` | the parts of the robot, such as fingers, that its program serves, by their names; the others are served as the file `robot` says | `[]` |
//! | `stall_seconds` | how long the heartbeat may stop before that is a failure, in seconds; 0: for ever | 5 |
//!
//! `loops`, `cpu`, `priority`, `uio` and `serial` are for processes; other kinds have keys of their own.
//!
//! Paths are relative to the directory of the description. A program is searched there, then in the
//! directory of the running program, then in `PATH`.

use core::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use condor_clock::LOOPS;
use condor_mos::{Analysis, Load, LoopId, Rate, ResponseTime};
use serde::de::{self, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

use crate::extension::Group;

pub use condor_toml::{Keys, Spanned, TextErrors, WholeNumber};

/// The description of a system, after all checks: its processors with their programs, its clock, and the settings of
/// its services. [`read`](Self::read) reads it from a TOML file.
///
/// ```
/// use condor_host::{application::Programs, description::SystemDescription};
///
/// let text = "name = \"robot\"\nwindow_bytes = 65536\n[[processors]]\nnumber = 1\nname = \"servo\"\n\
///     program = \"self\"\narguments = [\"servo\"]";
/// let programs = Programs::new(&[]);
/// let mistakes = SystemDescription::from_toml(text, "robot.toml".as_ref(), &programs).unwrap_err();
/// println!("{mistakes}"); // there is no program `servo`
/// ```
#[derive(Debug)]
pub struct SystemDescription {
    /// The file from which it was read, as an absolute path.
    pub file: PathBuf,
    /// The name of the system.
    pub name: String,
    /// The size of the users' region of each processor's `data`, in bytes.
    pub window_bytes: u32,
    /// The file with the configuration of the robot, if there is one.
    pub robot: Option<PathBuf>,
    /// The size of the bus to which the boards are connected, in bytes; `None` if there is no bus.
    pub bus_bytes: Option<u32>,
    /// The size of the shared memory that belongs to no processor, in bytes; `None` if there is
    /// none.
    pub shared_bytes: Option<u32>,
    /// The clock by which the processors run.
    pub clock: ClockKind,
    /// The directory that the file service serves, and the limits there; `None` if there is no file
    /// service.
    pub files: Option<Files>,
    /// The sizes of the records that the terminal service keeps of each terminal.
    pub terminals: TerminalSizes,
    /// The greatest number of restarts of a service in a minute. If it fails again, it has failed
    /// for good.
    pub service_restarts: u32,
    /// The processors, in the order in which they are started.
    pub processors: Vec<ProcessorEntry>,
    /// The entries of extensions in the system, in the order of the application.
    pub(crate) groups: Vec<Entry>,
}

/// The clock by which the processors of a system run: the real one, or a simulated one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ClockKind {
    /// The processors run by the real time.
    #[default]
    Real,
    /// The processors run by a simulated time of the system's own, at this speed.
    Simulated(ClockSpeed),
}

/// The speed of a simulated clock in thousandths of the real time; 0 means as fast as possible.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClockSpeed(pub u64);

impl ClockSpeed {
    /// The speed at which one simulated second takes one real second.
    pub const ONE: Self = Self(1000);
    /// The highest speed: simulated time goes on as fast as the programs compute.
    pub const MAX: Self = Self(0);
}

impl FromStr for ClockSpeed {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "max" {
            return Ok(Self::MAX);
        }
        let number = text.parse().ok().and_then(Self::times);
        number.ok_or_else(|| {
            format!("\"{text}\" is not a speed: a speed is a number from 0.001 to 1000, or `max`")
        })
    }
}

impl fmt::Display for ClockSpeed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::MAX => f.write_str("max"),
            Self(thousandths) => write!(f, "{}.{:03}", thousandths / 1000, thousandths % 1000),
        }
    }
}

impl<'de> Deserialize<'de> for ClockSpeed {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        /// Its errors are raised where the place of the value is still known.
        struct Word;

        impl Visitor<'_> for Word {
            type Value = ClockSpeed;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a number or `max`")
            }

            fn visit_str<E: de::Error>(self, text: &str) -> Result<ClockSpeed, E> {
                text.parse().map_err(E::custom)
            }

            fn visit_i64<E: de::Error>(self, number: i64) -> Result<ClockSpeed, E> {
                self.visit_str(&number.to_string())
            }

            fn visit_f64<E: de::Error>(self, number: f64) -> Result<ClockSpeed, E> {
                self.visit_str(&number.to_string())
            }
        }

        deserializer.deserialize_any(Word)
    }
}

impl ClockSpeed {
    /// So many times the real time, from 0.001 to 1000.
    fn times(factor: f64) -> Option<Self> {
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "the range is checked"
        )]
        (0.001..=1000.0)
            .contains(&factor)
            .then(|| Self((factor * 1000.0).round() as u64))
    }
}

/// The entry of an extension in a system.
#[derive(Debug)]
pub(crate) struct Entry {
    /// The name of the extension.
    pub(crate) name: &'static str,
    /// The processors of this kind.
    pub(crate) kind: Option<&'static str>,
    /// The name of the service.
    pub(crate) service: Option<&'static str>,
    pub(crate) group: Box<dyn Group>,
}

/// The settings of the file service, `[files]` in a description: the directory whose files programs can use, and the
/// limits there.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Files {
    /// The directory that the file service serves.
    pub root: PathBuf,
    /// Whether programs can change nothing in it.
    pub read_only: bool,
    /// The greatest size of all files together, in bytes; `None` means no limit.
    pub quota_bytes: Option<u64>,
    /// The greatest size of one file, in bytes; `None` means no limit.
    pub max_file_bytes: Option<u64>,
}

/// The settings of the terminal service, `[terminals]` in a description: the greatest sizes of the output that it keeps
/// of each terminal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TerminalSizes {
    /// The number of bytes of a terminal's earlier output that a new viewer gets.
    pub replay_bytes: u32,
    /// The size in bytes at which a log is rotated; one previous log is kept.
    pub log_bytes: u32,
}

impl Default for TerminalSizes {
    fn default() -> Self {
        Self {
            replay_bytes: 64 * 1024,
            log_bytes: 4 * 1024 * 1024,
        }
    }
}

/// A processor in a [`SystemDescription`], with its program and its settings: `[[processors]]` in the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ProcessorEntry {
    /// The number of the processor, 0 to 11.
    pub number: u8,
    /// The name of the processor, by which commands select it.
    pub name: String,
    /// The program that runs on it.
    pub program: ProgramEntry,
    /// The arguments of the program.
    pub arguments: Vec<String>,
    /// The lines that are typed at its terminal when all programs run, in a run without user
    /// interface.
    pub headless: Vec<String>,
    /// The kind of the processor: `process`, or the word of an extension.
    pub kind: &'static str,
    /// Whether its programs run on this machine.
    pub runs_here: bool,
    /// The reaction to a failure of its program.
    pub on_failure: OnFailure,
    /// The greatest number of restarts after failures in a minute. If it fails again, it has failed
    /// for good.
    pub restarts: u32,
    /// The times that its servo loops take in simulated time, in microseconds, the fastest loop
    /// first.
    pub loop_times_us: Vec<u32>,
    /// The servo loops that it declares.
    pub servo_loops: Vec<DeclaredLoop>,
    /// Whether a fatal error of its program holds it for a debugger; `None` means that it does in a system that is brought up
    /// in the user interface, if the program would be restarted.
    pub hold_exceptions: Option<bool>,
    /// Whether a floating-point exception in a servo loop is a fatal error.
    pub float_exceptions: bool,
    /// The number of seconds for which its heartbeat may stop before that is a failure; 0 means
    /// that it never is.
    pub stall_seconds: u32,
    /// The requests of its program that the supervisor carries out.
    pub may_ask: Vec<MayAsk>,
    /// The names of the parts of the robot that its program serves, instead of the processor that the robot's
    /// configuration names.
    pub serves: Vec<String>,
}

/// Returns the parts of the robot that these processors serve: for each the number of the processor, and the name of
/// the part.
#[must_use]
pub fn served(processors: &[ProcessorEntry]) -> Vec<(u8, &str)> {
    let parts = processors
        .iter()
        .flat_map(|one| one.serves.iter().map(|part| (one.number, part.as_str())));
    parts.collect()
}

/// A servo loop that a description declares for a processor: an element of `servo_loops`.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DeclaredLoop {
    /// The name of the loop.
    pub name: String,
    /// The greatest rate of the loop, in Hz, at least 1.
    pub hz: u32,
    /// The longest time of one run, without the loops that interrupt it, in µs.
    pub worst_us: u32,
    /// The longest time for which slower loops and the background delay a run, in µs.
    #[serde(default)]
    pub blocked_us: u32,
}

/// Returns the longest time from a release to the end of its run for each of the loops of one processor, in µs, as an
/// [`Analysis`] finds it; `None` for a loop that may not end within its period. At most 8 loops have a result.
#[must_use]
pub fn response_times_us(loops: &[DeclaredLoop]) -> Vec<Option<u64>> {
    // Slower than all others, and without a run.
    let none = Load::new(Rate::every_seconds(u32::MAX), 0);
    let mut loads = [none; LOOPS];
    for (load, one) in loads.iter_mut().zip(loops) {
        if let Some(rate) = Rate::new(one.hz, 1) {
            *load = Load::new(rate, one.worst_us).blocked(one.blocked_us);
        }
    }
    let analysis = Analysis::new(Rate::hz(1_000_000), loads);
    let response = |(id, _)| match analysis.response(LoopId(id))? {
        ResponseTime::Within(us) => Some(us),
        ResponseTime::Late | ResponseTime::Undecided => None,
    };
    (0..).zip(loops).take(LOOPS).map(response).collect()
}

/// A request that the program of a processor may send to the supervisor by message: an element of `may_ask` in a
/// description.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum MayAsk {
    /// To restart the program of any processor.
    Restart,
    /// To load a program that the description names on any processor.
    Load,
}

impl fmt::Display for MayAsk {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Restart => "restart",
            Self::Load => "load",
        })
    }
}

/// The program that a description names for a processor: `program` in the file.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ProgramEntry {
    /// A program of the running binary (`"self"`), named by the first argument.
    Own,
    /// The program in this file.
    File(PathBuf),
}

/// The reaction of the supervisor to a failure of a processor's program: `on_failure` in a description.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum OnFailure {
    /// The program is restarted.
    Restart,
    /// The whole system is stopped.
    Stop,
    /// The program stays ended, and the others go on.
    Leave,
}
