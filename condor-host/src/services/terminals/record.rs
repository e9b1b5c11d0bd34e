//! [`Record`]: the log of a terminal, which holds every byte of its output once.

use std::fs::File;
use std::io::{self, Write};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use condor_tty::linux::Sink;
use jiff::Timestamp;

/// The log of a terminal.
///
/// From the byte `offset` on, the log holds the output of a life from `position` on, without a gap;
/// so its length alone says which byte comes next, and whatever moment the writer is killed in, the
/// next one knows. Where there is a gap, or a new life, a line says so; it and its mark are written
/// so that a half-written one is completed.
///
/// A log that has `limit` bytes becomes the old log, in the place of the one before, and a new one
/// goes on. Offsets of readers count on, from the first byte that was ever in a log of the terminal.
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
    /// Bytes of all logs before.
    before: u64,
    /// The line that ends at `offset`.
    line: String,
}

impl Record {
    /// The log in this file, which is no longer than `limit` and what is taken at once.
    pub(super) fn open(log: &Path, limit: u64) -> io::Result<Self> {
        let mark_path = log.with_extension("mark");
        let announced = log.with_extension("mark.next");
        // A former writer has announced a new log: it begins once the other one is out of the way.
        if announced.try_exists()? {
            if log.try_exists()? {
                std::fs::remove_file(&announced)?;
            } else {
                std::fs::rename(&announced, &mark_path)?;
            }
        }
        let file = open(log)?;
        let mark = Mark::read(&mark_path);
        let before = mark.as_ref().map_or(0, |mark| mark.before);
        let old = match File::open(old(log)) {
            Ok(old) => Some(old),
            Err(error) if error.kind() == io::ErrorKind::NotFound => None,
            Err(error) => return Err(error),
        };
        let old = match old.filter(|_| before > 0) {
            Some(old) => Some((old.metadata()?.len(), old)),
            None => None,
        };
        let mut this = Self {
            path: log.into(),
            limit,
            len: file.metadata()?.len(),
            file,
            before,
            old: old.map(|(len, old)| (old, len)),
            mark,
            mark_path,
            life: 0,
            next: 0,
        };
        this.complete()?;
        Ok(this)
    }

    /// Goes on in a new log. The position of its first byte is announced before, so that whoever is
    /// killed in the midst of this leaves the old log whole, or a new one that is known.
    fn rotate(&mut self, position: u32) -> io::Result<()> {
        let mark = Mark {
            life: self.life,
            position,
            offset: 0,
            before: self.before + self.len,
            line: String::new(),
        };
        let announced = self.path.with_extension("mark.next");
        mark.write(&announced)?;
        std::fs::rename(&self.path, old(&self.path))?;
        std::fs::rename(&announced, &self.mark_path)?;
        let former = core::mem::replace(&mut self.file, open(&self.path)?);
        self.old = Some((former, self.len));
        self.before = mark.before;
        self.len = 0;
        self.mark = Some(mark);
        Ok(())
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

    /// The offset behind the last byte.
    pub(super) fn end_offset(&self) -> u64 {
        self.before + self.len
    }

    /// Reads from an offset on; gives the offset of the first byte that was read, which is a later
    /// one if that is in no log any more, and how many were.
    pub(super) fn read_at(&self, into: &mut [u8], offset: u64) -> io::Result<(u64, usize)> {
        let offset = offset.min(self.end_offset());
        if let Some(at) = offset.checked_sub(self.before) {
            return Ok((offset, self.file.read_at(into, at)?));
        }
        let Some((old, len)) = &self.old else {
            return Ok((self.before, self.file.read_at(into, 0)?));
        };
        let first = self.before.saturating_sub(*len);
        let offset = offset.max(first);
        Ok((offset, old.read_at(into, offset - first)?))
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
            before: self.before,
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
        if self.len >= self.limit
            && let Some(end) = self.end()
        {
            self.rotate(end)?;
        }
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
            before: numbers.next()?.parse().ok()?,
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
            before,
            line,
        } = self;
        let part = path.with_extension("part");
        std::fs::write(
            &part,
            format!("{life} {position} {offset} {before}\n{line}"),
        )?;
        std::fs::rename(part, path)
    }
}

fn open(log: &Path) -> io::Result<File> {
    let mut options = File::options();
    options.read(true).append(true).create(true).open(log)
}

/// Where the log is kept that was full before.
fn old(log: &Path) -> PathBuf {
    log.with_extension("old.log")
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

    fn log() -> (tempfile::TempDir, PathBuf) {
        let directory = tempfile::tempdir().expect("a directory");
        let log = directory.path().join("hand.log");
        (directory, log)
    }

    #[test]
    fn what_was_not_acknowledged_is_not_written_twice() {
        let (_directory, log) = log();
        let mut record = Record::open(&log, UNLIMITED).expect("a new log");
        record.attached(7, 0);
        assert_eq!(record.take(b"abcdef").expect("room"), 6);
        drop(record);
        // Killed after the write, and before four of the bytes were acknowledged.
        let mut record = Record::open(&log, UNLIMITED).expect("the log of before");
        record.attached(7, 2);
        assert_eq!(record.take(b"cde").expect("room"), 3);
        assert_eq!(record.take(b"fgh").expect("room"), 3);
        assert_eq!(output(&log), "abcdefgh");
    }

    #[test]
    fn a_write_that_was_cut_anywhere_is_completed() {
        for cut in 0..=6 {
            let (_directory, log) = log();
            let mut record = Record::open(&log, UNLIMITED).expect("a new log");
            record.attached(7, u32::MAX - 2);
            record.take(b"abcdef").expect("room");
            record.file.set_len(record.len - 6 + cut).expect("shorter");
            let mut record = Record::open(&log, UNLIMITED).expect("the log of before");
            record.attached(7, u32::MAX - 2);
            record.take(b"abcdef").expect("room");
            assert_eq!(output(&log), "abcdef", "cut after {cut}");
        }
    }

    #[test]
    fn a_line_that_was_cut_anywhere_is_completed() {
        let (_directory, log) = log();
        let mut record = Record::open(&log, UNLIMITED).expect("a new log");
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
            let mut record = Record::open(&log, UNLIMITED).expect("the log of before");
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
        let mut record = Record::open(&log, UNLIMITED).expect("a new log");
        record.attached(7, 0);
        record.take(b"abc").expect("room");
        record.restarted();
        record.attached(8, 0);
        record.take(b"abc").expect("room");
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
        record.attached(7, 0);
        record.take(b"").expect("nothing");
        let mut all = String::new();
        for number in 0..100 {
            let line = format!("line {number:03}\r\n");
            record.take(line.as_bytes()).expect("room");
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
        record.attached(7, 990);
        record.take(b"line 099\r\nmore").expect("room");
        assert_eq!(read(&record, end), "more");
        assert_eq!(read(&record, end - 4), "99\r\nmore");
    }

    #[test]
    fn whoever_dies_between_two_logs_loses_and_doubles_nothing() {
        for step in 0..4 {
            let (_directory, log) = log();
            let mut record = Record::open(&log, 100).expect("a new log");
            record.attached(7, 0);
            record.take(b"abcdef").expect("room");
            let (announced, mark) = (log.with_extension("mark.next"), &record.mark_path);
            let next = Mark {
                life: 7,
                position: 6,
                offset: 0,
                before: record.end_offset(),
                line: String::new(),
            };
            // As `rotate` does.
            if step > 0 {
                next.write(&announced).expect("it is written");
            }
            if step > 1 {
                std::fs::rename(&log, old(&log)).expect("it is moved");
            }
            if step > 2 {
                std::fs::rename(&announced, mark).expect("it is moved");
            }
            drop(record);
            let mut record = Record::open(&log, 100).expect("the log of before");
            assert!(!announced.exists());
            record.attached(7, 3);
            assert_eq!(record.take(b"defghi").expect("room"), 6);
            let text = read(&record, 0);
            assert!(
                text.ends_with("]\r\nabcdefghi"),
                "after step {step}: {text}"
            );
            assert_eq!(text.matches('[').count(), 1, "after step {step}: {text}");
        }
    }
}
