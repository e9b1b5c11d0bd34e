//! The events of a system, for the log, for clients that follow them, and for standard error.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use jiff::Timestamp;
use rustix::event::{PollFd, PollFlags, Timespec};

use crate::control::{MemberState, SystemEvent};
use crate::plain::plain;

/// The size at which the log is rotated, in bytes, because it lies in memory; one previous log is
/// kept.
const FULL: u64 = 1 << 20;
/// Bytes of the log that are shown at once.
const SHOWN: usize = 1 << 20;
/// Bytes of the text of an event; a program may have written a line without an end.
const LONGEST: usize = 2048;
/// The greatest number of events that wait for followers; a turn makes fewer.
const NEWS: usize = 4096;

/// The log of a running system.
pub(super) struct Journal {
    path: PathBuf,
    /// None if it could not be opened again when it was full.
    file: Option<File>,
    len: u64,
    full: u64,
    /// The old log is of this run, too.
    goes_on: bool,
    echo: bool,
    /// The events that have not been sent to followers yet.
    news: Vec<SystemEvent>,
}

/// The source of events of the supervisor itself.
pub(super) const CONDOR: &str = "condor";

impl Journal {
    /// A log in `path`; that of the run before is kept beside it.
    pub(super) fn new(path: &Path, echo: bool) -> std::io::Result<Self> {
        match std::fs::rename(path, old(path)) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
        Ok(Self {
            path: path.into(),
            file: Some(open(path)?),
            len: 0,
            full: FULL,
            goes_on: false,
            echo,
            news: Vec::new(),
        })
    }

    /// Writes an event. A robot does not stop because its log cannot be written.
    pub(super) fn tell(
        &mut self,
        source: &str,
        text: impl Into<String>,
        state: Option<MemberState>,
    ) {
        let text = text.into();
        let mut text = plain(&text).into_owned();
        if text.len() > LONGEST {
            let mut end = LONGEST;
            while !text.is_char_boundary(end) {
                end -= 1;
            }
            text.truncate(end);
            text.push('…');
        }
        let event = SystemEvent {
            time: format!("{:.6}", Timestamp::now()),
            source: source.into(),
            text,
            state,
        };
        let line = format!("{event}\n");
        self.write(&line);
        if self.echo && takes_more(&std::io::stderr()) {
            let _ = std::io::stderr().write_all(line.as_bytes());
        }
        if self.news.len() < NEWS {
            self.news.push(event);
        }
    }

    fn write(&mut self, line: &str) {
        if self.len >= self.full {
            self.goes_on = std::fs::rename(&self.path, old(&self.path)).is_ok();
            if !self.goes_on {
                // One that cannot be kept is begun anew.
                let _ = std::fs::remove_file(&self.path);
            }
            self.file = None;
            self.len = 0;
        }
        if self.file.is_none() {
            self.file = open(&self.path).ok();
        }
        if let Some(file) = &mut self.file {
            self.len += line.len() as u64;
            let _ = file.write_all(line.as_bytes());
        }
    }

    pub(super) fn news(&mut self) -> Vec<SystemEvent> {
        core::mem::take(&mut self.news)
    }

    /// The last lines of this run, as far as they are kept.
    pub(super) fn last_lines(&self, count: usize) -> std::io::Result<Vec<String>> {
        let mut text = std::fs::read(&self.path)?;
        if self.goes_on {
            let mut both = std::fs::read(old(&self.path))?;
            both.append(&mut text);
            text = both;
        }
        Ok(last(&text, count))
    }
}

fn open(path: &Path) -> std::io::Result<File> {
    File::options().append(true).create(true).open(path)
}

/// Returns the path of the previous log, which was full or is that of the previous run.
fn old(path: &Path) -> PathBuf {
    path.with_extension("old")
}

/// Returns true if a line can be written without waiting for its reader: a terminal may be stopped,
/// and the other end of a pipe may not be read.
fn takes_more(output: &impl std::os::fd::AsFd) -> bool {
    let mut polled = [PollFd::new(output, PollFlags::OUT)];
    let now = Timespec::default();
    matches!(rustix::event::poll(&mut polled, Some(&now)), Ok(1..))
}

/// Returns the last `count` lines of `log`, the content of a log file, oldest first. Only the last MiB of `log` is
/// searched for lines.
#[must_use]
pub fn last(log: &[u8], count: usize) -> Vec<String> {
    let from = log.len().saturating_sub(SHOWN);
    let text = String::from_utf8_lossy(log.get(from..).unwrap_or_default());
    let lines: Vec<_> = text.lines().collect();
    let from = lines.len().saturating_sub(count);
    let last = lines.get(from..).unwrap_or_default();
    last.iter().map(|&line| line.into()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn journal(full: u64) -> (tempfile::TempDir, PathBuf, Journal) {
        let place = tempfile::tempdir().expect("a directory");
        let path = place.path().join("log");
        let mut journal = Journal::new(&path, false).expect("room");
        journal.full = full;
        (place, path, journal)
    }

    #[test]
    fn a_log_is_kept_once_and_has_no_more_than_its_size() {
        let (place, path, mut journal) = journal(1000);
        for number in 0..1000 {
            journal.tell("a", format!("line {number}"), None);
        }
        let size = |path: &Path| std::fs::metadata(path).expect("it is there").len();
        for path in [path.clone(), old(&path)] {
            assert!(size(&path) < 1100, "{path:?}: {}", size(&path));
        }
        let files = std::fs::read_dir(place.path()).expect("it is there");
        assert_eq!(files.count(), 2);
        let last = journal.last_lines(20).expect("it is read");
        assert_eq!(last.len(), 20);
        for (line, number) in last.iter().zip(980..) {
            assert!(line.ends_with(&format!("a: line {number}")), "{line}");
        }
    }

    #[test]
    fn one_that_cannot_be_kept_is_bounded_all_the_same() {
        let (_place, path, mut journal) = journal(1000);
        std::fs::create_dir(old(&path)).expect("room");
        for number in 0..1000 {
            journal.tell("a", format!("line {number}"), None);
        }
        let size = std::fs::metadata(&path).expect("it is there").len();
        assert!(size < 1100, "{size}");
    }

    #[test]
    fn what_a_program_wrote_is_plain_and_short() {
        let (_place, path, mut journal) = journal(FULL);
        journal.tell("a", format!("\x1b[2J{}", "ä".repeat(9000)), None);
        let [event] = <[_; 1]>::try_from(journal.news()).expect("one");
        assert!(event.text.starts_with("\\u{1b}[2Jä"), "{}", event.text);
        assert!(event.text.len() <= LONGEST + '…'.len_utf8());
        let text = std::fs::read_to_string(path).expect("a log");
        assert!(text.ends_with("ä…\n") && !text.contains('\x1b'), "{text}");
    }
}
