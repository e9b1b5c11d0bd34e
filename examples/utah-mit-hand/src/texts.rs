//! [`Texts`]: the texts of motions in a directory, which people read and write.

use std::fs::{self, File};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use condor_host::cli::AnyError;
use condor_host::robot::Motions;
use utah_mit_hand::compile::{compile_motion, replace};
use utah_mit_hand::master::is_name;

/// How the names of texts end.
const SUFFIX: &str = ".toml";

/// The texts of motions, for a hand with these joints.
pub(crate) struct Texts {
    pub(crate) directory: PathBuf,
    pub(crate) joints: Vec<String>,
}

impl Texts {
    fn path(&self, file: &str) -> Result<PathBuf, AnyError> {
        if !file.strip_suffix(SUFFIX).is_some_and(is_name) {
            return Err(format!(
                "{file:?} is no name of a motion file: it has up to 24 letters, digits, `-` and `_`, and \
                 ends with {SUFFIX}"
            )
            .into());
        }
        Ok(self.directory.join(file))
    }
}

fn told(path: &Path, error: &std::io::Error) -> String {
    format!("{}: {error}", path.display())
}

impl Motions for Texts {
    fn list(&self) -> Result<Vec<String>, AnyError> {
        let entries = match fs::read_dir(&self.directory) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
            entries => entries.map_err(|error| told(&self.directory, &error))?,
        };
        let mut files = Vec::new();
        for entry in entries {
            let name = entry?.file_name().to_string_lossy().into_owned();
            if self.path(&name).is_ok() {
                files.push(name);
            }
        }
        files.sort();
        Ok(files)
    }

    fn read(&self, file: &str) -> Result<String, AnyError> {
        let path = self.path(file)?;
        Ok(fs::read_to_string(&path).map_err(|error| told(&path, &error))?)
    }

    fn write(&mut self, file: &str, text: &str, replaces: bool) -> Result<(), AnyError> {
        let path = self.path(file)?;
        // The system does not come up with a text that cannot be compiled.
        compile_motion(text, Path::new(file), &self.joints)?;
        if replaces {
            return Ok(replace(&path, text.as_bytes())?);
        }
        fs::create_dir_all(&self.directory).map_err(|error| told(&self.directory, &error))?;
        let new = match File::create_new(&path) {
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {
                return Err(format!("there is a file {file} already").into());
            }
            new => new,
        };
        let written = new.and_then(|mut new| new.write_all(text.as_bytes()));
        Ok(written.map_err(|error| told(&path, &error))?)
    }
}
