//! A host that answers a client with any reply, any state of the slot and any words in the window.
//!
//! Whatever the host answers, each call of the client ends after a bounded number of requests, returns no more
//! than it was asked for, and writes only in the client's own area.

use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex};

use crate::wire::{self, slot, state};
use crate::{Buffer, Errno, File, FileError, OpenOptions};
use condor_mbox::sim::{SimMailbox, SimWindow};
use condor_mbox::{Allocator, MemoryWindow};
use embedded_io::SeekFrom;

use super::Source;
use super::peer::{self, BUFFER, FILES, Fs, Own, PATH, Pair};

/// The size in bytes of the client's area in its window: all that an `Allocator` has allocated, in whole lines.
const AREA: u32 = lines(slot::BYTES)
    + lines(wire::table::BYTES)
    + lines(FILES as u32 * wire::block::BYTES)
    + lines((FILES as u32 + 2) * PATH)
    + lines(FILES as u32 * BUFFER);
/// The size of a buffer to lend, behind the area.
const LENT: u32 = 64;
/// The value of words that no program has a reason to write.
const GUARD: u32 = 0x5afe_c0de;
/// A number of requests that no single call may reach. The longest call closes all blocks and writes a whole
/// buffer byte by byte, and repeats each request as often as its timeout allows.
const MOST_REQUESTS: u32 = 1000;

const fn lines(bytes: u32) -> u32 {
    bytes.next_multiple_of(condor_mbox::layout::LINE)
}

type OpenFile<'f> = File<'f, 'static, SimMailbox<'static, 2>, SimWindow, FILES>;

/// The bytes that decide the answers of the host.
struct Hostile {
    bytes: Vec<u8>,
    next: usize,
}

/// Tests a client with a hostile host: the first half of `bytes` decides the calls of the client,
/// and the second half the answers of the host.
///
/// # Panics
/// Panics if a call does not end, returns more than it was asked for, or writes outside of the client's area.
pub fn run(bytes: &[u8]) {
    let (ours, theirs) = bytes.split_at(bytes.len() / 2);
    let hostile = Arc::new(Mutex::new(Hostile {
        bytes: theirs.to_owned(),
        next: 0,
    }));
    let requests = Arc::new(AtomicU32::new(0));
    let counted = requests.clone();
    let answer = move |own: &Own, at: u32| {
        counted.fetch_add(1, Ordering::Relaxed);
        hostile.lock().unwrap().answer(own, at)
    };
    peer::run(answer, |pair| {
        let mut allocator = Allocator::new(pair.own().size());
        allocator.bytes(AREA as usize).unwrap();
        let guards = || (AREA + LENT..pair.own().size()).step_by(4);
        for at in guards() {
            pair.own().set_word(at, GUARD).unwrap();
        }
        let program = Program {
            pair,
            requests: &requests,
        };
        program.run(&mut Source::new(ours), &mut allocator);
        for at in guards() {
            assert_eq!(pair.own().word(at), Ok(GUARD), "written at {at:#x}");
        }
    });
}

impl Hostile {
    fn byte(&mut self) -> u8 {
        // The bytes repeat, so that the host never becomes honest.
        let byte = self.bytes.get(self.next).copied().unwrap_or(0);
        self.next = (self.next + 1) % self.bytes.len().max(1);
        byte
    }

    fn words(&mut self) -> [u8; 8] {
        std::array::from_fn(|_| self.byte())
    }

    fn answer(&mut self, own: &Own, at: u32) -> u32 {
        let how = self.byte();
        if how & 1 == 0
            && let Some(request) = peer::request(own, at)
        {
            let bytes = self.words();
            let mut source = Source::new(&bytes);
            let value = u64::from(source.word()) | u64::from(source.byte() & 1) << 40;
            // Most values are those that a call hopes for.
            let value = match how >> 1 & 3 {
                0 => u64::from(request.buffer.len),
                1 => u64::from(how >> 3),
                2 => u64::from(request.buffer.len) + 1,
                _ => value,
            };
            let errno = if how & 0x80 == 0 { 0 } else { self.byte() };
            let outcome = if errno == 0 {
                Ok(value)
            } else {
                Err(errno.into())
            };
            peer::record(own, at, &request, outcome);
            // The words are entries of a directory, or data.
            let end = request.buffer.offset.saturating_add(request.buffer.len);
            for place in (request.buffer.offset & !3..end.min(AREA + LENT)).step_by(4) {
                let word = match self.byte() % 4 {
                    0 => u32::from(self.byte()),
                    1 => u32::from_le_bytes(*b".\0\0\0"),
                    2 => 1,
                    _ => u32::from_le_bytes([self.byte(), self.byte(), 0, self.byte()]),
                };
                own.set_word(place, word).unwrap();
            }
        }
        for _ in 0..self.byte() % 4 {
            let bytes = self.words();
            let mut source = Source::new(&bytes);
            let place = match source.byte() % 3 {
                0 => at + slot::STATE + 4 * source.below(slot::RESULT_WORDS as u32),
                1 => source.below(AREA / 4) * 4,
                _ => at + slot::STATE,
            };
            let word = match source.byte() % 3 {
                0 => state::STAGED,
                1 => state::DONE,
                _ => source.word(),
            };
            own.set_word(place, word).unwrap();
        }
        match self.byte() % 8 {
            0 => wire::REFUSED | u32::from(self.byte()),
            1 => u32::from_le_bytes(std::array::from_fn(|_| self.byte())),
            2 => wire::REFUSED | u32::from(Errno::AGAIN.0),
            3 => wire::with_value(u32::from_le_bytes(std::array::from_fn(|_| self.byte())).into()),
            _ => wire::DONE,
        }
    }
}

struct Program<'p> {
    pair: &'p Pair,
    requests: &'p AtomicU32,
}

impl Program<'_> {
    /// Makes one call, and checks that it ends.
    fn call<R>(&self, call: impl FnOnce() -> Result<R, FileError>) -> Option<R> {
        self.requests.store(0, Ordering::Relaxed);
        let outcome = call();
        let requests = self.requests.load(Ordering::Relaxed);
        assert!(requests <= MOST_REQUESTS, "{requests} requests");
        if let Err(error) = &outcome {
            assert!(!error.to_string().is_empty());
        }
        outcome.ok()
    }

    fn run(&self, source: &mut Source<'_>, allocator: &mut condor_mbox::Allocator) {
        let Some(fs) = self.call(|| self.pair.connect()) else {
            return;
        };
        let mut lent = Some(Buffer::new(self.pair.own(), allocator, LENT).unwrap());
        let mut files: [Option<OpenFile<'_>>; 2] = [None, None];
        while !source.is_empty() {
            let act = source.byte();
            let index = usize::from(act >> 7);
            match act & 0x7f {
                0..20 => {
                    files[index] = None; // First, so that its block is free.
                    files[index] = self.call(|| fs.open("a/path", options(source.byte())));
                }
                20..28 => self.names(&fs, source),
                28..36 => self.directory(&fs, source),
                36..40 => {
                    self.call(|| fs.settle(peer::TIMEOUT));
                }
                how => {
                    if let Some(file) = files[index].take() {
                        lent = lent.or_else(|| fs.take_buffer());
                        files[index] = self.file(file, how, source, &mut lent);
                    }
                }
            }
        }
    }

    fn names(&self, fs: &Fs, source: &mut Source<'_>) {
        let path = &b"a/path of some more bytes"[..usize::from(source.byte() % 26)];
        match source.byte() % 5 {
            0 => drop(self.call(|| fs.rename("a", path))),
            1 => drop(self.call(|| fs.rename_new("a/path", path))),
            2 => drop(self.call(|| fs.status(path))),
            3 => drop(self.call(|| fs.unlink(path))),
            _ => drop(self.call(|| fs.make_directory(path))),
        }
    }

    fn directory(&self, fs: &Fs, source: &mut Source<'_>) {
        let Some(mut directory) = self.call(|| fs.open_directory(".")) else {
            return;
        };
        let mut name = [0; 16];
        for _ in 0..source.byte() % 6 {
            if let Some(Some(entry)) = self.call(|| directory.next(&mut name)) {
                assert!(entry.name != b"." && entry.name != b"..");
            }
        }
        self.call(|| directory.close());
    }

    fn file<'f>(
        &self,
        mut file: OpenFile<'f>,
        how: u8,
        source: &mut Source<'_>,
        lent: &mut Option<Buffer<SimWindow>>,
    ) -> Option<OpenFile<'f>> {
        let mut bytes = [0x77; 40];
        let len = usize::from(source.byte()) % 33;
        match how % 10 {
            0 | 1 => {
                let read = self.call(|| file.read(&mut bytes[..len]));
                assert!(read.is_none_or(|read| read <= len));
                assert_eq!(bytes[len..], [0x77; 40][len..]);
            }
            2 => {
                // The number of bytes that the host claims to have written moves only the position.
                self.call(|| file.write(&bytes[..len]));
            }
            3 => {
                let to = match source.byte() % 3 {
                    0 => SeekFrom::Start(u64::from(source.word()) << 31),
                    1 => SeekFrom::Current(-i64::from(source.word())),
                    _ => SeekFrom::End(i64::from(source.word())),
                };
                let position = self.call(|| file.seek(to));
                assert!(position.is_none_or(|position| i64::try_from(position).is_ok()));
            }
            4 => drop(self.call(|| file.status())),
            5 => {
                let position = u64::from(source.word()) << 31;
                let read = self.call(|| file.read_at(&mut bytes[..len], position));
                assert!(read.is_none_or(|read| read <= len));
            }
            6 => drop(self.call(|| file.write_at(&bytes[..len], u64::MAX))),
            7 | 8 => {
                if let Some(buffer) = lent.take() {
                    let len = len as u32 * 2;
                    let outcome = if how & 1 == 0 {
                        file.read_buffer(buffer, len)
                    } else {
                        file.write_buffer(buffer, len)
                    };
                    *lent = match outcome {
                        Ok((_, buffer)) => Some(buffer),
                        Err(kept) => kept.buffer,
                    };
                }
            }
            _ => {
                self.call(|| file.close());
                return None;
            }
        }
        Some(file)
    }
}

fn options(how: u8) -> OpenOptions {
    let options = OpenOptions::new().read();
    match how % 3 {
        0 => options,
        1 => options.write().create(),
        _ => options.append(),
    }
}
