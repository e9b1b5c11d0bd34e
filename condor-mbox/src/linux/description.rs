//! The file `system` of a directory: which system this is, and where its memory lies.
//!
//! The first program writes it, before any other file. A program that was built for another number
//! of processors, or another size, is refused before it has made any file.

use std::ffi::OsString;
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::path::Path;

use super::error::SystemError;
use super::memory::{Memory, ObjectPositions};

/// The name of the file.
pub(super) const NAME: &str = "system";
/// The beginning of the text: magic and version.
const HEAD: &str = "condor-mbox system 1";
/// The end of the text if the windows are files of the directory.
const FILES: &[u8] = b"files\n";

/// The text from which [`memory_of`] makes the memory again.
pub(super) fn text_of(processors: usize, user_bytes: u32, memory: Option<&Memory>) -> Vec<u8> {
    let head = format!("{HEAD}\nprocessors {processors}\ndata-bytes {user_bytes}\n");
    let mut text = head.into_bytes();
    let Some(Memory { file, mail, data }) = memory else {
        text.extend(FILES);
        return text;
    };
    let runs = format!(
        "mail {} {}\ndata {} {}\nfile ",
        mail.offset, mail.stride, data.offset, data.stride
    );
    text.extend(runs.as_bytes());
    text.extend(file.as_os_str().as_bytes());
    // No path has one, but a path may have lines.
    text.push(0);
    text
}

/// Returns the place of the memory according to the file at `path`, for a system of so many processors and
/// bytes; `None` if the windows are files of the directory.
pub(super) fn memory_of(
    text: &[u8],
    path: &Path,
    processors: usize,
    user_bytes: u32,
) -> Result<Option<Memory>, SystemError> {
    let refused = |reason: String| SystemError::OtherSystem {
        path: path.into(),
        reason,
    };
    // Of the line that is next.
    let value = |line: Option<&[u8]>, key: &str| -> Result<Vec<u64>, SystemError> {
        let line = String::from_utf8_lossy(line.unwrap_or_default());
        let numbers = line.strip_prefix(key).and_then(|numbers| {
            let numbers = numbers.split_ascii_whitespace().map(str::parse);
            numbers.collect::<Result<_, _>>().ok()
        });
        numbers.ok_or_else(|| refused(format!("it says {line:?}, expected {key:?}")))
    };
    let mut lines = text.splitn(4, |&byte| byte == b'\n');
    if !value(lines.next(), HEAD)?.is_empty() {
        return Err(refused(format!("its version is not that of {HEAD:?}")));
    }
    for (key, expected) in [
        ("processors", processors as u64),
        ("data-bytes", user_bytes.into()),
    ] {
        let found = value(lines.next(), key)?;
        if found != [expected] {
            return Err(refused(format!("{key} is {found:?}, expected {expected}")));
        }
    }
    let rest = lines.next().unwrap_or_default();
    if rest == FILES {
        return Ok(None);
    }
    let mut lines = rest.splitn(3, |&byte| byte == b'\n');
    let mut run = |key| match value(lines.next(), key)?.as_slice() {
        &[offset, stride] => Ok(ObjectPositions { offset, stride }),
        numbers => Err(refused(format!(
            "{key} is {numbers:?}, expected an offset and a stride"
        ))),
    };
    let (mail, data) = (run("mail")?, run("data")?);
    let file = lines.next().and_then(|line| line.strip_prefix(b"file "));
    let Some([file @ .., 0]) = file else {
        return Err(refused("it names no memory".into()));
    };
    Ok(Some(Memory {
        file: OsString::from_vec(file.to_vec()).into(),
        mail,
        data,
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read() {
        let memory = Memory {
            file: OsString::from_vec(b"/dev/shm/a \n\xff".to_vec()).into(),
            ..super::super::memory::tests::memory()
        };
        let path = Path::new("/place/system");
        for memory in [None, Some(&memory)] {
            let text = text_of(3, 64, memory);
            assert_eq!(memory_of(&text, path, 3, 64).unwrap().as_ref(), memory);
            for len in 0..text.len() {
                let error = memory_of(&text[..len], path, 3, 64).unwrap_err();
                assert!(error.to_string().contains("/place/system"), "{error}");
            }
            let other = [&b"condor-mbox system 12"[..], &text[20..]].concat();
            for (text, processors, bytes, expected) in [
                (&text, 2, 64, "processors is [3], expected 2"),
                (&text, 3, 60, "data-bytes is [64], expected 60"),
                (
                    &other,
                    3,
                    64,
                    "its version is not that of \"condor-mbox system 1\"",
                ),
            ] {
                let error = memory_of(text, path, processors, bytes).unwrap_err();
                assert!(error.to_string().contains(expected), "{error}");
            }
        }
    }
}
