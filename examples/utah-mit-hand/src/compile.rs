//! What people write, the hand's configuration and motions, as the files that programs load.

use std::format;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::string::{String, ToString as _};
use std::vec;
use std::vec::Vec;

use condor_hand::config::TextError;
use condor_hand::trajectory::image::{ImageError, encode};
use condor_hand::trajectory::motion::{MotionError, load};
use thiserror::Error;

use crate::start::IMAGE_BYTES;
use crate::{FINGERS, IMAGE, JOINTS, UtahMit, boards};

/// Bytes of a sequence that the master has room for.
const BYTES: usize = crate::master::MOTION_BYTES;

/// Why a motion is not compiled.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CompileError {
    /// A file or directory.
    #[error("{}: {error}", path.display())]
    Io {
        /// Which one.
        path: PathBuf,
        /// Why not.
        error: io::Error,
    },
    /// The configuration of the hand is wrong.
    #[error(transparent)]
    Hand(#[from] TextError),
    /// What is written in the file of a motion.
    #[error("{}:{line}:{column}: {problem}", path.display())]
    Text {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// The character in the line, from 1.
        column: usize,
        /// What is wrong, and what would be right.
        problem: String,
    },
    /// A problem without a place, such as a sequence that is too long for the master.
    #[error("{}: {problem}", path.display())]
    Whole {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
}

/// The names of all joints, FINGER.JOINT, in the order of their numbers.
#[must_use]
pub fn joint_names(hand: &UtahMit) -> Vec<String> {
    let fingers = hand.fingers.iter();
    let names = fingers.flat_map(|finger| {
        let joints = finger.joints.iter();
        joints.map(|joint| format!("{}.{}", finger.name, joint.name))
    });
    names.collect()
}

/// Reads the configuration of the hand.
///
/// # Errors
/// [`CompileError::Io`], [`CompileError::Hand`]; [`CompileError::Whole`] for a hand that the boards of
/// the rack cannot serve.
pub fn read_hand(path: &Path) -> Result<UtahMit, CompileError> {
    let text = fs::read_to_string(path).map_err(io(path))?;
    let hand = UtahMit::from_toml(&text, &path.to_string_lossy())?;
    boards::check(&hand).map_err(|error| {
        let (path, problem) = (path.to_path_buf(), error.to_string());
        CompileError::Whole { path, problem }
    })?;
    Ok(hand)
}

/// Compiles the configuration in the file `hand` to [`IMAGE`] in the directory `files`, which is made if it is
/// not there, and the motions of a directory, if that is there, to `motions` in it.
///
/// # Errors
/// The first thing that is wrong; what comes before it has been written.
pub fn compile_all(hand: &Path, motions: &Path, files: &Path) -> Result<(), CompileError> {
    fs::create_dir_all(files).map_err(io(files))?;
    let configuration = read_hand(hand)?;
    let mut image = vec![0; IMAGE_BYTES];
    let len = configuration.to_image(&mut image).map_err(|error| {
        let (path, problem) = (hand.to_path_buf(), error.to_string());
        CompileError::Whole { path, problem }
    })?;
    image.truncate(len);
    replace(&files.join(IMAGE), &image)?;
    if motions.is_dir() {
        let names = joint_names(&configuration);
        compile_motions(motions, &files.join("motions"), &names)?;
    }
    Ok(())
}

/// Writes a file: whoever reads it meanwhile finds the former one or this one.
fn replace(path: &Path, content: &[u8]) -> Result<(), CompileError> {
    let half = path.with_extension("half");
    fs::write(&half, content).map_err(io(&half))?;
    fs::rename(&half, path).map_err(io(path))
}

fn io(path: &Path) -> impl FnOnce(io::Error) -> CompileError + use<> {
    let path = path.to_path_buf();
    |error| CompileError::Io { path, error }
}

/// Compiles every `NAME.toml` of a directory to `NAME.motion` in `out`, which is made if it is not
/// there; gives the names, in alphabetical order. Files in `out` that have no text are left alone.
///
/// # Errors
/// The first thing that is wrong, with file and line; files before it have been written.
pub fn compile_motions(
    directory: &Path,
    out: &Path,
    names: &[impl AsRef<str>],
) -> Result<Vec<String>, CompileError> {
    fs::create_dir_all(out).map_err(io(out))?;
    let mut paths = Vec::new();
    for entry in fs::read_dir(directory).map_err(io(directory))? {
        let path = entry.map_err(io(directory))?.path();
        if path
            .extension()
            .is_some_and(|extension| extension == "toml")
        {
            paths.push(path);
        }
    }
    paths.sort();
    let mut compiled = Vec::new();
    for path in paths {
        let text = fs::read_to_string(&path).map_err(io(&path))?;
        let image = compile(&text, names).map_err(|problem| problem.at(&path))?;
        let name = path.file_stem().unwrap_or_default();
        let name = String::from(name.to_string_lossy());
        replace(&out.join(format!("{name}.motion")), &image)?;
        compiled.push(name);
    }
    Ok(compiled)
}

#[derive(Debug)]
enum Problem {
    Motion(MotionError),
    Image(ImageError),
}

impl Problem {
    fn at(self, path: &Path) -> CompileError {
        let path = path.to_path_buf();
        match self {
            Self::Motion(MotionError::Text {
                line,
                column,
                problem,
            }) => CompileError::Text {
                path,
                line,
                column,
                problem,
            },
            Self::Motion(error) => CompileError::Whole {
                path,
                problem: format!("{error}"),
            },
            Self::Image(error) => CompileError::Whole {
                path,
                problem: format!("{error}"),
            },
        }
    }
}

fn compile(text: &str, names: &[impl AsRef<str>]) -> Result<Vec<u8>, Problem> {
    let motions = load::<{ FINGERS * JOINTS }>(text, names).map_err(Problem::Motion)?;
    let mut bytes = std::vec![0; BYTES];
    let len = encode(&motions, &mut bytes).map_err(Problem::Image)?;
    bytes.truncate(len);
    Ok(bytes)
}
