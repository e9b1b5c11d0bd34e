//! [`Memory`]: one file that has the memory of all processors.

use std::os::fd::OwnedFd;
use std::path::PathBuf;

use rustix::fs::{CWD, OFlags};
use rustix::io::Errno;

use super::directory::{expect_kind, open_again};
use super::error::{FileKind, SystemError};
use super::window::WindowAccess;

/// Bytes of a file that is there to be locked; a `mail` has more.
pub(super) const LOCK_BYTES: u32 = 4;

/// The positions in a file of the `mail`, or of the `data`, of all processors. They are evenly
/// spaced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ObjectPositions {
    /// The offset of the `mail` or `data` of processor 0, in bytes from the beginning of the file;
    /// a multiple of 4.
    pub offset: u64,
    /// The distance from the `mail` or `data` of one processor to that of the next, in bytes; a
    /// multiple of 4.
    pub stride: u64,
}

impl ObjectPositions {
    /// `None` if there is no such offset.
    fn at(self, number: usize) -> Option<u64> {
        let number = u64::try_from(number).ok()?;
        self.stride.checked_mul(number)?.checked_add(self.offset)
    }
}

/// A file that contains the windows of all processors of a [`LinuxSystem`](super::LinuxSystem). It may
/// contain more, for example if it is the memory of another machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Memory {
    /// The absolute path of the file. The file has its size already, and stays when the system is
    /// removed.
    pub file: PathBuf,
    /// The positions of the `mail` of each processor.
    pub mail: ObjectPositions,
    /// The positions of the `data` of each processor, which begins with its doorbell.
    pub data: ObjectPositions,
}

/// The memory that a system needs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Needs {
    pub(super) processors: usize,
    pub(super) mail_bytes: u32,
    pub(super) data_bytes: u32,
}

impl Memory {
    /// Refuses objects that overlap, or do not lie at a word.
    pub(super) fn check(&self, needs: Needs) -> Result<(), SystemError> {
        let refused = |reason: String| SystemError::BadLayout {
            path: self.file.clone(),
            reason,
        };
        if !self.file.is_absolute() {
            return Err(refused("its path is not absolute".into()));
        }
        let mut all = Vec::new();
        for (object, run, bytes) in [
            ("mail", self.mail, needs.mail_bytes),
            ("data", self.data, needs.data_bytes),
        ] {
            for number in 0..needs.processors {
                let end = |offset: u64| offset.checked_add(u64::from(bytes));
                let range = run
                    .at(number)
                    .and_then(|offset| Some((offset, end(offset)?)));
                let Some((offset, end)) = range.filter(|&(_, end)| i64::try_from(end).is_ok())
                else {
                    return Err(refused(format!(
                        "{number}.{object} lies beyond the largest possible file"
                    )));
                };
                if !offset.is_multiple_of(4) {
                    let reason = format!(
                        "{number}.{object} at {offset:#x} does not begin at a multiple of 4"
                    );
                    return Err(refused(reason));
                }
                all.push((offset, end, number, object));
            }
        }
        all.sort_unstable();
        for pair in all.windows(2) {
            let &[(_, end, one, of_one), (offset, _, other, of_other)] = pair else {
                continue;
            };
            if offset < end {
                return Err(refused(format!(
                    "{other}.{of_other} at {offset:#x} begins before {one}.{of_one} ends at {end:#x}"
                )));
            }
        }
        Ok(())
    }

    /// Opens the file, and makes sure that all lies inside.
    pub(super) fn open(&self, needs: Needs) -> Result<OwnedFd, SystemError> {
        self.check(needs)?;
        let path = &self.file;
        let file = match open_again(CWD, path, WindowAccess::ReadWrite, OFlags::NOFOLLOW) {
            Ok(file) => file,
            Err(Errno::LOOP) => {
                return Err(SystemError::WrongKind {
                    path: path.clone(),
                    found: FileKind::Symlink,
                    expected: FileKind::File,
                });
            }
            Err(errno) => return Err(SystemError::os("open", path)(errno)),
        };
        let stat = rustix::fs::fstat(&file).map_err(SystemError::os("examine", path))?;
        expect_kind(path, &stat, FileKind::File)?;
        let found = u64::try_from(stat.st_size).unwrap_or(0);
        for number in 0..needs.processors {
            for (object, offset, bytes) in [
                ("mail", self.mail_at(number), needs.mail_bytes),
                ("data", self.data_at(number), needs.data_bytes),
            ] {
                if offset.saturating_add(bytes.into()) > found {
                    return Err(SystemError::OutsideMemory {
                        path: path.clone(),
                        object: format!("{number}.{object}"),
                        offset,
                        bytes,
                        found,
                    });
                }
            }
        }
        Ok(file)
    }

    /// Returns the offset at which the `mail` of `number` begins, if [`check`](Self::check) found nothing.
    pub(super) fn mail_at(&self, number: usize) -> u64 {
        self.mail.at(number).unwrap_or(u64::MAX)
    }

    /// Returns the offset at which the `data` of `number` begins, if [`check`](Self::check) found nothing.
    pub(super) fn data_at(&self, number: usize) -> u64 {
        self.data.at(number).unwrap_or(u64::MAX)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    type Change = fn(&mut Memory);

    pub(in super::super) fn memory() -> Memory {
        Memory {
            file: "/dev/shm/ram".into(),
            mail: ObjectPositions {
                offset: 4096,
                stride: 8192,
            },
            data: ObjectPositions {
                offset: 1 << 40,
                stride: 68,
            },
        }
    }

    #[test]
    fn what_overlaps_is_refused() {
        let needs = Needs {
            processors: 3,
            mail_bytes: 4096,
            data_bytes: 68,
        };
        memory().check(needs).unwrap();
        let cases: [(Change, &str); 6] = [
            (
                |one| one.mail.stride = 4092,
                "1.mail at 0x1ffc begins before 0.mail ends",
            ),
            (|one| one.data.stride = 64, "1.data"),
            (
                |one| one.data.offset = 8188,
                "begins before 0.mail ends at 0x2000",
            ),
            (
                |one| one.mail.offset = 4098,
                "0.mail at 0x1002 does not begin at a multiple of 4",
            ),
            (
                |one| one.data.stride = 1 << 63,
                "lies beyond the largest possible file",
            ),
            (|one| one.file = "memory".into(), "not absolute"),
        ];
        for (change, expected) in cases {
            let mut memory = memory();
            change(&mut memory);
            let error = memory.check(needs).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
        // One processor's objects may lie together.
        let memory = Memory {
            mail: ObjectPositions {
                offset: 0,
                stride: 4164,
            },
            data: ObjectPositions {
                offset: 4096,
                stride: 4164,
            },
            ..memory()
        };
        memory.check(needs).unwrap();
    }
}
