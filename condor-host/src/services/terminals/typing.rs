//! [`Typing`]: all characters that are typed at a terminal; its program gets each of them once.

use std::fs::File;
use std::io::{self, Write as _};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use super::mark::Mark;
use super::script::Pen;

/// The file to which characters are added, and how far the terminal has taken them.
///
/// The terminal counts what it takes, in its own memory. From the mark on, every character of the
/// file is sent, so the count says which comes next.
#[derive(Debug)]
pub(super) struct Typing {
    file: File,
    mark_path: PathBuf,
    mark: Option<Mark>,
    /// Where the next characters are read; none as long as some of a former service may be under way.
    next: Option<u64>,
    /// The name of the terminal and its record, in simulated time.
    pen: Option<(String, Rc<Pen>)>,
}

/// The file of the terminal with this log.
pub(super) fn file_of(log: &Path) -> PathBuf {
    log.with_extension("typed")
}

/// Opens it; what is written is added at its end.
pub(super) fn open(path: &Path) -> io::Result<File> {
    let mut options = File::options();
    options.read(true).append(true).create(true).open(path)
}

impl Typing {
    pub(super) fn open(log: &Path, pen: Option<(String, Rc<Pen>)>) -> io::Result<Self> {
        let path = file_of(log);
        let mark_path = path.with_extension("typed.mark");
        Ok(Self {
            file: open(&path)?,
            mark: Mark::read(&mark_path),
            mark_path,
            next: None,
            pen,
        })
    }

    /// Adds characters, all or none of them.
    pub(super) fn add(&mut self, characters: &[u8]) -> io::Result<()> {
        self.file.write_all(characters)
    }

    /// What comes next.
    pub(super) fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let Some(next) = &mut self.next else {
            return Ok(0);
        };
        let most = match &self.pen {
            Some((name, pen)) => pen.readable(name, *next, into.len()),
            None => into.len(),
        };
        let into = into.get_mut(..most).unwrap_or_default();
        let count = self.file.read_at(into, *next)?;
        *next += count as u64;
        Ok(count)
    }

    /// The last `waiting` of the characters that were read have not been sent, and come next.
    pub(super) fn put_back(&mut self, waiting: usize) {
        if let Some(next) = &mut self.next {
            *next = next.saturating_sub(waiting as u64);
        }
    }

    /// Returns whether `character` may be sent. It is the first of the last `waiting` characters
    /// that were read.
    pub(super) fn sends(&mut self, character: u8, waiting: usize) -> io::Result<bool> {
        let (Some((name, pen)), Some(next)) = (&self.pen, self.next) else {
            return Ok(true);
        };
        pen.sends(name, next.saturating_sub(waiting as u64), character)
    }

    /// Begins to send, when no character is under way: the terminal has taken `taken` characters in
    /// this life, and the last `waiting` of the characters that were read come next.
    pub(super) fn begin(&mut self, life: u32, taken: u32, waiting: usize) -> io::Result<()> {
        let offset = match (self.next, &self.mark) {
            (Some(next), _) => next.saturating_sub(waiting as u64),
            (None, Some(mark)) if mark.life == life => {
                mark.offset + u64::from(taken.wrapping_sub(mark.position))
            }
            // Service and program have both begun anew: nobody knows what the former ones did, and
            // to do it twice would be worse than not to do it.
            (None, Some(_)) => self.file.metadata()?.len(),
            (None, None) => 0,
        };
        let mark = Mark {
            life,
            position: taken,
            offset,
            ..Mark::default()
        };
        if self.mark.as_ref() != Some(&mark) {
            mark.write(&self.mark_path)?;
            self.mark = Some(mark);
        }
        self.next = Some(offset + waiting as u64);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn typing(text: &str) -> (tempfile::TempDir, PathBuf) {
        let directory = tempfile::tempdir().expect("a directory");
        let log = directory.path().join("hand.log");
        type_more(&log, text);
        (directory, log)
    }

    fn type_more(log: &Path, text: &str) {
        let mut file = open(&file_of(log)).expect("a file");
        file.write_all(text.as_bytes()).expect("room");
    }

    fn rest(typing: &mut Typing) -> String {
        let mut bytes = [0; 64];
        let count = typing.read(&mut bytes).expect("it can be read");
        String::from_utf8_lossy(&bytes[..count]).into_owned()
    }

    #[test]
    fn the_next_service_goes_on_after_what_the_terminal_has_taken() {
        let (_directory, log) = typing("abcdef");
        let mut first = Typing::open(&log, None).expect("it opens");
        assert_eq!(rest(&mut first), "", "before the terminal was asked");
        first.begin(7, u32::MAX, 0).expect("a mark");
        assert_eq!(rest(&mut first), "abcdef");
        drop(first);
        let mut second = Typing::open(&log, None).expect("it opens");
        // The terminal has taken four, and its count has wrapped.
        second.begin(7, 3, 0).expect("a mark");
        assert_eq!(rest(&mut second), "ef");
        type_more(&log, "gh");
        assert_eq!(rest(&mut second), "gh");
    }

    #[test]
    fn what_was_read_for_a_terminal_that_has_gone_is_read_again() {
        let (_directory, log) = typing("abcd");
        let mut typing = Typing::open(&log, None).expect("it opens");
        typing.begin(1, 0, 0).expect("a mark");
        assert_eq!(rest(&mut typing), "abcd");
        // Another terminal of the program takes the place of this one, which has taken one.
        typing.put_back(3);
        typing.begin(2, 0, 0).expect("a mark");
        assert_eq!(rest(&mut typing), "bcd");
    }

    #[test]
    fn what_an_interrupt_dropped_is_not_typed_by_the_next_service() {
        let (_directory, log) = typing("abcd\x03xy");
        let mut first = Typing::open(&log, None).expect("it opens");
        first.begin(1, 0, 0).expect("a mark");
        rest(&mut first);
        // `a` was taken, `bcd` dropped.
        first.begin(1, 1, 3).expect("a mark");
        for (taken, left) in [(1, "\x03xy"), (2, "xy"), (4, "")] {
            let mut next = Typing::open(&log, None).expect("it opens");
            next.begin(1, taken, 0).expect("a mark");
            assert_eq!(rest(&mut next), left);
        }
    }

    #[test]
    fn a_new_program_gets_what_the_former_one_did_not_take() {
        let (_directory, log) = typing("abcd");
        let mut typing = Typing::open(&log, None).expect("it opens");
        typing.begin(1, 0, 0).expect("a mark");
        assert_eq!(rest(&mut typing), "abcd");
        // `cd` wait with the host, which sends them to the new life.
        typing.begin(2, 0, 2).expect("a mark");
        assert_eq!(rest(&mut typing), "");
        drop(typing);
        let mut next = Typing::open(&log, None).expect("it opens");
        next.begin(2, 1, 0).expect("a mark");
        assert_eq!(rest(&mut next), "d");
        drop(next);
        // Both have begun anew: what was typed for the former ones is over.
        let mut last = Typing::open(&log, None).expect("it opens");
        last.begin(3, 0, 0).expect("a mark");
        assert_eq!(rest(&mut last), "");
        type_more(&log, "e");
        assert_eq!(rest(&mut last), "e");
    }
}
