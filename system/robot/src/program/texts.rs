//! [`Texts`]: the texts of motions in a directory, which people read and write.

use std::fs;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use condor_host::error::AnyError;
use condor_host::robot::MotionFiles;
use condor_platform::linux::{WholeFile, read_text};

use crate::RobotDescription;
use crate::compile::compile_motion;
use crate::master::is_name;

/// The suffix of the names of texts.
const SUFFIX: &str = ".toml";

/// The texts of motions of a robot.
pub(crate) struct Texts {
    pub(crate) directory: PathBuf,
    pub(crate) robot: RobotDescription,
}

impl Texts {
    fn path(&self, file: &str) -> Result<PathBuf, AnyError> {
        if !file.strip_suffix(SUFFIX).is_some_and(is_name) {
            return Err(format!(
                "{file:?} cannot be the name of a motion file: a name has up to 24 letters, digits, `-` and `_`, and \
                 ends with {SUFFIX}"
            )
            .into());
        }
        Ok(self.directory.join(file))
    }
}

fn file_error(path: &Path, error: &std::io::Error) -> String {
    format!("{}: {error}", path.display())
}

impl MotionFiles for Texts {
    fn list(&self) -> Result<Vec<String>, AnyError> {
        let entries = match fs::read_dir(&self.directory) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
            entries => entries.map_err(|error| file_error(&self.directory, &error))?,
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
        Ok(read_text(&path).map_err(|error| file_error(&path, &error))?)
    }

    fn write(&mut self, file: &str, text: &str, replaces: bool) -> Result<(), AnyError> {
        let path = self.path(file)?;
        // The system does not come up with a text that cannot be compiled.
        compile_motion(text, Path::new(file), &self.robot)?;
        fs::create_dir_all(&self.directory).map_err(|error| file_error(&self.directory, &error))?;
        let write = || {
            let mut new = WholeFile::create(&path)?;
            new.write_all(text.as_bytes())?;
            if replaces {
                new.finish()
            } else {
                new.finish_new()
            }
        };
        match write() {
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {
                Err(format!("the file {file} exists already").into())
            }
            written => Ok(written.map_err(|error| file_error(&path, &error))?),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::process::Command;

    use super::*;

    /// The variable with the directory of the test that runs with a limit.
    const LIMITED: &str = "CONDOR_ROBOT_TEST_LIMITED";

    fn texts(directory: &Path) -> Texts {
        Texts {
            directory: directory.into(),
            robot: RobotDescription::from_toml(
                include_str!("../../../../condor-hand/hands/utah-mit.toml"),
                "utah-mit.toml",
            )
            .unwrap(),
        }
    }

    /// Motions whose text is longer than 512 bytes.
    fn long() -> String {
        let step = "[[motion]]\nprofile = \"minimum-jerk\"\nduration = 1.0\n[motion.to]\n\"thumb.distal\" = 0.1\n";
        step.repeat(20)
    }

    /// Runs in a child of the next test, which may write 512 bytes to a file.
    #[test]
    fn without_room() {
        let Some(place) = std::env::var_os(LIMITED) else {
            return;
        };
        let mut texts = texts(Path::new(&place));
        for (file, replaces) in [("new.toml", false), ("former.toml", true)] {
            let error = texts.write(file, &long(), replaces).unwrap_err();
            assert!(error.to_string().contains("File too large"), "{error}");
        }
    }

    #[test]
    fn a_motion_that_has_no_room_is_not_there_and_the_former_one_is_as_it_was() {
        let place = tempfile::tempdir().unwrap();
        let former = place.path().join("former.toml");
        fs::write(&former, "former").unwrap();
        let limited =
            "trap '' XFSZ; ulimit -f 1; exec \"$0\" program::texts::tests::without_room --exact";
        let output = Command::new("sh")
            .args(["-ec", limited])
            .arg(std::env::current_exe().unwrap())
            .env(LIMITED, place.path())
            .output()
            .unwrap();
        assert!(output.status.success(), "{output:?}");
        assert_eq!(fs::read(&former).unwrap(), b"former");
        assert_eq!(fs::read_dir(place.path()).unwrap().count(), 1);
        let mut texts = texts(place.path());
        texts.write("former.toml", &long(), true).unwrap();
        texts.write("new.toml", &long(), false).unwrap();
        let again = texts.write("new.toml", &long(), false).unwrap_err();
        assert_eq!(again.to_string(), "the file new.toml exists already");
        assert_eq!(texts.read("former.toml").unwrap(), long());
        assert_eq!(texts.list().unwrap(), ["former.toml", "new.toml"]);
    }
}
