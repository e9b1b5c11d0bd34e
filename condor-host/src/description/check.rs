//! Whether what a description names is there, and goes together.

use core::ops::Range;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use super::mistake::{Problem, nearest};
use super::read::{Found, HART_NUMBERS, Places, beside};
use super::tree::{At, Table, Text};
use super::{Description, Kind, Program};
use crate::cli::{Application, names};
use crate::harts::{ARGUMENT_BYTES, Image};
use condor_rt::numbers::PROGRAMS;

/// Where the description stands, and for which application.
pub(super) struct Own<'o> {
    pub(super) file: &'o Path,
    pub(super) application: &'o dyn Application,
}

/// The program that is a machine of harts, if no other is named.
const QEMU: &str = "qemu-system-riscv64";

/// What a command would take for a processor.
const SERVICES: [&str; 4] = ["files", "machine", "terminals", "supervisor"];

pub(super) fn processors(text: &Text<'_>, all: &[Found]) {
    for (index, one) in all.iter().enumerate() {
        let above = all.get(..index).unwrap_or_default();
        if let Some(name) = &one.name {
            if SERVICES.contains(&name.value.as_str()) {
                let name_ = name.value.clone();
                text.wrong(&name.span, Problem::ServiceName { name: name_ });
            }
            let mut others = above.iter().filter_map(|other| other.name.as_ref());
            if let Some(other) = others.find(|other| other.value == name.value) {
                let line = text.line(other.span.start);
                let problem = Problem::DuplicateName {
                    name: name.value.clone(),
                    line,
                };
                text.wrong(&name.span, problem);
            }
        }
        if let Some(number) = &one.number {
            let mut others = above.iter().filter_map(|other| other.number.as_ref());
            if let Some(other) = others.find(|other| other.value == number.value) {
                let taken = |free: &u8| {
                    let mut numbers = all.iter().filter_map(|one| one.number.as_ref());
                    numbers.any(|number| number.value == *free)
                };
                let problem = Problem::DuplicateNumber {
                    number: number.value,
                    line: text.line(other.span.start),
                    free: PROGRAMS.filter(|number| !taken(number)).collect(),
                };
                text.wrong(&number.span, problem);
            }
        }
    }
}

/// The number of a hart, and no key that a processor of this kind has no use for.
pub(super) fn keys_of_kind(
    text: &Text<'_>,
    table: &mut Table<'_, '_>,
    is_hart: bool,
) -> Option<At<u32>> {
    let (keys, kind): (&[_], _) = if is_hart {
        (&["loops", "cpu", "priority"], "process")
    } else {
        (&["hart"], "hart")
    };
    for key in keys {
        if let Some(span) = table.span_of(key) {
            text.wrong(&span, Problem::KeyOfOtherKind { key, kind });
        }
    }
    if !is_hart {
        let _ = table.optional_number_at("hart", HART_NUMBERS);
        return None;
    }
    let number = table.number("hart", HART_NUMBERS, 1)?;
    let value = u32::try_from(number.value).ok()?;
    let span = number.span;
    Some(At { value, span })
}

/// Harts are those of the machine at `machine`, each is one processor, and none is left out.
pub(super) fn harts(text: &Text<'_>, all: &[Found], machine: Option<&Range<usize>>) {
    let harts: Vec<_> = all.iter().filter_map(|one| one.hart.as_ref()).collect();
    match (machine, harts.first()) {
        (Some(span), None) => text.wrong(span, Problem::MachineWithoutHarts),
        (None, Some(first)) => text.wrong(&first.span, Problem::HartWithoutMachine),
        _ => {}
    }
    for (index, one) in harts.iter().enumerate() {
        let mut above = harts.iter().take(index);
        if let Some(other) = above.find(|other| other.value == one.value) {
            let problem = Problem::DuplicateHart {
                hart: one.value,
                line: text.line(other.span.start),
            };
            text.wrong(&one.span, problem);
        }
    }
    if let Some(last) = harts.iter().max_by_key(|hart| hart.value) {
        let is_missing = |wanted: &u32| harts.iter().all(|hart| hart.value != *wanted);
        if let Some(missing) = (0..last.value).find(is_missing) {
            let hart = last.value;
            text.wrong(&last.span, Problem::MissingHart { hart, missing });
        }
    }
}

/// The file of a hart's program, which is looked at when all else is right.
pub(super) fn program_of_hart(
    text: &Text<'_>,
    program: &At<String>,
    own: &Own<'_>,
) -> Option<Program> {
    if program.value == "self" {
        text.wrong(&program.span, Problem::OwnProgramOnHart);
        return None;
    }
    Some(Program::File(beside(own.file, &program.value)))
}

/// The memory has room for everything, and each hart for its program.
pub(super) fn programs_of_harts(
    text: &Text<'_>,
    description: &Description,
    memory: &Range<usize>,
    places: &[Places],
) {
    let map = match description.map() {
        None => return,
        Some(Ok(map)) => map,
        Some(Err(error)) => return text.wrong(memory, Problem::Memory(error)),
    };
    for (processor, places) in description.processors.iter().zip(places) {
        let (Kind::Hart(hart), Program::File(path)) = (processor.kind, &processor.program) else {
            continue;
        };
        let path = path.clone();
        match std::fs::read(&path) {
            Ok(bytes) => {
                if let Err(source) = Image::new(&bytes, &map, hart) {
                    let problem = Problem::HartProgram { path, hart, source };
                    text.wrong(&places.program, problem);
                }
            }
            Err(source) => text.wrong(&places.program, Problem::NoFile { path, source }),
        }
        let found = processor.arguments.iter().map(|one| one.len() + 1).sum();
        if found > ARGUMENT_BYTES {
            text.wrong(&places.arguments, Problem::LongArguments { found });
        }
    }
}

/// The program in which harts come up.
pub(super) fn monitor(text: &Text<'_>, monitor: &At<String>, own: &Own<'_>) -> PathBuf {
    let path = beside(own.file, &monitor.value);
    if let Err(source) = std::fs::File::open(&path) {
        let path = path.clone();
        text.wrong(&monitor.span, Problem::NoFile { path, source });
    }
    path
}

/// The program that is the machine, for the table at `machine`.
pub(super) fn qemu(
    text: &Text<'_>,
    qemu: Option<At<String>>,
    machine: &Range<usize>,
    own: &Own<'_>,
) -> Option<PathBuf> {
    let qemu = qemu.unwrap_or_else(|| At {
        value: QEMU.into(),
        span: machine.clone(),
    });
    match find_program(own.file, &qemu.value) {
        Ok(path) => Some(path),
        Err(Problem::NoProgram { program, .. }) => {
            text.wrong(&qemu.span, Problem::NoQemu { command: program });
            None
        }
        Err(other) => {
            text.wrong(&qemu.span, other);
            None
        }
    }
}

pub(super) fn program(
    text: &Text<'_>,
    program: &At<String>,
    arguments: Option<&At<Vec<String>>>,
    own: &Own<'_>,
) -> Option<Program> {
    if program.value != "self" {
        return match find_program(own.file, &program.value) {
            Ok(path) => Some(Program::File(path)),
            Err(problem) => {
                text.wrong(&program.span, problem);
                None
            }
        };
    }
    let known = names(own.application);
    let first = arguments.and_then(|arguments| arguments.value.first());
    let Some(word) = first else {
        text.wrong(&program.span, Problem::WhichOwnProgram { known });
        return None;
    };
    if !known.contains(&word.as_str()) {
        let problem = Problem::NoOwnProgram {
            word: word.clone(),
            nearest: nearest(word, &known),
            known,
        };
        let span = arguments.map_or(&program.span, |arguments| &arguments.span);
        text.wrong(span, problem);
        return None;
    }
    Some(Program::Own)
}

/// The file of a program: relative to the description in `file`, else beside the running program,
/// else in `PATH`.
///
/// # Errors
/// [`Problem::NoProgram`], [`Problem::NotExecutable`].
pub(crate) fn find_program(file: &Path, name: &str) -> Result<PathBuf, Problem> {
    let mut looked = vec![beside(file, name)];
    if let Ok(own) = std::env::current_exe() {
        looked.push(own.with_file_name(name));
    }
    let path = std::env::var_os("PATH").unwrap_or_default();
    let in_path = std::env::split_paths(&path).map(|directory| directory.join(name));
    // A name with a slash is a path, and not looked for.
    let in_path = in_path.filter(|_| !name.contains('/'));
    for place in looked.iter().cloned().chain(in_path) {
        if let Ok(metadata) = std::fs::metadata(&place) {
            if metadata.is_file() && metadata.permissions().mode() & 0o111 != 0 {
                return Ok(place);
            }
            return Err(Problem::NotExecutable { path: place });
        }
    }
    Err(Problem::NoProgram {
        program: name.into(),
        looked,
    })
}

/// The directory that is served; one that is not there yet will be made.
pub(super) fn directory(text: &Text<'_>, root: &At<String>, own: &Own<'_>) -> PathBuf {
    let path = beside(own.file, &root.value);
    if std::fs::metadata(&path).is_ok_and(|metadata| !metadata.is_dir()) {
        let path = path.clone();
        text.wrong(&root.span, Problem::NoDirectory { path });
    }
    path
}

/// The configuration of the robot, which must be right, too.
pub(super) fn robot(text: &Text<'_>, robot: &At<String>, own: &Own<'_>) -> PathBuf {
    let path = beside(own.file, &robot.value);
    if let Err(error) = own.application.check_robot(&path) {
        text.wrong(&robot.span, Problem::Robot(error.to_string()));
    }
    path
}
