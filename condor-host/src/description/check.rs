//! Whether what a description names is there, and goes together.

use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use super::ProgramEntry;
use super::mistake::{Problem, nearest};
use super::read::{Read, beside};
use super::tree::{At, Text};
use crate::cli::{Application, names};
use crate::extension::Extension;
use condor_rt::numbers::PROGRAMS;

/// Where the description stands, and for which application.
pub(super) struct Own<'o> {
    pub(super) file: &'o Path,
    pub(super) application: &'o dyn Application,
}

/// What a command would take for a processor.
const SERVICES: [&str; 3] = ["files", "terminals", "supervisor"];

pub(super) fn processors(text: &Text<'_>, all: &[Read<'_, '_>], extensions: &[&dyn Extension]) {
    let all: Vec<_> = all.iter().map(|(common, ..)| common).collect();
    let of_extensions = extensions.iter().filter_map(|extension| extension.table());
    let services: Vec<_> = SERVICES.into_iter().chain(of_extensions).collect();
    for (index, one) in all.iter().enumerate() {
        let above = all.get(..index).unwrap_or_default();
        if let Some(name) = &one.name {
            if services.contains(&name.value.as_str()) {
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

/// The file of a program that does not run on this machine.
pub(super) fn file(text: &Text<'_>, program: &At<String>, own: &Own<'_>) -> Option<ProgramEntry> {
    if program.value == "self" {
        let problem = "programs of this file are for this machine; name a file";
        text.wrong(&program.span, Problem::Other(problem.into()));
        return None;
    }
    let path = beside(own.file, &program.value);
    if let Err(error) = std::fs::File::open(&path) {
        let problem = format!("cannot read {}: {error}", path.display());
        text.wrong(&program.span, Problem::Other(problem));
    }
    Some(ProgramEntry::File(path))
}

pub(super) fn program(
    text: &Text<'_>,
    program: &At<String>,
    arguments: Option<&At<Vec<String>>>,
    own: &Own<'_>,
) -> Option<ProgramEntry> {
    if program.value != "self" {
        return match find_program(own.file, &program.value) {
            Ok(path) => Some(ProgramEntry::File(path)),
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
    Some(ProgramEntry::Own)
}

/// Returns the file of a program. It searches relative to the description in `file`, then in the
/// directory of the running program, then in `PATH`.
///
/// # Errors
/// [`Problem::NoProgram`] if there is none, [`Problem::NotExecutable`] if it cannot be run.
pub fn find_program(file: &Path, name: &str) -> Result<PathBuf, Problem> {
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
        text.wrong(&robot.span, Problem::Other(error.to_string()));
    }
    path
}
