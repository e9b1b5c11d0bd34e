//! [`Record`]: the log of a terminal, which holds every byte of its output once.

use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use condor_tty::linux::Sink;
use jiff::Timestamp;

/// The log of a terminal.
///
/// From the byte `offset` on, the log holds the output of a life from `position` on, without a gap;
/// so its length alone says which byte comes next, and whatever moment the writer is killed in, the
/// next one knows. Where there is a gap, or a new life, a line says so; it and its mark are written
/// so that a half-written one is completed.
#[derive(Debug)]
pub(super) struct Record {
    file: File,
    len: u64,
    mark_path: PathBuf,
    mark: Option<Mark>,
    life: u32,
    /// The position of what is offered next.
    next: u32,
}

/// Which byte of the output is where.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Mark {
    life: u32,
    position: u32,
    offset: u64,
    /// The line that ends at `offset`.
    line: String,
}

impl Record {
    pub(super) fn open(log: &Path) -> io::Result<Self> {
        let mark_path = log.with_extension("mark");
        let file = File::options()
            .read(true)
            .append(true)
            .create(true)
            .open(log)?;
        let mut this = Self {
            len: file.metadata()?.len(),
            file,
            mark: Mark::read(&mark_path),
            mark_path,
            life: 0,
            next: 0,
        };
        this.complete()?;
        Ok(this)
    }

    /// Writes the line of a mark that a former writer has only announced, or begun.
    fn complete(&mut self) -> io::Result<()> {
        let Some(mark) = self.mark.clone() else {
            return Ok(());
        };
        if self.len >= mark.offset {
            return Ok(());
        }
        let begin = mark.offset.saturating_sub(mark.line.len() as u64);
        if self.len < begin {
            // Somebody has made the log shorter: what it holds is not known.
            self.mark = None;
            return Ok(());
        }
        self.file.set_len(begin)?;
        self.len = begin;
        self.append(mark.line.as_bytes())
    }

    pub(super) fn len(&self) -> u64 {
        self.len
    }

    pub(super) fn file(&self) -> &File {
        &self.file
    }

    fn append(&mut self, mut bytes: &[u8]) -> io::Result<()> {
        while !bytes.is_empty() {
            match self.file.write(bytes) {
                Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
                Ok(count) => {
                    self.len += count as u64;
                    bytes = bytes.get(count..).unwrap_or_default();
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// Begins to record at another byte: announces it, then writes its line.
    fn begin(&mut self, position: u32, text: &str) -> io::Result<()> {
        let line = format!("{}[{text}]\r\n", if self.len == 0 { "" } else { "\r\n" });
        let mark = Mark {
            life: self.life,
            position,
            offset: self.len + line.len() as u64,
            line,
        };
        mark.write(&self.mark_path)?;
        self.mark = Some(mark);
        self.complete()
    }

    /// The position that follows the last byte of the log, if that is of this life.
    fn end(&self) -> Option<u32> {
        let mark = self.mark.as_ref().filter(|mark| mark.life == self.life)?;
        // Positions wrap.
        let since = self.len.wrapping_sub(mark.offset) as u32;
        Some(mark.position.wrapping_add(since))
    }

    /// How many of the next `len` bytes the log has already; begins anew where it has a gap.
    fn known(&mut self, len: usize) -> io::Result<usize> {
        let position = self.next;
        let Some(end) = self.end() else {
            self.begin(position, &format!("began at {:.6}", Timestamp::now()))?;
            return Ok(0);
        };
        let ahead = end.wrapping_sub(position).cast_signed();
        if ahead < 0 {
            let gap = ahead.unsigned_abs();
            self.begin(position, &format!("{gap} bytes overwritten"))?;
        }
        Ok(usize::try_from(ahead).unwrap_or(0).min(len))
    }
}

impl Sink for Record {
    fn take(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if bytes.is_empty() {
            return Ok(0);
        }
        let known = self.known(bytes.len())?;
        self.next = self.next.wrapping_add(known as u32);
        let fresh = bytes.get(known..).unwrap_or_default();
        let before = self.len;
        let outcome = self.append(fresh);
        let written = self.len.wrapping_sub(before);
        self.next = self.next.wrapping_add(written as u32);
        let taken = known + usize::try_from(written).unwrap_or(0);
        if taken == 0 {
            outcome?;
        }
        Ok(taken)
    }

    fn overwritten(&mut self, bytes: u32) -> io::Result<()> {
        self.next = self.next.wrapping_add(bytes);
        Ok(())
    }

    fn attached(&mut self, life: u32, position: u32) {
        self.life = life;
        self.next = position;
    }
}

impl Mark {
    fn read(path: &Path) -> Option<Self> {
        let text = std::fs::read_to_string(path).ok()?;
        let (numbers, line) = text.split_once('\n')?;
        let mut numbers = numbers.split(' ');
        let mark = Self {
            life: numbers.next()?.parse().ok()?,
            position: numbers.next()?.parse().ok()?,
            offset: numbers.next()?.parse().ok()?,
            line: line.into(),
        };
        Some(mark)
    }

    /// Replaces the mark of before as a whole.
    fn write(&self, path: &Path) -> io::Result<()> {
        let Self {
            life,
            position,
            offset,
            line,
        } = self;
        let part = path.with_extension("mark.part");
        std::fs::write(&part, format!("{life} {position} {offset}\n{line}"))?;
        std::fs::rename(part, path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The log without the lines in brackets.
    fn output(log: &Path) -> String {
        let text = std::fs::read_to_string(log).expect("there is a log");
        let parts = text.split('[').map(|part| part.split_once("]\r\n"));
        let parts: Vec<_> = parts.map(|part| part.map_or("", |part| part.1)).collect();
        parts.concat().replace("\r\n", "")
    }

    fn log() -> (tempfile::TempDir, PathBuf) {
        let directory = tempfile::tempdir().expect("a directory");
        let log = directory.path().join("hand.log");
        (directory, log)
    }

    #[test]
    fn what_was_not_acknowledged_is_not_written_twice() {
        let (_directory, log) = log();
        let mut record = Record::open(&log).expect("a new log");
        record.attached(7, 0);
        assert_eq!(record.take(b"abcdef").expect("room"), 6);
        drop(record);
        // Killed after the write, and before four of the bytes were acknowledged.
        let mut record = Record::open(&log).expect("the log of before");
        record.attached(7, 2);
        assert_eq!(record.take(b"cde").expect("room"), 3);
        assert_eq!(record.take(b"fgh").expect("room"), 3);
        assert_eq!(output(&log), "abcdefgh");
    }

    #[test]
    fn a_write_that_was_cut_anywhere_is_completed() {
        for cut in 0..=6 {
            let (_directory, log) = log();
            let mut record = Record::open(&log).expect("a new log");
            record.attached(7, u32::MAX - 2);
            record.take(b"abcdef").expect("room");
            record.file.set_len(record.len - 6 + cut).expect("shorter");
            let mut record = Record::open(&log).expect("the log of before");
            record.attached(7, u32::MAX - 2);
            record.take(b"abcdef").expect("room");
            assert_eq!(output(&log), "abcdef", "cut after {cut}");
        }
    }

    #[test]
    fn a_line_that_was_cut_anywhere_is_completed() {
        let (_directory, log) = log();
        let mut record = Record::open(&log).expect("a new log");
        record.attached(7, 0);
        record.take(b"abc").expect("room");
        let before = record.len;
        record.overwritten(5).expect("it is noted");
        record.take(b"def").expect("room");
        let whole = std::fs::read_to_string(&log).expect("there is a log");
        assert!(
            whole.ends_with("abc\r\n[5 bytes overwritten]\r\ndef"),
            "{whole}"
        );
        for cut in before..=record.len {
            record.file.set_len(cut).expect("shorter");
            let mut record = Record::open(&log).expect("the log of before");
            record.attached(7, 3);
            record.overwritten(5).expect("it is noted");
            record.take(b"def").expect("room");
            let again = std::fs::read_to_string(&log).expect("there is a log");
            assert_eq!(again, whole, "cut at {cut}");
        }
    }

    #[test]
    fn a_new_life_has_a_line_of_its_own() {
        let (_directory, log) = log();
        let mut record = Record::open(&log).expect("a new log");
        record.attached(7, 0);
        record.take(b"abc").expect("room");
        record.restarted();
        record.attached(8, 0);
        record.take(b"abc").expect("room");
        assert_eq!(output(&log), "abcabc");
        let text = std::fs::read_to_string(&log).expect("there is a log");
        assert_eq!(text.matches("[began at ").count(), 2, "{text}");
    }
}
