//! [`Memory`]: one file that has the memory of all processors.

use std::ffi::OsString;
use std::os::fd::OwnedFd;
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::path::{Path, PathBuf};

use rustix::fs::{CWD, OFlags};
use rustix::io::Errno;

use super::directory::{expect_kind, open_again};
use super::error::{FileKind, SystemError};
use super::window::Access;

/// The file of a directory that says where the memory lies.
pub(super) const NAME: &str = "memory";
/// Bytes of a file that is there to be locked; a `mail` has more.
pub(super) const LOCK_BYTES: u32 = 4;
/// How that file begins.
const HEAD: &str = "condor-mbox memory 1";

/// Where objects of a kind lie in a file, one after the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Run {
    /// Where that of processor 0 begins, in bytes from the beginning of the file; a multiple of 4.
    pub offset: u64,
    /// Bytes from the beginning of one to that of the next; a multiple of 4.
    pub stride: u64,
}

impl Run {
    /// `None` if there is no such offset.
    fn at(self, number: usize) -> Option<u64> {
        let number = u64::try_from(number).ok()?;
        self.stride.checked_mul(number)?.checked_add(self.offset)
    }
}

/// A file that has the windows of all processors of a [`System`](super::System), and more, maybe:
/// the memory of another machine, say, or a part of it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Memory {
    /// The file, by an absolute path. It has its size already, and stays when the system is removed.
    pub file: PathBuf,
    /// The `mail` of each processor.
    pub mail: Run,
    /// The `data` of each processor, which begins with its bell.
    pub data: Run,
}

/// What a system needs of its memory.
#[derive(Clone, Copy, Debug)]
pub(super) struct Needs {
    pub(super) processors: usize,
    pub(super) mail_bytes: u32,
    pub(super) data_bytes: u32,
}

impl Memory {
    /// Refuses what overlaps, or lies at no word.
    pub(super) fn check(&self, needs: Needs) -> Result<(), SystemError> {
        let refused = |reason: String| SystemError::BadLayout {
            path: self.file.clone(),
            reason,
        };
        if !self.file.is_absolute() {
            return Err(refused("the path is not absolute".into()));
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
                    return Err(refused(format!("{number}.{object} lies beyond every file")));
                };
                if !offset.is_multiple_of(4) {
                    let reason = format!("{number}.{object} at {offset:#x} begins within a word");
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

    /// The text from which [`from_text`](Self::from_text) makes it again.
    pub(super) fn to_text(&self, processors: usize, user_bytes: u32) -> Vec<u8> {
        let (mail, data) = (self.mail, self.data);
        let mut text = format!(
            "{HEAD}\nprocessors {processors}\ndata-bytes {user_bytes}\nmail {} {}\ndata {} {}\nfile ",
            mail.offset, mail.stride, data.offset, data.stride
        )
        .into_bytes();
        text.extend(self.file.as_os_str().as_bytes());
        // No path has one, but a path may have lines.
        text.push(0);
        text
    }

    /// What a file at `path` says to a system of so many processors and bytes.
    pub(super) fn from_text(
        text: &[u8],
        path: &Path,
        processors: usize,
        user_bytes: u32,
    ) -> Result<Self, SystemError> {
        let refused = |reason: &str| SystemError::BadMemory {
            path: path.into(),
            reason: reason.into(),
        };
        let mut lines = text.splitn(6, |&byte| byte == b'\n');
        let mut line = |key: &str| -> Result<Vec<u8>, SystemError> {
            let line = lines.next().unwrap_or_default();
            let rest = line.strip_prefix(key.as_bytes());
            rest.map(<[u8]>::to_vec)
                .ok_or_else(|| refused(&format!("no line begins with {key:?} where one should")))
        };
        let numbers = |key: &str, rest: Vec<u8>| -> Result<Vec<u64>, SystemError> {
            let text = String::from_utf8_lossy(&rest).into_owned();
            let numbers = text.split_ascii_whitespace().map(str::parse);
            numbers
                .collect::<Result<_, _>>()
                .map_err(|_| refused(&format!("{text:?} after {key:?} is no number")))
        };
        line(HEAD)?;
        for (key, expected) in [
            ("processors", processors as u64),
            ("data-bytes", user_bytes.into()),
        ] {
            let found = numbers(key, line(key)?)?;
            if found != [expected] {
                return Err(refused(&format!("{key} is {found:?}, expected {expected}")));
            }
        }
        let mut run = |key| match numbers(key, line(key)?)?.as_slice() {
            &[offset, stride] => Ok(Run { offset, stride }),
            _ => Err(refused(&format!("{key} needs an offset and a stride"))),
        };
        let (mail, data) = (run("mail")?, run("data")?);
        let mut file = line("file ")?;
        if file.pop() != Some(0) {
            return Err(refused("the path of the memory has no end"));
        }
        Ok(Self {
            file: OsString::from_vec(file).into(),
            mail,
            data,
        })
    }

    /// Opens the file, and makes sure that all lies inside.
    pub(super) fn open(&self, needs: Needs) -> Result<OwnedFd, SystemError> {
        self.check(needs)?;
        let path = &self.file;
        let file = match open_again(CWD, path, Access::ReadWrite, OFlags::NOFOLLOW) {
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

    /// Where the `mail` of `number` begins, if [`check`](Self::check) found nothing.
    pub(super) fn mail_at(&self, number: usize) -> u64 {
        self.mail.at(number).unwrap_or(u64::MAX)
    }

    /// Where the `data` of `number` begins, if [`check`](Self::check) found nothing.
    pub(super) fn data_at(&self, number: usize) -> u64 {
        self.data.at(number).unwrap_or(u64::MAX)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    type Change = fn(&mut Memory);

    fn memory() -> Memory {
        Memory {
            file: OsString::from_vec(b"/dev/shm/a \n\xff".to_vec()).into(),
            mail: Run {
                offset: 4096,
                stride: 8192,
            },
            data: Run {
                offset: 1 << 40,
                stride: 68,
            },
        }
    }

    #[test]
    fn what_is_written_is_read() {
        let (memory, path) = (memory(), Path::new("/system/memory"));
        let text = memory.to_text(3, 64);
        assert_eq!(Memory::from_text(&text, path, 3, 64).unwrap(), memory);
        for len in 0..text.len() {
            let error = Memory::from_text(&text[..len], path, 3, 64).unwrap_err();
            assert!(error.to_string().contains("/system/memory"), "{error}");
        }
        for (processors, bytes, expected) in [(2, 64, "processors is [3]"), (3, 60, "expected 60")]
        {
            let error = Memory::from_text(&text, path, processors, bytes).unwrap_err();
            assert!(error.to_string().contains(expected), "{error}");
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
                "0.mail at 0x1002 begins within a word",
            ),
            (|one| one.data.stride = 1 << 63, "lies beyond every file"),
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
            mail: Run {
                offset: 0,
                stride: 4164,
            },
            data: Run {
                offset: 4096,
                stride: 4164,
            },
            ..memory()
        };
        memory.check(needs).unwrap();
    }
}
