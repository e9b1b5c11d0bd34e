//! A client that writes any request, any table of open files and any journal, and goes on writing
//! while the server works.
//!
//! Whatever the client writes, each request ends, and the server reads and writes nothing outside of the tree
//! and of the client's part of the window, and leaves nothing behind in its own directory.

use std::cell::RefCell;
use std::fs::File;
use std::os::unix::fs::{FileExt, symlink};
use std::path::Path;
use std::sync::{Arc, Mutex};

use crate::server::{FileServer, ServerOptions, Step, Steps};
use crate::wire::{self, Operation, RequestSlot, Span, block, open, slot, table};
use condor_mbox::linux::{LinuxWindow, WindowAccess};
use condor_mbox::{MemoryWindow, Region, Windows, layout::BELL_BYTES};

use super::Source;

/// The offset of the record in the journal, in bytes.
const RECORD: u64 = 8;
/// The size of the guards in the memory, in bytes: one page before the window, and one behind it.
const PAGE: u32 = 4096;
const WINDOW: u32 = 2 * PAGE;
const GUARD: [u8; PAGE as usize] = [0xa5; PAGE as usize];
const SECRET: &[u8] = b"SECRETS!SECRETS!";

const SLOT: u32 = 0;
const TABLE: u32 = 256;
const BLOCKS: u32 = 320;
const COUNT: u32 = 4;
const PATHS: u32 = 1024;
const PATH_BYTES: u32 = 64;
const BUFFER: u32 = 2048;
const END: u32 = WINDOW - BELL_BYTES;
/// The number of the client's processor.
const NUMBER: u32 = 1;

const NAMES: [&[u8]; 22] = [
    b"a",
    b"b",
    b"d",
    b"d/a",
    b"d/b",
    b"d/../a",
    b"./d/.",
    b"..",
    b"../outside/secret",
    b"d/../../outside/secret",
    b"out/secret",
    b"out/new",
    b"secret",
    b"up/outside/secret",
    b"loop/a",
    b"/etc/passwd",
    b".condor-fs/lock",
    b"d/../.condor-fs/journal",
    b"own/lock",
    b"proc/self/root/etc/passwd",
    b"a\0b",
    b"d/",
];

/// A server and its tree, for all runs of a thread.
struct World {
    home: tempfile::TempDir,
    server: FileServer<Meddler>,
    script: Script,
    windows: [Windows<LinuxWindow>; 2],
    memory: File,
    journal: File,
}

/// The offsets and words that the client writes while the server works, one at each step.
type Script = Arc<Mutex<Vec<(u32, u32)>>>;

struct Meddler {
    script: Script,
    window: LinuxWindow,
}

impl Steps for Meddler {
    fn reached(&self, _: Operation, _: Step) {
        if let Some((at, word)) = self.script.lock().unwrap().pop() {
            let region = Region::users(&self.window).unwrap();
            let _ = region.set_word(at, word);
        }
    }
}

thread_local! {
    static WORLD: RefCell<Option<World>> = const { RefCell::new(None) };
}

/// Tests a server with a hostile client: `bytes`, from the fuzzer, decide the requests and the
/// other words in the client's memory.
///
/// # Panics
/// Panics if anything outside of the tree or of the client's window is read or written.
pub fn run(bytes: &[u8]) {
    WORLD.with_borrow_mut(|world| {
        let world = world.get_or_insert_with(World::new);
        world.run(&mut Source::new(bytes));
    });
}

impl World {
    fn new() -> Self {
        // The runs make thousands of trees a second, so the directory is in memory if possible.
        let home = tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir());
        let home = home.unwrap();
        for name in ["tree", "outside"] {
            std::fs::create_dir(home.path().join(name)).unwrap();
        }
        std::fs::write(home.path().join("outside/secret"), SECRET).unwrap();
        let memory = tempfile::tempfile_in(home.path()).unwrap();
        memory.set_len(u64::from(WINDOW + 2 * PAGE)).unwrap();
        for at in [0, PAGE + WINDOW] {
            memory.write_all_at(&GUARD, u64::from(at)).unwrap();
        }
        let window =
            LinuxWindow::map(&memory, PAGE.into(), WINDOW, WindowAccess::ReadWrite).unwrap();
        let script = Script::default();
        let steps = Meddler {
            script: script.clone(),
            window: window.clone(),
        };
        let options = ServerOptions {
            max_file_bytes: Some(1 << 16),
            quota_bytes: Some(1 << 18),
            ..ServerOptions::default()
        };
        let server = FileServer::with_steps(home.path().join("tree"), options, steps).unwrap();
        let journal = home.path().join("tree/.condor-fs/journal");
        let journal = File::options()
            .read(true)
            .write(true)
            .open(journal)
            .unwrap();
        let windows = std::array::from_fn(|_| Windows {
            mail: window.clone(),
            data: window.clone(),
        });
        Self {
            home,
            server,
            script,
            windows,
            memory,
            journal,
        }
    }

    fn region(&self) -> Region<&LinuxWindow> {
        Region::users(&self.windows[NUMBER as usize].data).unwrap()
    }

    fn tree(&self) -> std::path::PathBuf {
        self.home.path().join("tree")
    }

    fn run(&self, source: &mut Source<'_>) {
        renew(&self.tree());
        self.clear();
        let session = self.session();
        // The high words of later sequence numbers are the same, or differ.
        let mut sequence = u64::from(source.byte()) << 32 | 1;
        let mut last_open = sequence;
        for _ in 0..23 {
            if source.is_empty() {
                break;
            }
            sequence = wire::following(sequence);
            let request = self.request(source, session, sequence, last_open);
            self.put(&request);
            for _ in 0..source.byte() % 3 {
                let (at, word) = anywhere(source);
                let _ = self.region().set_word(at, word);
            }
            let script = (0..source.byte() % 8).map(|_| anywhere(source)).collect();
            *self.script.lock().unwrap() = script;
            let (mut slot_at, mut table_at) = (SLOT, TABLE);
            match source.byte() {
                0..8 => slot_at = source.word(),
                8..16 => table_at = source.word(),
                _ => {}
            }
            self.serve(&request, slot_at, table_at);
            self.script.lock().unwrap().clear();
            if request.operation == Operation::Open as u32 && self.opened(&request) {
                last_open = sequence;
            }
        }
        self.check();
    }

    /// Clears the window, except for the guard at its beginning, and writes a table without open files.
    fn clear(&self) {
        let zeros = [0; WINDOW as usize];
        self.memory.write_all_at(&zeros, PAGE.into()).unwrap();
        let guard = [0x5a; BELL_BYTES as usize];
        self.memory.write_all_at(&guard, PAGE.into()).unwrap();
        for (at, word) in [
            (TABLE, table::MAGIC),
            (TABLE + 4, COUNT),
            (TABLE + 8, BLOCKS),
            (TABLE + 12, block::BYTES),
        ] {
            self.region().set_word(at, word).unwrap();
        }
    }

    /// Opens a new session, with which the server removes everything that was left half done.
    fn session(&self) -> u64 {
        let request = RequestSlot {
            sequence: 1,
            operation: Operation::Session as u32,
            ..RequestSlot::default()
        };
        self.put(&request);
        self.serve(&request, SLOT, TABLE);
        assert_eq!(self.word(SLOT + slot::STATE), wire::state::DONE);
        wire::whole(
            self.word(SLOT + slot::VALUE),
            self.word(SLOT + slot::VALUE + 4),
        )
    }

    fn word(&self, at: u32) -> u32 {
        self.region().word(at).unwrap()
    }

    fn put(&self, request: &RequestSlot) {
        self.region().set_word(SLOT + slot::STATE, 0).unwrap();
        for (word, n) in request.to_words().into_iter().zip(0..) {
            self.region().set_word(SLOT + 4 * n, word).unwrap();
        }
    }

    /// Serves the request that the journal records, as a new server does. A message is served in the same way.
    fn serve(&self, request: &RequestSlot, slot_at: u32, table_at: u32) {
        let [session, session_high] = wire::halves(request.session);
        let [sequence, sequence_high] = wire::halves(request.sequence);
        let mut journal = [0; 32];
        let words = [
            1,
            NUMBER,
            session,
            session_high,
            sequence,
            sequence_high,
            slot_at,
            table_at,
        ];
        for (bytes, word) in journal.chunks_mut(4).zip(words) {
            bytes.copy_from_slice(&word.to_le_bytes());
        }
        self.journal.write_all_at(&journal, RECORD).unwrap();
        self.server.recover(&self.windows).unwrap();
        self.journal
            .read_exact_at(&mut journal[..4], RECORD)
            .unwrap();
        assert_eq!(journal[..4], [0; 4], "it has come to its end");
    }

    fn request(
        &self,
        source: &mut Source<'_>,
        session: u64,
        sequence: u64,
        last_open: u64,
    ) -> RequestSlot {
        let mut path = |n: u32| {
            let name = source.one(&NAMES);
            let at = PATHS + n * PATH_BYTES;
            self.region().write(at, name).unwrap();
            let span = Span {
                offset: at,
                len: name.len() as u32,
            };
            if source.byte() < 16 {
                hostile_span(source)
            } else {
                span
            }
        };
        let (path, second_path) = (path(0), path(1));
        let flags = match source.byte() % 8 {
            0 => open::READ,
            1 => open::READ | open::DIRECTORY,
            2 => open::READ | open::CREATE | open::MODE,
            3 => open::WRITE | open::CREATE | open::EXCLUSIVE,
            4 => open::READ | open::WRITE | open::APPEND,
            5 => open::WRITE | open::TRUNCATE,
            6 => 0,
            _ => source.word(),
        };
        RequestSlot {
            session: if source.byte() < 8 { 7 } else { session },
            sequence,
            operation: 1 + source.below(u32::from(Operation::ALL.len() as u16) + 1),
            flags,
            handle: if source.byte() < 16 {
                source.word().into()
            } else {
                last_open
            },
            file: if source.byte() < 16 {
                source.word()
            } else {
                sequence as u32 % COUNT
            },
            path,
            second_path,
            position: match source.byte() % 4 {
                0 => u64::from(source.word()) << 32 | u64::from(source.word()),
                1 => u64::from(source.word()),
                _ => u64::from(source.byte()),
            },
            buffer: if source.byte() < 128 {
                hostile_span(source)
            } else {
                Span {
                    offset: BUFFER,
                    len: source.below(2048),
                }
            },
        }
    }

    /// Changes the table as an honest client does after it has opened a file; returns true if the request
    /// opened one.
    fn opened(&self, request: &RequestSlot) -> bool {
        let done = self.word(SLOT + slot::STATE) == wire::state::DONE
            && [0, 4].map(|at| self.word(SLOT + slot::STATE_SEQUENCE + at))
                == wire::halves(request.sequence)
            && self.word(SLOT + slot::ERRNO) == 0;
        if !done {
            return false;
        }
        let [session, session_high] = wire::halves(request.session);
        let [handle, handle_high] = wire::halves(request.sequence);
        for n in 0..COUNT {
            // Every block is written, since the next requests may name any of them.
            let at = BLOCKS + n * block::BYTES;
            for (offset, word) in [
                (0, block::MAGIC),
                (block::SESSION, session),
                (block::SESSION + 4, session_high),
                (block::HANDLE, handle),
                (block::HANDLE + 4, handle_high),
                (block::FLAGS, request.flags),
                (block::PATH, request.path.offset),
                (block::PATH + 4, request.path.len),
            ] {
                self.region().set_word(at + offset, word).unwrap();
            }
            for k in (0..32).step_by(4) {
                let word = self.word(SLOT + slot::EVIDENCE + k);
                let place = at + block::EVIDENCE + k;
                self.region().set_word(place, word).unwrap();
            }
        }
        true
    }

    fn check(&self) {
        let mut memory = [0; (WINDOW + 2 * PAGE) as usize];
        self.memory.read_exact_at(&mut memory, 0).unwrap();
        let (before, rest) = memory.split_at(PAGE as usize);
        let (window, behind) = rest.split_at(WINDOW as usize);
        assert!(before == GUARD && behind == GUARD, "outside of the window");
        let (bell, users) = window.split_at(BELL_BYTES as usize);
        assert_eq!(bell, [0x5a; BELL_BYTES as usize], "the mailbox's words");
        for secret in [SECRET, b"root:"] {
            let read = users.windows(secret.len()).any(|bytes| bytes == secret);
            assert!(!read, "{:?} was read", String::from_utf8_lossy(secret));
        }

        assert_eq!(names(&self.home.path().join("outside")), ["secret"]);
        let secret = std::fs::read(self.home.path().join("outside/secret")).unwrap();
        assert_eq!(secret, SECRET);
        assert_eq!(names(self.home.path()), ["outside", "tree"]);
        self.clear();
        self.session();
        assert_eq!(
            names(&self.tree().join(".condor-fs")),
            ["journal", "lock"],
            "nothing is left half done"
        );
    }
}

/// Returns the offset of a word that a client may change at any time, and its new value; the offset may be
/// outside of the window.
fn anywhere(source: &mut Source<'_>) -> (u32, u32) {
    let at = match source.byte() % 4 {
        0 => SLOT + source.below(slot::BYTES / 4) * 4,
        1 => TABLE + source.below(4) * 4,
        2 => BLOCKS + source.below(COUNT * block::BYTES / 4) * 4,
        _ => PATHS + source.below(2 * PATH_BYTES / 4) * 4,
    };
    let word = match source.byte() % 4 {
        0 => u32::from_le_bytes(*b"../."),
        1 => u32::from_le_bytes(*b"/out"),
        _ => source.word(),
    };
    (at, word)
}

fn hostile_span(source: &mut Source<'_>) -> Span {
    match source.byte() % 4 {
        0 => Span {
            offset: source.word(),
            len: source.word(),
        },
        1 => Span {
            offset: (END - source.below(64)) & !3,
            len: source.below(128),
        },
        2 => Span {
            offset: BUFFER + source.below(8),
            len: source.below(64),
        },
        _ => Span {
            offset: BUFFER,
            len: source.word(),
        },
    }
}

fn names(directory: &Path) -> Vec<String> {
    let mut names: Vec<_> = std::fs::read_dir(directory)
        .unwrap()
        // A client may use a name that is not text, as any program of Unix may.
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

/// Restores the tree to its state at the beginning of each run.
fn renew(tree: &Path) {
    for entry in std::fs::read_dir(tree).unwrap() {
        let entry = entry.unwrap();
        if entry.file_name() == ".condor-fs" {
            continue;
        }
        // The path has the file's own name, which need not be text.
        let path = entry.path();
        if path.is_dir() && !path.is_symlink() {
            std::fs::remove_dir_all(path).unwrap();
        } else {
            std::fs::remove_file(path).unwrap();
        }
    }
    std::fs::create_dir(tree.join("d")).unwrap();
    std::fs::write(tree.join("a"), [7; 100]).unwrap();
    std::fs::write(tree.join("d/a"), b"a").unwrap();
    for (name, target) in [
        ("out", "../outside"),
        ("secret", "../outside/secret"),
        ("up", ".."),
        ("loop", "d/../loop"),
        ("own", ".condor-fs"),
        ("proc", "/proc"),
    ] {
        symlink(target, tree.join(name)).unwrap();
    }
}
