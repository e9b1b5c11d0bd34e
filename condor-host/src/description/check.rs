//! Whether what a description names is there, and goes together.

use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use condor_toml::{Keys, Spanned, suggest};

use super::ProgramEntry;
use super::read::{Read, beside};
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

pub(super) fn processors(top: &Keys<'_, '_>, all: &[Read<'_, '_>], extensions: &[&dyn Extension]) {
    let all: Vec<_> = all.iter().map(|(common, ..)| common).collect();
    let of_extensions = extensions.iter().filter_map(|extension| extension.table());
    let services: Vec<_> = SERVICES.into_iter().chain(of_extensions).collect();
    for (index, one) in all.iter().enumerate() {
        let above = all.get(..index).unwrap_or_default();
        if let Some(name) = &one.name {
            if services.contains(&name.get_ref().as_str()) {
                let problem = format!("`{name}` is the name of a service; take another one");
                top.wrong(&name.span(), problem);
            }
            let mut others = above.iter().filter_map(|other| other.name.as_ref());
            if let Some(other) = others.find(|other| *other == name) {
                let line = top.line(other.span().start);
                let problem = format!(
                    "the processor in line {line} is called `{name}`, too; take another name"
                );
                top.wrong(&name.span(), problem);
            }
        }
        if let Some(number) = &one.number {
            let mut others = above.iter().filter_map(|other| other.number.as_ref());
            if let Some(other) = others.find(|other| *other == number) {
                let line = top.line(other.span().start);
                let taken = |free: &u8| {
                    let mut numbers = all.iter().filter_map(|one| one.number.as_ref());
                    numbers.any(|number| number.get_ref().0 == *free)
                };
                let free = PROGRAMS.filter(|number| !taken(number));
                let free: Vec<_> = free.map(|number| number.to_string()).collect();
                let number_ = number.get_ref().0;
                let free = match free.join(", ") {
                    none if none.is_empty() => "all numbers are taken".into(),
                    free => format!("free are {free}"),
                };
                let problem =
                    format!("the processor in line {line} has the number {number_}, too; {free}");
                top.wrong(&number.span(), problem);
            }
        }
    }
}

/// The file of a program that does not run on this machine.
pub(super) fn file(
    keys: &Keys<'_, '_>,
    program: &Spanned<String>,
    own: &Own<'_>,
) -> Option<ProgramEntry> {
    if program.get_ref() == "self" {
        let problem = "programs of this file are for this machine; name a file";
        keys.wrong(&program.span(), problem);
        return None;
    }
    let path = beside(own.file, program.get_ref());
    if let Err(error) = std::fs::File::open(&path) {
        let problem = format!("cannot read {}: {error}", path.display());
        keys.wrong(&program.span(), problem);
    }
    Some(ProgramEntry::File(path))
}

pub(super) fn program(
    keys: &Keys<'_, '_>,
    program: &Spanned<String>,
    arguments: Option<&Spanned<Vec<String>>>,
    own: &Own<'_>,
) -> Option<ProgramEntry> {
    if program.get_ref() != "self" {
        return match find_program(own.file, program.get_ref()) {
            Ok(path) => Some(ProgramEntry::File(path)),
            Err(problem) => {
                keys.wrong(&program.span(), problem);
                None
            }
        };
    }
    let known = names(own.application);
    let first =
        arguments.and_then(|arguments| Some((arguments.span(), arguments.get_ref().first()?)));
    let (span, problem) = match first {
        None => {
            let known = suggest("", &known);
            let problem = format!(
                "`arguments` must begin with the name of one of this program's own; {known}"
            );
            (program.span(), problem)
        }
        Some((_, word)) if known.contains(&word.as_str()) => return Some(ProgramEntry::Own),
        Some((span, word)) => {
            let known = suggest(word, &known);
            let problem = format!("this program has no program `{word}` of its own; {known}");
            (span, problem)
        }
    };
    keys.wrong(&span, problem);
    None
}

/// Returns the file of a program. It searches relative to the description in `file`, then in the
/// directory of the running program, then in `PATH`.
///
/// # Errors
/// A sentence that says where it was searched, or that it cannot be run.
pub fn find_program(file: &Path, name: &str) -> Result<PathBuf, String> {
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
            return Err(format!(
                "{} is no program: it is no file that may be executed",
                place.display()
            ));
        }
    }
    let looked = looked.iter().map(|place| format!("{}, ", place.display()));
    let looked: String = looked.collect();
    Err(format!(
        "there is no program `{name}`; looked for {looked}and in PATH"
    ))
}

/// The directory that is served; one that is not there yet will be made.
pub(super) fn directory(keys: &Keys<'_, '_>, root: &Spanned<String>, own: &Own<'_>) -> PathBuf {
    let path = beside(own.file, root.get_ref());
    if std::fs::metadata(&path).is_ok_and(|metadata| !metadata.is_dir()) {
        let shown = path.display();
        let problem = format!("{shown} is no directory; name one, or what is not there yet");
        keys.wrong(&root.span(), problem);
    }
    path
}

/// The configuration of the robot, which must be right, too.
pub(super) fn robot(keys: &Keys<'_, '_>, robot: &Spanned<String>, own: &Own<'_>) -> PathBuf {
    let path = beside(own.file, robot.get_ref());
    if let Err(error) = own.application.check_robot(&path) {
        keys.wrong(&robot.span(), error);
    }
    path
}
