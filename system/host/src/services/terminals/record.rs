//! [`Record`]: the log of a terminal, which holds every byte of its output once.

use std::fs::File;
use std::io::{self, ErrorKind, Write};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use condor_tty::linux::Piece;
use jiff::Timestamp;

use super::mark::Mark;

/// The log of a terminal.
///
/// Its length and its mark say which byte comes next. Where there is a gap, or a new incarnation, a line
/// says so; its mark is written before it, so that the next writer completes a half-written one.
///
/// A log of `limit` bytes is rotated, and one previous log is kept. The offsets of readers count
/// all bytes from the first one that was ever in a log of the terminal. After an error the record
/// must be opened again.
#[derive(Debug)]
pub(super) struct Record {
    path: PathBuf,
    limit: u64,
    file: File,
    len: u64,
    /// Bytes of all logs before this one.
    before: u64,
    /// The old log, and its length.
    old: Option<(File, u64)>,
    mark: Option<Mark>,
}

impl Record {
    /// The log in this file, which is no longer than `limit` and what is taken at once.
    pub(super) fn open(log: &Path, limit: u64) -> io::Result<Self> {
        // A former writer has announced a new log: it begins once the other one is out of the way.
        if announced(log).try_exists()? {
            if log.try_exists()? {
                std::fs::remove_file(announced(log))?;
            } else {
                std::fs::rename(announced(log), marked(log))?;
            }
        }
        let file = open(log)?;
        let mark = Mark::read(&marked(log));
        let before = mark.as_ref().map_or(0, |mark| mark.before);
        let old = match File::open(old(log)) {
            Ok(old) if before > 0 => Some((old.metadata()?.len(), old)),
            Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
            _ => None,
        };
        let mut this = Self {
            path: log.into(),
            limit,
            len: file.metadata()?.len(),
            file,
            before,
            old: old.map(|(len, old)| (old, len)),
            mark,
        };
        this.complete()?;
        Ok(this)
    }

    /// Goes on in a new log, whose first byte is at `position` of `incarnation`. The mark announces the
    /// new log before it is made. So a service that is killed meanwhile leaves the old log whole,
    /// or a new log whose beginning is known.
    fn rotate(&mut self, incarnation: u32, position: u32) -> io::Result<()> {
        let mark = Mark {
            incarnation,
            position,
            before: self.end_offset(),
            ..Mark::default()
        };
        mark.write(&announced(&self.path))?;
        std::fs::rename(&self.path, old(&self.path))?;
        std::fs::rename(announced(&self.path), marked(&self.path))?;
        let former = core::mem::replace(&mut self.file, open(&self.path)?);
        self.old = Some((former, self.len));
        self.before = mark.before;
        self.len = 0;
        self.mark = Some(mark);
        Ok(())
    }

    /// Writes the line of a mark that was only announced, or begun.
    fn complete(&mut self) -> io::Result<()> {
        let Some(mark) = &self.mark else {
            return Ok(());
        };
        let begin = mark.offset.saturating_sub(mark.line.len() as u64);
        if self.len < begin {
            // Somebody has made the log shorter: what it holds is not known.
            self.mark = None;
        } else if self.len < mark.offset {
            let line = mark.line.clone();
            self.file.set_len(begin)?;
            self.len = begin;
            self.append(line.as_bytes()).1?;
        }
        Ok(())
    }

    /// The offset behind the last byte.
    pub(super) fn end_offset(&self) -> u64 {
        self.before + self.len
    }

    /// Reads from `offset` on. Returns the offset of the first byte that was read, which is later
    /// if the byte at `offset` is in no log any more, and the number of bytes.
    pub(super) fn read_at(&self, into: &mut [u8], offset: u64) -> io::Result<(u64, usize)> {
        let offset = offset.min(self.end_offset());
        if let Some((old, len)) = &self.old
            && offset < self.before
        {
            let first = self.before.saturating_sub(*len);
            let offset = offset.max(first);
            return Ok((offset, old.read_at(into, offset - first)?));
        }
        let offset = offset.max(self.before);
        Ok((offset, self.file.read_at(into, offset - self.before)?))
    }

    /// Writes as many bytes as possible; returns their number, and the error that prevented more.
    fn append(&mut self, bytes: &[u8]) -> (usize, io::Result<()>) {
        let mut written = 0;
        while let Some(rest) = bytes.get(written..)
            && !rest.is_empty()
        {
            match self.file.write(rest) {
                Ok(0) => return (written, Err(ErrorKind::WriteZero.into())),
                Ok(count) => {
                    self.len += count as u64;
                    written += count;
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return (written, Err(error)),
            }
        }
        (written, Ok(()))
    }

    /// Begins to record at another byte: announces it, then writes its line.
    fn begin(&mut self, incarnation: u32, position: u32, text: &str) -> io::Result<()> {
        let begin = if self.len == 0 { "" } else { "\r\n" };
        let text = format!("{begin}[{text}]\r\n");
        let mark = Mark {
            incarnation,
            position,
            offset: self.len + text.len() as u64,
            before: self.before,
            line: text,
        };
        mark.write(&marked(&self.path))?;
        self.mark = Some(mark);
        self.complete()
    }

    /// The position that follows the last byte of the log, if that is of this incarnation.
    fn end(&self, incarnation: u32) -> Option<u32> {
        let mark = self
            .mark
            .as_ref()
            .filter(|mark| mark.incarnation == incarnation)?;
        // Positions wrap.
        let since = self.len.wrapping_sub(mark.offset) as u32;
        Some(mark.position.wrapping_add(since))
    }

    /// Writes the bytes of `piece` that the log does not have yet; returns how many bytes of
    /// `piece` the log has now.
    pub(super) fn take(&mut self, piece: Piece<'_>) -> io::Result<usize> {
        let Piece {
            incarnation,
            position,
            ..
        } = piece;
        if piece.bytes.is_empty() {
            return Ok(0);
        }
        let end = match self.end(incarnation) {
            Some(end) if end.wrapping_sub(position).cast_signed() >= 0 => end,
            end => {
                let text = match end {
                    Some(end) => format!("{} bytes overwritten", position.wrapping_sub(end)),
                    None => format!("began at {:.6}", Timestamp::now()),
                };
                self.begin(incarnation, position, &text)?;
                position
            }
        };
        if self.len >= self.limit {
            self.rotate(incarnation, end)?;
        }
        let known = (end.wrapping_sub(position) as usize).min(piece.bytes.len());
        let (written, outcome) = self.append(piece.bytes.get(known..).unwrap_or_default());
        let taken = known + written;
        if taken == 0 {
            outcome?;
        }
        Ok(taken)
    }
}

fn open(log: &Path) -> io::Result<File> {
    let mut options = File::options();
    options.read(true).append(true).create(true).open(log)
}

/// Returns the path of the previous log, which was full.
fn old(log: &Path) -> PathBuf {
    log.with_extension("old.log")
}

/// The mark of the log, and that of a new log before it begins.
fn marked(log: &Path) -> PathBuf {
    log.with_extension("mark")
}

fn announced(log: &Path) -> PathBuf {
    log.with_extension("mark.next")
}

#[cfg(test)]
mod tests {
    use super::*;

    const UNLIMITED: u64 = u64::MAX;

    /// The log without the lines in brackets.
    fn output(log: &Path) -> String {
        let text = std::fs::read_to_string(log).expect("there is a log");
        let parts = text.split('[').map(|part| part.split_once("]\r\n"));
        let parts: Vec<_> = parts.map(|part| part.map_or("", |part| part.1)).collect();
        parts.concat().replace("\r\n", "")
    }

    /// Output of the incarnation 7.
    fn at(position: u32, bytes: &[u8]) -> Piece<'_> {
        Piece {
            incarnation: 7,
            position,
            ..bytes.into()
        }
    }

    fn log() -> (tempfile::TempDir, PathBuf) {
        let directory = tempfile::tempdir().expect("a directory");
        let log = directory.path().join("hand.log");
        (directory, log)
    }

    #[test]
    fn what_was_not_acknowledged_is_not_written_twice() {
        let (_directory, log) = log();
        let mut record = Record::open(&log, UNLIMITED).expect("a new log");
        assert_eq!(record.take(at(0, b"abcdef")).expect("room"), 6);
        drop(record);
        // Killed after the write, and before four of the bytes were acknowledged.
        let mut record = Record::open(&log, UNLIMITED).expect("the log of before");
        assert_eq!(record.take(at(2, b"cde")).expect("room"), 3);
        assert_eq!(record.take(at(5, b"fgh")).expect("room"), 3);
        assert_eq!(output(&log), "abcdefgh");
    }

    #[test]
    fn a_write_that_was_cut_anywhere_is_completed() {
        for cut in 0..=6 {
            let (_directory, log) = log();
            let mut record = Record::open(&log, UNLIMITED).expect("a new log");
            record.take(at(u32::MAX - 2, b"abcdef")).expect("room");
            record.file.set_len(record.len - 6 + cut).expect("shorter");
            let mut record = Record::open(&log, UNLIMITED).expect("the log of before");
            record.take(at(u32::MAX - 2, b"abcdef")).expect("room");
            assert_eq!(output(&log), "abcdef", "cut after {cut}");
        }
    }

    #[test]
    fn a_line_that_was_cut_anywhere_is_completed() {
        let (_directory, log) = log();
        let mut record = Record::open(&log, UNLIMITED).expect("a new log");
        record.take(at(0, b"abc")).expect("room");
        let before = record.len;
        record.take(at(6, b"")).expect("nothing");
        record.take(at(8, b"def")).expect("room");
        let whole = std::fs::read_to_string(&log).expect("there is a log");
        assert!(
            whole.ends_with("abc\r\n[5 bytes overwritten]\r\ndef"),
            "{whole}"
        );
        for cut in before..=record.len {
            record.file.set_len(cut).expect("shorter");
            let mut record = Record::open(&log, UNLIMITED).expect("the log of before");
            record.take(at(8, b"def")).expect("room");
            let again = std::fs::read_to_string(&log).expect("there is a log");
            assert_eq!(again, whole, "cut at {cut}");
        }
    }

    #[test]
    fn a_new_incarnation_has_a_line_of_its_own() {
        let (_directory, log) = log();
        let mut record = Record::open(&log, UNLIMITED).expect("a new log");
        record.take(at(0, b"abc")).expect("room");
        let next = Piece {
            incarnation: 8,
            ..at(0, b"abc")
        };
        record.take(next).expect("room");
        assert_eq!(output(&log), "abcabc");
        let text = std::fs::read_to_string(&log).expect("there is a log");
        assert_eq!(text.matches("[began at ").count(), 2, "{text}");
    }

    /// All that can be read from an offset on.
    fn read(record: &Record, mut offset: u64) -> String {
        let mut text = String::new();
        loop {
            let mut piece = [0; 7];
            let (from, count) = record.read_at(&mut piece, offset).expect("it is read");
            if count == 0 {
                return text;
            }
            text += core::str::from_utf8(&piece[..count]).expect("a text");
            offset = from + count as u64;
        }
    }

    #[test]
    fn a_full_log_is_kept_once_and_read_across() {
        let (directory, log) = log();
        let mut record = Record::open(&log, 64).expect("a new log");
        let mut all = String::new();
        for number in 0..100 {
            let line = format!("line {number:03}\r\n");
            let piece = at(10 * number, line.as_bytes());
            record.take(piece).expect("room");
            all += &line;
            assert!(record.len < 64 + line.len() as u64);
            // A reader that keeps up misses nothing, and one that begins has the end of it.
            let behind = record.end_offset().saturating_sub(30);
            assert!(all.ends_with(&read(&record, behind)) || number < 3);
        }
        let seen = read(&record, 0);
        assert!(all.ends_with(&seen), "{seen}");
        assert!((64..64 * 3).contains(&seen.len()), "{}", seen.len());
        let files = std::fs::read_dir(directory.path()).expect("a directory");
        assert_eq!(files.count(), 3, "log, old log and mark");
        assert_eq!(read(&record, u64::MAX), "");
        // Another writer goes on, with the same offsets.
        let end = record.end_offset();
        drop(record);
        let mut record = Record::open(&log, 64).expect("the log of before");
        assert_eq!(record.end_offset(), end);
        record.take(at(990, b"line 099\r\nmore")).expect("room");
        assert_eq!(read(&record, end), "more");
        assert_eq!(read(&record, end - 4), "99\r\nmore");
    }

    #[test]
    fn whoever_dies_between_two_logs_loses_and_doubles_nothing() {
        for step in 0..4 {
            let (_directory, log) = log();
            let mut record = Record::open(&log, 100).expect("a new log");
            record.take(at(0, b"abcdef")).expect("room");
            let next = Mark {
                incarnation: 7,
                position: 6,
                offset: 0,
                before: record.end_offset(),
                line: String::new(),
            };
            // As `rotate` does.
            if step > 0 {
                next.write(&announced(&log)).expect("it is written");
            }
            if step > 1 {
                std::fs::rename(&log, old(&log)).expect("it is moved");
            }
            if step > 2 {
                std::fs::rename(announced(&log), marked(&log)).expect("it is moved");
            }
            drop(record);
            let mut record = Record::open(&log, 100).expect("the log of before");
            assert!(!announced(&log).exists());
            assert_eq!(record.take(at(3, b"defghi")).expect("room"), 6);
            let text = read(&record, 0);
            assert!(
                text.ends_with("]\r\nabcdefghi"),
                "after step {step}: {text}"
            );
            assert_eq!(text.matches('[').count(), 1, "after step {step}: {text}");
        }
    }
}
