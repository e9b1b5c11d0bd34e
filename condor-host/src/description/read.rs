//! From the text to a [`Description`].

use core::ops::{Range, RangeInclusive};
use std::path::{Path, PathBuf};

use toml::de::DeTable;

use super::check::{self, Own};
use super::mistake::{Mistake, Mistakes, Problem};
use super::tree::{At, Table, Text};
use super::{
    Bus, Description, Files, Kind, Loops, Machine, MachineKind, OnFailure, Processor, Program,
    Terminals,
};
use crate::cli::Application;
use crate::harts::map::HARTS;
use condor_rt::numbers::PROGRAMS;

const PAGE: i64 = 4096;
const MIB: i64 = 1 << 20;
/// The numbers that a hart may have.
pub(super) const HART_NUMBERS: RangeInclusive<i64> = 0..=HARTS as i64 - 1;
const MOST_BYTES: i64 = 1 << 30;
const RESTARTS: RangeInclusive<i64> = 0..=1_000_000;
/// Names become those of files and of sockets, whose paths are short.
const LONGEST: usize = 32;

impl Description {
    /// Reads and checks the description in `file`, for this application.
    ///
    /// # Errors
    /// Every mistake that there is.
    pub fn read(file: impl AsRef<Path>, application: &dyn Application) -> Result<Self, Mistakes> {
        let file = file.as_ref();
        let name = file.to_string_lossy();
        let text = std::fs::read_to_string(file).map_err(|error| {
            let problem = Problem::Unreadable(error);
            Mistakes(vec![Mistake::at(&name, "", &(0..0), problem)])
        })?;
        Self::from_toml(&text, file, application)
    }

    /// As [`read`](Self::read), of a text that stands in `file`.
    ///
    /// # Errors
    /// As there.
    pub fn from_toml(
        text: &str,
        file: &Path,
        application: &dyn Application,
    ) -> Result<Self, Mistakes> {
        let name = file.to_string_lossy();
        let (table, errors) = DeTable::parse_recoverable(text);
        let mut text = Text::new(&name, text);
        for error in errors {
            text.syntax(&error.span().unwrap_or_default(), error.message());
        }
        let top = Table::new(&text, table.get_ref(), 0..0);
        let description = system(&text, top, &Own { file, application });
        // A value is missing only where something was found to be wrong.
        match description {
            Some(description) if text.is_right() => Ok(description),
            _ => Err(text.into_mistakes()),
        }
    }
}

fn system(text: &Text<'_>, mut top: Table<'_, '_>, own: &Own<'_>) -> Option<Description> {
    let name = name(text, &mut top);
    let memory = top.span_within("machine", "memory_bytes");
    let window_bytes = top.number("window_bytes", PAGE..=MOST_BYTES, PAGE);
    let robot = top.optional_text("robot", "the path of the robot's configuration");
    let bus = top.table("bus").map(bus);
    let machine = top.table("machine").map(|table| machine(text, table, own));
    let files = top.table("files").map(|table| files(text, table, own));
    let terminals = top.table("terminals").map(terminals);
    let services = top.table("services").and_then(services);
    let expected = "`[[processors]]`, a table for each processor";
    let processors: Vec<_> = top
        .tables("processors", expected)
        .into_iter()
        .map(|table| processor(text, table, own))
        .collect();
    top.finish();
    check::processors(text, &processors);
    let span = machine.as_ref().map(|(_, span)| span);
    check::harts(text, &processors, span);
    let robot = robot.map(|robot| check::robot(text, &robot, own));
    let machine = match machine {
        Some((machine, _)) => Some(machine?),
        None => None,
    };
    let places: Vec<_> = processors.iter().map(Found::places).collect();
    let description = Description {
        file: own.file.into(),
        name: name?.value,
        window_bytes: u32::try_from(window_bytes?.value).ok()?,
        robot,
        bus: match bus {
            Some(bus) => Some(bus?),
            None => None,
        },
        machine,
        files: match files {
            Some(files) => Some(files?),
            None => None,
        },
        terminals: terminals.unwrap_or_default(),
        service_restarts: services.unwrap_or(20),
        processors: processors
            .into_iter()
            .map(Found::whole)
            .collect::<Option<_>>()?,
    };
    if text.is_right() {
        let memory = memory.unwrap_or(0..0);
        check::programs_of_harts(text, &description, &memory, &places);
    }
    Some(description)
}

/// The machine, and where it stands.
fn machine(
    text: &Text<'_>,
    mut table: Table<'_, '_>,
    own: &Own<'_>,
) -> (Option<Machine>, Range<usize>) {
    let span = table.span();
    let kinds = [("qemu-riscv-virt", MachineKind::QemuRiscvVirt)];
    let kind = table.word("kind", &kinds);
    let memory_bytes = table.number("memory_bytes", MIB..=MOST_BYTES, MIB);
    let monitor = table.text(
        "monitor",
        "the path of the program in which the harts come up",
    );
    let qemu = table.optional_text("qemu", "the program that is the machine");
    let options = table.texts("options");
    table.finish();
    let whole = || {
        let (monitor, qemu) = (
            monitor.map(|monitor| check::monitor(text, &monitor, own)),
            check::qemu(text, qemu, &span, own),
        );
        Some(Machine {
            kind: kind.unwrap_or(MachineKind::QemuRiscvVirt),
            memory_bytes: u32::try_from(memory_bytes?.value).ok()?,
            monitor: monitor?,
            qemu: qemu?,
            options: options.map(|options| options.value).unwrap_or_default(),
        })
    };
    (whole(), span.clone())
}

fn name(text: &Text<'_>, table: &mut Table<'_, '_>) -> Option<At<String>> {
    let name = table.text("name", "a name in quotes")?;
    let allowed = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    let len = name.value.len();
    if (1..=LONGEST).contains(&len) && name.value.chars().all(allowed) {
        return Some(name);
    }
    let problem = Problem::BadName {
        name: name.value,
        longest: LONGEST,
    };
    text.wrong(&name.span, problem);
    None
}

fn bus(mut table: Table<'_, '_>) -> Option<Bus> {
    let bytes = table.number("bytes", PAGE..=MOST_BYTES, PAGE);
    table.finish();
    Some(Bus {
        bytes: u32::try_from(bytes?.value).ok()?,
    })
}

fn files(text: &Text<'_>, mut table: Table<'_, '_>, own: &Own<'_>) -> Option<Files> {
    let root = table.text("root", "the path of the directory that is served");
    let read_only = table.boolean("read_only").unwrap_or(false);
    let quota_bytes = table.optional_number("quota_bytes", 0..=i64::MAX);
    let max_file_bytes = table.optional_number("max_file_bytes", 0..=i64::MAX);
    table.finish();
    Some(Files {
        root: check::directory(text, &root?, own),
        read_only,
        quota_bytes: quota_bytes.map(i64::unsigned_abs),
        max_file_bytes: max_file_bytes.map(i64::unsigned_abs),
    })
}

/// How often a service is started again.
fn services(mut table: Table<'_, '_>) -> Option<u32> {
    let restarts = table.optional_number("restarts", RESTARTS);
    table.finish();
    u32::try_from(restarts?).ok()
}

fn terminals(mut table: Table<'_, '_>) -> Terminals {
    let default = Terminals::default();
    let small = |value: Option<i64>| value.and_then(|value| u32::try_from(value).ok());
    let replay_bytes = small(table.optional_number("replay_bytes", 0..=MOST_BYTES));
    let replay_bytes = replay_bytes.unwrap_or(default.replay_bytes);
    // What is shown of the past must be there, even when a new log has just begun.
    let least = i64::from(replay_bytes).max(PAGE);
    let log_bytes = small(table.optional_number("log_bytes", least..=MOST_BYTES));
    table.finish();
    Terminals {
        replay_bytes,
        log_bytes: log_bytes.unwrap_or(default.log_bytes.max(replay_bytes)),
    }
}

/// A processor, of which some may be missing.
pub(super) struct Found {
    pub(super) number: Option<At<u8>>,
    pub(super) name: Option<At<String>>,
    program: Option<Program>,
    arguments: Vec<String>,
    headless: Vec<String>,
    kind: Kind,
    /// Of a hart: where its number, its program and its arguments stand.
    pub(super) hart: Option<At<u32>>,
    places: Places,
    loops: Loops,
    cpu: Option<u32>,
    priority: Option<u8>,
    on_failure: OnFailure,
    restarts: u32,
    stall_seconds: u32,
}

impl Found {
    fn places(&self) -> Places {
        self.places.clone()
    }

    fn whole(self) -> Option<Processor> {
        Some(Processor {
            number: self.number?.value,
            name: self.name?.value,
            program: self.program?,
            arguments: self.arguments,
            headless: self.headless,
            kind: self.kind,
            loops: self.loops,
            cpu: self.cpu,
            priority: self.priority,
            on_failure: self.on_failure,
            restarts: self.restarts,
            stall_seconds: self.stall_seconds,
        })
    }
}

/// Where what is checked at last stands.
#[derive(Clone)]
pub(super) struct Places {
    pub(super) program: Range<usize>,
    pub(super) arguments: Range<usize>,
}

fn processor(text: &Text<'_>, mut table: Table<'_, '_>, own: &Own<'_>) -> Found {
    let range = i64::from(*PROGRAMS.start())..=i64::from(*PROGRAMS.end());
    let number = table.number("number", range, 1).and_then(|number| {
        let value = u8::try_from(number.value).ok()?;
        let span = number.span;
        Some(At { value, span })
    });
    let name = name(text, &mut table);
    let program = table.text("program", "\"self\", or the path of a program");
    let arguments = table.texts("arguments");
    let headless = table.texts("headless");
    let kinds = [("process", false), ("hart", true)];
    let is_hart = table.word("kind", &kinds).unwrap_or(false);
    let hart = check::keys_of_kind(text, &mut table, is_hart);
    let loops = table.word("loops", &Loops::ALL.map(|loops| (loops.word(), loops)));
    let cpu = table.optional_number("cpu", 0..=1023);
    let priority = table.optional_number("priority", 1..=99);
    let on_failure = table.word(
        "on_failure",
        &[
            ("restart", OnFailure::Restart),
            ("stop", OnFailure::Stop),
            ("leave", OnFailure::Leave),
        ],
    );
    let restarts = table.optional_number("restarts", RESTARTS);
    let stall_seconds = table.optional_number("stall_seconds", 0..=86400);
    let small = |value: Option<i64>| value.and_then(|value| u32::try_from(value).ok());
    let at = |key| table.span_of(key).unwrap_or_else(|| table.span());
    let places = Places {
        program: at("program"),
        arguments: at("arguments"),
    };
    table.finish();
    Found {
        program: program.and_then(|program| {
            if is_hart {
                check::program_of_hart(text, &program, own)
            } else {
                check::program(text, &program, arguments.as_ref(), own)
            }
        }),
        places,
        number,
        name,
        arguments: arguments
            .map(|arguments| arguments.value)
            .unwrap_or_default(),
        headless: headless.map(|lines| lines.value).unwrap_or_default(),
        kind: hart
            .as_ref()
            .map_or(Kind::Process, |hart| Kind::Hart(hart.value)),
        hart,
        loops: loops.unwrap_or_default(),
        cpu: small(cpu),
        priority: priority.and_then(|priority| u8::try_from(priority).ok()),
        on_failure: on_failure.unwrap_or(OnFailure::Restart),
        restarts: small(restarts).unwrap_or(10),
        stall_seconds: small(stall_seconds).unwrap_or(5),
    }
}

/// `path` as the description in `file` means it.
pub(crate) fn beside(file: &Path, path: &str) -> PathBuf {
    let directory = file.parent().unwrap_or(Path::new(""));
    let joined = directory.join(path);
    std::path::absolute(&joined).unwrap_or(joined)
}
