//! From the text to a [`Description`].

use core::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use toml::de::DeTable;

use super::check::{self, Own};
use super::mistake::{Mistake, Mistakes, Problem};
use super::tree::{At, Keys, Text};
use super::{Description, Entry, Files, OnFailure, ProcessorEntry, ProgramEntry, Terminals};
use crate::cli::Application;
use crate::extension::{Extension, Found, FoundProcessor, PROCESSES};
use condor_rt::numbers::PROGRAMS;

const PAGE: i64 = 4096;
const MOST_BYTES: i64 = 1 << 30;
const RESTARTS: RangeInclusive<i64> = 0..=1_000_000;
/// Names become those of files and of sockets, whose paths are short.
const LONGEST: usize = 32;

impl Description {
    /// Reads and checks the description in `file`, for this application.
    ///
    /// # Errors
    /// [`Mistakes`] with every mistake in the description.
    pub fn read(file: impl AsRef<Path>, application: &dyn Application) -> Result<Self, Mistakes> {
        let file = file.as_ref();
        let name = file.to_string_lossy();
        let text = std::fs::read_to_string(file).map_err(|error| {
            let problem = Problem::Unreadable(error);
            Mistakes(vec![Mistake::at(&name, "", &(0..0), problem)])
        })?;
        Self::from_toml(&text, file, application)
    }

    /// Reads and checks the description `text`, as if it were the content of `file`.
    ///
    /// # Errors
    /// [`Mistakes`] with every mistake in the description.
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
        let top = Keys::new(&text, table.get_ref(), 0..0);
        let description = system(&text, top, &Own { file, application });
        // A value is missing only where something was found to be wrong.
        match description {
            Some(description) if text.is_right() => Ok(description),
            _ => Err(text.into_mistakes()),
        }
    }
}

fn system(text: &Text<'_>, mut top: Keys<'_, '_>, own: &Own<'_>) -> Option<Description> {
    let name = name(text, &mut top);
    let window_bytes = top.number("window_bytes", PAGE..=MOST_BYTES, PAGE);
    let robot = top.optional_text("robot", "the path of the robot's configuration");
    let bus_bytes = top.table("bus").map(bytes_of);
    let shared_bytes = top.table("shared_memory").map(bytes_of);
    let extensions = extensions(own.application);
    let tables = extensions
        .iter()
        .map(|extension| top.table(extension.table()?));
    let tables: Vec<_> = tables.collect();
    let files = top.table("files").map(|table| files(text, table, own));
    let terminals = top.table("terminals").map(terminals);
    let services = top.table("services").and_then(services);
    let expected = "`[[processors]]`, a table for each processor";
    let processors: Vec<_> = top
        .tables("processors", expected)
        .into_iter()
        .map(|table| processor(text, table, &extensions, own))
        .collect();
    top.finish();
    check::processors(text, &processors, &extensions);
    let robot = robot.map(|robot| check::robot(text, &robot, own));
    let bytes = |value: Option<At<i64>>| value.and_then(|it| u32::try_from(it.value).ok());
    let window_bytes = bytes(window_bytes);
    let mut groups = Vec::new();
    let (mut whole, mut rest) = (Vec::new(), Vec::new());
    for (common, kind, found) in processors {
        whole.push(common.whole());
        rest.push((kind, found));
    }
    for (place, (extension, keys)) in extensions.iter().zip(tables).enumerate() {
        let mine = rest.extract_if(.., |(kind, _)| *kind == place);
        let mut mine = Found {
            file: own.file,
            keys,
            processors: mine.map(|(_, found)| found).collect(),
            window_bytes: window_bytes.unwrap_or(PAGE as u32),
            bus_bytes: bus_bytes.flatten().unwrap_or(0),
            shared_bytes: shared_bytes.flatten().unwrap_or(0),
        };
        if mine.keys.is_some() || !mine.processors.is_empty() {
            let group = extension.read(&mut mine);
            groups.push(group.map(|group| Entry {
                kind: extension.kind(),
                service: extension.table(),
                group,
            }));
        }
        let processors = mine.processors.into_iter().map(|processor| processor.keys);
        processors.chain(mine.keys).for_each(Keys::finish);
    }
    Some(Description {
        file: own.file.into(),
        name: name?.value,
        window_bytes: window_bytes?,
        robot,
        bus_bytes: match bus_bytes {
            Some(bytes) => Some(bytes?),
            None => None,
        },
        shared_bytes: match shared_bytes {
            Some(bytes) => Some(bytes?),
            None => None,
        },
        files: match files {
            Some(files) => Some(files?),
            None => None,
        },
        terminals: terminals.unwrap_or_default(),
        service_restarts: services.unwrap_or(20),
        processors: whole.into_iter().collect::<Option<_>>()?,
        groups: groups.into_iter().collect::<Option<_>>()?,
    })
}

/// All extensions that there are.
fn extensions(application: &dyn Application) -> Vec<&'static dyn Extension> {
    let mut all = vec![PROCESSES];
    all.extend_from_slice(application.extensions());
    all
}

fn name(text: &Text<'_>, table: &mut Keys<'_, '_>) -> Option<At<String>> {
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

/// What a table says that has the key `bytes` alone.
fn bytes_of(mut table: Keys<'_, '_>) -> Option<u32> {
    let bytes = table.number("bytes", PAGE..=MOST_BYTES, PAGE);
    table.finish();
    u32::try_from(bytes?.value).ok()
}

fn files(text: &Text<'_>, mut table: Keys<'_, '_>, own: &Own<'_>) -> Option<Files> {
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
fn services(mut table: Keys<'_, '_>) -> Option<u32> {
    let restarts = table.optional_number("restarts", RESTARTS);
    table.finish();
    u32::try_from(restarts?).ok()
}

fn terminals(mut table: Keys<'_, '_>) -> Terminals {
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

/// What all processors have; of one that is wrong, some may be missing.
pub(super) struct Common {
    pub(super) number: Option<At<u8>>,
    pub(super) name: Option<At<String>>,
    program: Option<ProgramEntry>,
    arguments: Vec<String>,
    headless: Vec<String>,
    kind: &'static str,
    runs_here: bool,
    on_failure: OnFailure,
    restarts: u32,
    stall_seconds: u32,
}

impl Common {
    fn whole(self) -> Option<ProcessorEntry> {
        Some(ProcessorEntry {
            number: self.number?.value,
            name: self.name?.value,
            program: self.program?,
            arguments: self.arguments,
            headless: self.headless,
            kind: self.kind,
            runs_here: self.runs_here,
            on_failure: self.on_failure,
            restarts: self.restarts,
            stall_seconds: self.stall_seconds,
        })
    }
}

/// A processor, and what is left for the extension of this place.
pub(super) type Read<'a, 't> = (Common, usize, FoundProcessor<'a, 't>);

fn processor<'a, 't>(
    text: &Text<'_>,
    mut table: Keys<'a, 't>,
    extensions: &[&'static dyn Extension],
    own: &Own<'_>,
) -> Read<'a, 't> {
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
    let kinds = extensions.iter().enumerate();
    let kinds = kinds.filter_map(|(place, it)| Some((it.kind()?, (place, it.runs_here()))));
    let kinds: Vec<_> = kinds.collect();
    let (place, runs_here) = table.word("kind", &kinds).unwrap_or((0, true));
    let kind = extensions.get(place).and_then(|it| it.kind());
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
    let span = program.as_ref().map(|program| program.span.clone());
    let program = program.and_then(|program| {
        if runs_here {
            check::program(text, &program, arguments.as_ref(), own)
        } else {
            check::file(text, &program, own)
        }
    });
    let arguments = arguments.unwrap_or_else(|| At {
        value: Vec::new(),
        span: table.span(),
    });
    let common = Common {
        program: program.clone(),
        number: number.clone(),
        name,
        arguments: arguments.value.clone(),
        headless: headless.map(|lines| lines.value).unwrap_or_default(),
        kind: kind.unwrap_or_default(),
        runs_here,
        on_failure: on_failure.unwrap_or(OnFailure::Restart),
        restarts: small(restarts).unwrap_or(10),
        stall_seconds: small(stall_seconds).unwrap_or(5),
    };
    let file = match program {
        Some(ProgramEntry::File(value)) => span.map(|span| At { value, span }),
        _ => None,
    };
    let found = FoundProcessor {
        number: number.map(|number| number.value),
        keys: table,
        program: file,
        arguments,
    };
    (common, place, found)
}

/// Returns the path that `path` denotes in the description in `file`; it is relative to that file.
#[must_use]
pub fn beside(file: &Path, path: &str) -> PathBuf {
    let directory = file.parent().unwrap_or(Path::new(""));
    let joined = directory.join(path);
    std::path::absolute(&joined).unwrap_or(joined)
}
