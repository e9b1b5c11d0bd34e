//! [`Typing`]: all characters that are typed at a terminal; its program gets each of them once.

use std::fs::File;
use std::io::{self, Write as _};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use rustix::fs::{FallocateFlags, fallocate};

use super::mark::Mark;
use super::script::ScriptWriter;

/// The number of typed characters that may wait for the program of a terminal.
pub(super) const WAITING: u64 = 64 * 1024;
/// The mark is written anew after so many characters that the terminal has taken.
const STEP: u64 = 16 * 1024;

/// The file to which characters are added, and how far the terminal has taken them.
///
/// The terminal counts what it takes, in its own memory. From the mark on, every character of the
/// file is sent, so the count says which comes next.
#[derive(Debug)]
pub(super) struct Typing {
    file: File,
    mark_path: PathBuf,
    mark: Option<Mark>,
    /// The offset at which the next characters are read; `None` while characters of a previous service may
    /// still be under way.
    next: Option<u64>,
    /// The name of the terminal and its record, in simulated time.
    writer: Option<(String, Rc<ScriptWriter>)>,
}

/// The file of the terminal with this log.
pub(super) fn file_of(log: &Path) -> PathBuf {
    log.with_extension("typed")
}

/// A keyboard for the terminal of one processor. Typed characters wait in a file until the program reads them; the
/// number that may wait is limited. [`keyboard`](super::keyboard) opens it.
#[derive(Debug)]
pub struct Keyboard {
    pub(crate) file: File,
    mark_path: PathBuf,
    /// The number of characters that the terminal had taken when this was last looked for.
    taken: u64,
}

impl Keyboard {
    pub(super) fn open(log: &Path) -> io::Result<Self> {
        let path = file_of(log);
        Ok(Self {
            file: open(&path)?,
            mark_path: mark_of(&path),
            taken: 0,
        })
    }

    /// Returns how many characters there is room for; what the terminal has taken is looked for only if
    /// there is none for `count` of them otherwise.
    pub(crate) fn room(&mut self, count: usize) -> io::Result<usize> {
        let end = self.file.metadata()?.len();
        let room = |taken| WAITING.saturating_sub(end.saturating_sub(taken));
        if room(self.taken) < count as u64
            && let Some(mark) = Mark::read(&self.mark_path)
        {
            self.taken = mark.offset;
        }
        Ok(usize::try_from(room(self.taken)).unwrap_or(0))
    }

    /// Types the first of `characters`, as many as there is room for, and returns their number; 0 if there is no room.
    ///
    /// # Errors
    /// Returns the operating system's error if the file of typed characters cannot be read or written.
    pub fn type_in(&mut self, characters: &[u8]) -> io::Result<usize> {
        let count = self.room(characters.len())?.min(characters.len());
        let characters = characters.get(..count).unwrap_or_default();
        if characters.is_empty() {
            return Ok(0);
        }
        self.file.write(characters)
    }
}

fn mark_of(path: &Path) -> PathBuf {
    path.with_extension("typed.mark")
}

/// Opens it; what is written is added at its end.
pub(super) fn open(path: &Path) -> io::Result<File> {
    let mut options = File::options();
    options.read(true).append(true).create(true).open(path)
}

impl Typing {
    pub(super) fn open(log: &Path, writer: Option<(String, Rc<ScriptWriter>)>) -> io::Result<Self> {
        let path = file_of(log);
        let mark_path = mark_of(&path);
        Ok(Self {
            file: open(&path)?,
            mark: Mark::read(&mark_path),
            mark_path,
            next: None,
            writer,
        })
    }

    /// Adds characters; those that it has added are `characters` no longer, even if it fails.
    pub(super) fn add(&mut self, characters: &mut Vec<u8>) -> io::Result<()> {
        while !characters.is_empty() {
            match self.file.write(characters) {
                Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
                Ok(count) => drop(characters.drain(..count)),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// Whether more characters may be added: fewer than [`WAITING`] have not been read.
    pub(super) fn has_room(&self) -> io::Result<bool> {
        let marked = self.mark.as_ref().map_or(0, |mark| mark.offset);
        let taken = self.next.unwrap_or(marked);
        Ok(self.file.metadata()?.len().saturating_sub(taken) < WAITING)
    }

    /// Moves the mark on when the terminal has taken many characters since, and returns the room of those
    /// characters to the filesystem. No character is under way, and the last `waiting` of the characters that
    /// were read come next.
    fn move_mark(&mut self, waiting: usize) {
        let (Some(next), Some(mark)) = (self.next, &self.mark) else {
            return;
        };
        let offset = next.saturating_sub(waiting as u64);
        let count = offset.saturating_sub(mark.offset);
        if count < STEP {
            return;
        }
        let mark = Mark {
            incarnation: mark.incarnation,
            // Both wrap alike.
            position: mark.position.wrapping_add(count as u32),
            offset,
            ..Mark::default()
        };
        // Without the new mark the former one is right, too.
        if mark.write(&self.mark_path).is_ok() {
            self.mark = Some(mark);
            // A recorder that is late may still read a little behind; a filesystem that cannot punch holes
            // keeps the file as it is.
            let flags = FallocateFlags::PUNCH_HOLE | FallocateFlags::KEEP_SIZE;
            if let Some(past @ 1..) = offset.checked_sub(WAITING) {
                let _ = fallocate(&self.file, flags, 0, past);
            }
        }
    }

    /// Reads the next characters into `into`; returns their number.
    pub(super) fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let Some(next) = &mut self.next else {
            return Ok(0);
        };
        let most = match &self.writer {
            Some((name, writer)) => writer.readable(name, *next, into.len()),
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

    /// Returns true if `character` may be sent. It is the first of the last `waiting` characters
    /// that were read.
    pub(super) fn sends(&mut self, character: u8, waiting: usize) -> io::Result<bool> {
        self.move_mark(waiting);
        let (Some((name, writer)), Some(next)) = (&self.writer, self.next) else {
            return Ok(true);
        };
        writer.sends(name, next.saturating_sub(waiting as u64), character)
    }

    /// Begins to send, when no character is under way: the terminal has taken `taken` characters in
    /// this incarnation, and the last `waiting` of the characters that were read come next.
    pub(super) fn begin(&mut self, incarnation: u32, taken: u32, waiting: usize) -> io::Result<()> {
        let offset = match (self.next, &self.mark) {
            (Some(next), _) => next.saturating_sub(waiting as u64),
            (None, Some(mark)) if mark.incarnation == incarnation => {
                mark.offset + u64::from(taken.wrapping_sub(mark.position))
            }
            // Service and program have both begun anew: nobody knows what the former ones did, and
            // to do it twice would be worse than not to do it.
            (None, Some(_)) => self.file.metadata()?.len(),
            (None, None) => 0,
        };
        let mark = Mark {
            incarnation,
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
    fn what_waits_is_bounded_and_what_was_taken_needs_no_room() {
        use std::os::unix::fs::MetadataExt;
        let (_directory, log) = typing("");
        let mut keyboard = Keyboard::open(&log).expect("it opens");
        let mut typing = Typing::open(&log, None).expect("it opens");
        typing.begin(1, u32::MAX - 9, 0).expect("a mark");
        let (mut typed, mut taken) = (0_usize, 0_usize);
        while typed < 1 << 20 {
            // Somebody who types does so until there is no room.
            loop {
                let piece: Vec<u8> = (typed..typed + 1000).map(|it| it as u8).collect();
                let count = keyboard.type_in(&piece).expect("it can be written");
                typed += count;
                if count == 0 {
                    break;
                }
            }
            assert!(typed - taken <= WAITING as usize);
            assert!(!typing.has_room().expect("its length") || typed - taken < WAITING as usize);
            let mut bytes = [0; 256];
            for _ in 0..100 {
                let count = typing.read(&mut bytes).expect("it can be read");
                for (place, byte) in bytes[..count].iter().enumerate() {
                    assert_eq!(*byte, taken as u8);
                    assert!(typing.sends(*byte, count - place).expect("no script"));
                    taken += 1;
                }
            }
        }
        let most = 4 * WAITING;
        let allocated = typing.file.metadata().expect("its size").blocks() * 512;
        assert!(allocated <= most, "{allocated} bytes");
        // The next service finds its place by the terminal's count.
        drop(typing);
        let mut next = Typing::open(&log, None).expect("it opens");
        let count = (u32::MAX - 9).wrapping_add(taken as u32);
        next.begin(1, count, 0).expect("a mark");
        let mut bytes = [0; 1];
        next.read(&mut bytes).expect("it can be read");
        assert_eq!(bytes, [taken as u8]);
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
        // `cd` wait with the host, which sends them to the new incarnation.
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
