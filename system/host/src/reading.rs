//! From a text to a [`SystemDescription`] for an [`Application`].

mod processor;

use std::path::{Path, PathBuf};

use condor_platform::linux::read_text;
use condor_toml::{Keys, Misreading, SourceText, Spanned, TextErrors, WholeNumber};

use crate::application::Application;
use crate::description::{ClockKind, ClockSpeed, Entry, Files, SystemDescription, TerminalSizes};
use crate::error::{AnyError, remedy};
use crate::extension::{Extension, ExtensionPart, PROCESSES};
use crate::gateway::GATEWAY;
use crate::paths::beside;
use crate::robot::Robot;

const PAGE: i64 = 4096;
const MOST_BYTES: i64 = 1 << 30;
/// Names become those of files and of sockets, whose paths are short.
const LONGEST: usize = 32;

type Pages = WholeNumber<u32, PAGE, MOST_BYTES, PAGE>;
type Bytes = WholeNumber<u32, 0, MOST_BYTES>;
type Restarts = WholeNumber<u32, 0, 1_000_000>;

impl SystemDescription {
    /// Reads and checks the description in `file`. `application` has the programs and the extensions that the
    /// description may name.
    ///
    /// # Errors
    /// [`TextErrors`] with every mistake in the description, or only the first one if the file is
    /// not TOML.
    pub fn read(file: impl AsRef<Path>, application: &dyn Application) -> Result<Self, TextErrors> {
        let file = file.as_ref();
        let text = read_text(file).map_err(|error| {
            let fault = Misreading::from(format!("cannot read it: {error}{}", remedy(&error)));
            SourceText::new(&file.to_string_lossy(), "").error(fault)
        })?;
        Self::from_toml(&text, file, application)
    }

    /// Reads and checks the description `text`, as if it were the content of `file`: errors name `file`, and relative
    /// paths start at its directory. `application` has the programs and the extensions that the description may name.
    ///
    /// # Errors
    /// [`TextErrors`] with every mistake in the description, or only the first one if the text is
    /// not TOML.
    pub fn from_toml(
        text: &str,
        file: &Path,
        application: &dyn Application,
    ) -> Result<Self, TextErrors> {
        let name = file.to_string_lossy();
        let text = SourceText::new(&name, text);
        // Other commands read it again, from other directories.
        let file = std::path::absolute(file).map_err(|error| {
            text.error(Misreading::from(format!(
                "cannot find its directory: {error}"
            )))
        })?;
        let tree = text.parse()?;
        let top = text.keys(&tree);
        let own = Own {
            file: &file,
            application,
        };
        let description = top.and_then(|top| system(top, &own));
        text.finish(description)
    }
}

/// Reads the description in `file`, and returns the robot that it names, as `application` reads it. Returns `None` if
/// the description names no robot, or if `application` has none.
///
/// # Errors
/// Returns [`TextErrors`] with every mistake of the description; the application's error if the robot's
/// configuration is wrong.
pub fn robot_of(
    file: &Path,
    application: &dyn Application,
) -> Result<Option<Box<dyn Robot>>, AnyError> {
    let description = SystemDescription::read(file, application)?;
    match &description.robot {
        Some(robot) => application.robot(robot),
        None => Ok(None),
    }
}

/// The file of the description, and the application that it is for.
struct Own<'o> {
    file: &'o Path,
    application: &'o dyn Application,
}

fn system(mut top: Keys<'_, '_>, own: &Own<'_>) -> Option<SystemDescription> {
    let name = name(&mut top);
    let window_bytes: Option<Pages> = top.need("window_bytes", "a multiple of 4096");
    let robot: Option<Spanned<String>> = top.get("robot");
    let bus_bytes = top.table("bus").and_then(bytes_of);
    let shared_bytes = top.table("shared_memory").and_then(bytes_of);
    let extensions = extensions(&top, own.application);
    let tables = extensions
        .iter()
        .map(|extension| top.table(extension.table()?));
    let tables: Vec<_> = tables.collect();
    let clock = top.table("clock").and_then(clock);
    let files = top.table("files").and_then(|table| files(table, own));
    let terminals = top.table("terminals").map(terminals);
    let services = top.table("services").and_then(services);
    let expected = "`[[processors]]`, a table for each processor";
    let processors: Vec<_> = top
        .tables("processors", expected)
        .into_iter()
        .map(|table| processor::read(table, &extensions, own))
        .collect();
    processor::check(&top, &processors, &extensions);
    let robot = self::robot(&top, robot.as_ref(), &processors, own);
    top.finish();
    let mut groups = Vec::new();
    let (mut whole, mut rest) = (Vec::new(), Vec::new());
    for (common, kind, found) in processors {
        whole.push(common.whole());
        rest.push((kind, found));
    }
    for (place, (extension, keys)) in extensions.iter().zip(tables).enumerate() {
        let mine = rest.extract_if(.., |(kind, _)| *kind == place);
        let mut mine = ExtensionPart {
            file: own.file,
            keys,
            processors: mine.map(|(_, found)| found).collect(),
            window_bytes: window_bytes.map_or(PAGE as u32, |bytes| bytes.0),
            bus_bytes: bus_bytes.unwrap_or(0),
            shared_bytes: shared_bytes.unwrap_or(0),
            simulated: matches!(clock, Some(ClockKind::Simulated(_))),
        };
        if mine.keys.is_some() || !mine.processors.is_empty() {
            let group = extension.read(&mut mine);
            groups.push(group.map(|group| Entry {
                name: extension.name(),
                kind: extension.kind(),
                service: extension.table(),
                group,
            }));
        }
        let processors = mine.processors.into_iter().map(|processor| processor.keys);
        processors.chain(mine.keys).for_each(Keys::finish);
    }
    // An optional part that is wrong is `None` here; its mistake has been noted.
    Some(SystemDescription {
        file: own.file.into(),
        name: name?.into_inner(),
        window_bytes: window_bytes?.0,
        robot,
        bus_bytes,
        shared_bytes,
        clock: clock.unwrap_or_default(),
        files,
        terminals: terminals.unwrap_or_default(),
        service_restarts: services.unwrap_or(20),
        processors: whole.into_iter().collect::<Option<_>>()?,
        groups: groups.into_iter().collect::<Option<_>>()?,
    })
}

/// All extensions that there are. Of two with the same kind only one could launch its processors, and both
/// would make their windows.
fn extensions(top: &Keys<'_, '_>, application: &dyn Application) -> Vec<&'static dyn Extension> {
    let mut all = vec![PROCESSES, GATEWAY];
    for &new in application.extensions() {
        for old in &all {
            let (new_name, old_name) = (new.name(), old.name());
            for (what, word, taken) in [
                ("kind of processors", new.kind(), old.kind()),
                ("table", new.table(), old.table()),
            ] {
                if let Some(word) = word.filter(|_| word == taken) {
                    let problem = format!(
                        "this program has two extensions for the {what} `{word}`: {old_name} and {new_name}; \
                         it must register only one of them"
                    );
                    top.wrong(&(0..0), problem);
                }
            }
        }
        all.push(new);
    }
    all
}

fn name(keys: &mut Keys<'_, '_>) -> Option<Spanned<String>> {
    let name: Spanned<String> = keys.need("name", "a name in quotes")?;
    let allowed = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    if (1..=LONGEST).contains(&name.get_ref().len()) && name.get_ref().chars().all(allowed) {
        return Some(name);
    }
    let problem = format!(
        "\"{name}\" cannot be a name: a name has 1 to {LONGEST} letters, digits, `-` and `_`"
    );
    keys.wrong(&name.span(), problem);
    None
}

fn clock(mut keys: Keys<'_, '_>) -> Option<ClockKind> {
    let kind = keys.word("kind", &[("real", false), ("simulated", true)]);
    let speed: Option<Spanned<ClockSpeed>> = keys.get("speed");
    if let (Some(speed), Some(false) | None) = (&speed, kind) {
        let problem = "a real clock has no speed; with `kind = \"simulated\"` the system has a clock of its own";
        keys.wrong(&speed.span(), problem);
    }
    keys.finish();
    let speed = speed.map_or(ClockSpeed::ONE, Spanned::into_inner);
    Some(if kind? {
        ClockKind::Simulated(speed)
    } else {
        ClockKind::Real
    })
}

/// Reads the number in a table that has only the key `bytes`.
fn bytes_of(mut keys: Keys<'_, '_>) -> Option<u32> {
    let bytes: Option<Pages> = keys.need("bytes", "a multiple of 4096");
    keys.finish();
    Some(bytes?.0)
}

fn files(mut keys: Keys<'_, '_>, own: &Own<'_>) -> Option<Files> {
    let root = keys.need("root", "the path of the directory that is served");
    let root = root.map(|root| directory(&keys, &root, own));
    let read_only = keys.get("read_only");
    let quota_bytes = keys.get("quota_bytes");
    let max_file_bytes = keys.get("max_file_bytes");
    keys.finish();
    Some(Files {
        root: root?,
        read_only: read_only.unwrap_or(false),
        quota_bytes,
        max_file_bytes,
    })
}

/// The directory that is served; one that is not there yet will be made.
fn directory(keys: &Keys<'_, '_>, root: &Spanned<String>, own: &Own<'_>) -> PathBuf {
    let path = beside(own.file, root.get_ref());
    if std::fs::metadata(&path).is_ok_and(|metadata| !metadata.is_dir()) {
        let shown = path.display();
        let problem = format!(
            "{shown} is not a directory; name a directory, or a path at which one can be made"
        );
        keys.wrong(&root.span(), problem);
    }
    path
}

/// The configuration of the robot, which must be right, too, with the parts that the processors serve.
fn robot(
    keys: &Keys<'_, '_>,
    robot: Option<&Spanned<String>>,
    processors: &[processor::Read<'_, '_>],
    own: &Own<'_>,
) -> Option<PathBuf> {
    let served = processors.iter().filter_map(|(common, ..)| common.served());
    let served: Vec<_> = served.collect();
    let place = served.first().map(|(_, parts)| parts.span());
    let Some(robot) = robot else {
        if let Some(place) = place {
            keys.wrong(
                &place,
                "there is no robot: name its file by the key `robot`",
            );
        }
        return None;
    };
    let path = beside(own.file, robot.get_ref());
    let checked = own.application.check_robot(&path, &[]);
    if let Err(error) = checked {
        keys.wrong(&robot.span(), error);
    } else if let Some(place) = place {
        let parts = served.iter().flat_map(|(number, parts)| {
            parts.get_ref().iter().map(|part| (*number, part.as_str()))
        });
        let parts: Vec<_> = parts.collect();
        if let Err(error) = own.application.check_robot(&path, &parts) {
            keys.wrong(&place, error);
        }
    }
    Some(path)
}

/// Reads the number of restarts of a service.
fn services(mut keys: Keys<'_, '_>) -> Option<u32> {
    let restarts: Option<Restarts> = keys.get("restarts");
    keys.finish();
    Some(restarts?.0)
}

fn terminals(mut keys: Keys<'_, '_>) -> TerminalSizes {
    let default = TerminalSizes::default();
    let replay_bytes: Option<Bytes> = keys.get("replay_bytes");
    let replay_bytes = replay_bytes.map_or(default.replay_bytes, |bytes| bytes.0);
    let log_bytes: Option<Spanned<Bytes>> = keys.get("log_bytes");
    // The output that is shown of the past must exist even when a new log has just begun.
    let least = replay_bytes.max(PAGE as u32);
    let log_bytes = match log_bytes {
        Some(log_bytes) => {
            let WholeNumber(bytes) = *log_bytes.get_ref();
            if bytes < least {
                let problem = format!("{bytes} is too small; it must be at least {least}");
                keys.wrong(&log_bytes.span(), problem);
            }
            bytes
        }
        None => default.log_bytes.max(replay_bytes),
    };
    keys.finish();
    TerminalSizes {
        replay_bytes,
        log_bytes,
    }
}
