//! Paths that are written in a description.

use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};

/// Returns the absolute path of `path`, which is written in a description. A relative `path` starts at the directory of
/// the description's file, `file`.
#[must_use]
pub fn beside(file: &Path, path: &str) -> PathBuf {
    let directory = file.parent().unwrap_or(Path::new(""));
    let joined = directory.join(path);
    std::path::absolute(&joined).unwrap_or(joined)
}

/// Returns the path of the program `name`, which is written in the description in `file`. The program is searched in
/// the directory of `file`, then in that of the running program, and then, if `name` has no slash, in `PATH`.
///
/// # Errors
/// Returns an error, a sentence for people, if no such program is found, or if the first file that is found is
/// not executable. The sentence names that file, or the places that were searched.
pub fn find_program(file: &Path, name: &str) -> Result<PathBuf, String> {
    let mut looked = vec![beside(file, name)];
    if let Ok(own) = std::env::current_exe() {
        looked.push(own.with_file_name(name));
    }
    let path = std::env::var_os("PATH").unwrap_or_default();
    let in_path = std::env::split_paths(&path).filter_map(|directory| {
        // A directory of PATH may be relative, and a program is started again from anywhere.
        std::path::absolute(directory.join(name)).ok()
    });
    // A name with a slash is a path, and not looked for.
    let in_path = in_path.filter(|_| !name.contains('/'));
    for place in looked.iter().cloned().chain(in_path) {
        if let Ok(metadata) = std::fs::metadata(&place) {
            if metadata.is_file() && metadata.permissions().mode() & 0o111 != 0 {
                return Ok(place);
            }
            return Err(format!(
                "{} is not a program: it is not an executable file",
                place.display()
            ));
        }
    }
    let looked = looked.iter().map(|place| format!("{}, ", place.display()));
    let looked: String = looked.collect();
    Err(format!(
        "there is no program `{name}`; searched {looked}and PATH"
    ))
}
