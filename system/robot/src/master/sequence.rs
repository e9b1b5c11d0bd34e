//! [`Sequence`]: a sequence of motions in memory, and [`Store`]: in files.

use condor_fs::{Errno, File, FileError, OpenOptions};
use condor_hand::ImageError;
use condor_hand::trajectory::MotionError;
use condor_hand::trajectory::image::{MotionSequence, append};
use condor_rt::{FilesOf, Machine};
use embedded_io::Write as _;

use super::drive::{ALL, Motion};
use super::words::{MOTIONS, Path, Problem};
use crate::file;

/// The greatest size of a compiled sequence of motions that the master can run, in bytes.
pub const MOTION_BYTES: usize = 8192;
/// The suffix of the names of their files.
const SUFFIX: &str = ".motion";

/// A sequence of motions as the bytes of its image; nothing at first.
pub(super) struct Sequence {
    bytes: [u8; MOTION_BYTES],
    len: usize,
    /// The number of joints of the robot.
    joints: usize,
}

impl Sequence {
    pub(super) const fn new(joints: usize) -> Self {
        Self {
            joints,
            bytes: [0; MOTION_BYTES],
            len: 0,
        }
    }

    pub(super) fn clear(&mut self) {
        self.len = 0;
    }

    pub(super) fn is_empty(&self) -> bool {
        self.len == 0
    }

    fn bytes(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or(&[])
    }

    /// Takes the bytes of an image that was checked.
    pub(super) fn set(&mut self, image: &[u8]) {
        self.clear();
        if let Some(place) = self.bytes.get_mut(..image.len()) {
            place.copy_from_slice(image);
            self.len = image.len();
        }
    }

    pub(super) fn copy(&mut self, from: &Self) {
        *self = Self {
            bytes: from.bytes,
            len: from.len,
            joints: from.joints,
        };
    }

    /// The motions, if there are any; they were checked when they came.
    pub(super) fn motions(&self) -> Result<MotionSequence<'_, ALL>, ImageError<MotionError>> {
        MotionSequence::open(self.joints, self.bytes())
    }

    pub(super) fn push(&mut self, motion: &Motion) -> Result<(), ImageError<MotionError>> {
        self.len = append(self.joints, motion, &mut self.bytes, self.len)?;
        Ok(())
    }
}

/// The sequences in files.
pub(super) struct Store<'r, M: Machine>(pub(super) &'r FilesOf<'r, M>);

impl<M: Machine> Store<'_, M> {
    /// Checks that there is a sequence of this name.
    pub(super) fn check(&self, name: &str) -> Result<(), Problem<'static>> {
        let path = path(name, SUFFIX);
        let opened = self.0.open(&path, OpenOptions::new().read());
        let closed = opened.and_then(File::close);
        closed.map_err(|error| Problem::of_file(path, error))
    }

    /// Reads a sequence, which is checked.
    pub(super) fn load(&self, name: &str, into: &mut Sequence) -> Result<(), Problem<'static>> {
        let path = path(name, SUFFIX);
        into.clear();
        let options = OpenOptions::new().read();
        into.len = match file::read(self.0, &path, options, &mut into.bytes) {
            Ok(len) => len,
            Err(error) => return Err(Problem::of_file(path, error)),
        };
        if let Err(error) = MotionSequence::<ALL>::new(into.joints, into.bytes()) {
            into.clear();
            return Err(Problem::Image { name: path, error });
        }
        Ok(())
    }

    /// Writes a sequence: under another name first, so that a name never has half of one. A file that is there stays.
    pub(super) fn save(&self, name: &str, from: &Sequence) -> Result<(), Problem<'static>> {
        let (path, half) = (path(name, SUFFIX), path(name, ".half"));
        match self.check(name) {
            Ok(()) => return Err(Problem::Exists(path)),
            Err(Problem::NoFile(_)) => {}
            Err(problem) => return Err(problem),
        }
        let write = || {
            match self.0.make_directory(MOTIONS) {
                Err(error) if error.errno() != Some(Errno::EXIST) => return Err(error),
                _ => {}
            }
            let options = OpenOptions::new().write().create().truncate();
            let mut file = self.0.open(&half, options)?;
            file.write_all(from.bytes())?;
            file.sync()?;
            file.close()?;
            self.0.rename(&half, &path)
        };
        let outcome: Result<(), FileError> = write();
        outcome.map_err(|error| Problem::File { name: path, error })
    }

    /// The names of all sequences.
    pub(super) fn list(&self, mut each: impl FnMut(&str)) -> Result<(), Problem<'static>> {
        let mut list = || {
            let mut directory = self.0.open_directory(MOTIONS)?;
            let mut name = [0; 255];
            while let Some(entry) = directory.next(&mut name)? {
                let name = core::str::from_utf8(entry.name).unwrap_or("");
                if let Some(name) = name.strip_suffix(SUFFIX) {
                    each(name);
                }
            }
            directory.close()
        };
        let outcome: Result<(), FileError> = list();
        outcome.map_err(|error| {
            let mut name = Path::new();
            // There is room.
            let _ = name.push_str(MOTIONS);
            Problem::File { name, error }
        })
    }
}

/// The path of a sequence; names are short enough.
fn path(name: &str, suffix: &str) -> Path {
    let mut path = Path::new();
    for part in [MOTIONS, "/", name, suffix] {
        let _ = path.push_str(part);
    }
    path
}
