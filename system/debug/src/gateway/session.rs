//! [`Session`]: a debugger's hold of processors.

use std::cell::Cell;
use std::io;
use std::sync::atomic::AtomicU32;
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

use condor_mbox::{MemoryWindow, Region};

use super::lock::DebuggerLock;
use crate::{Breakpoint, DebugRequest, ProgramState, Tracer, TracerError};

/// The time between two checks if a program has come to its beginning.
const NAP: Duration = Duration::from_micros(100);
/// The bytes of a word of memory.
const WORD_BYTES: usize = 4;
const WORD: u32 = WORD_BYTES as u32;
/// The time that a program may take to come to its first statement.
const START: Duration = Duration::from_secs(15);
/// The time that a former debugger, or the watcher that cleans up after it, may take to release a
/// processor.
const SUCCESSION: Duration = Duration::from_secs(3);

/// The way in which a debugged program ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProgramEnd {
    /// The program returned this status.
    Exited(u8),
    /// The program was taken off its processor, or has made a trap.
    Killed,
}

/// The state of a debugged processor: the program that runs on it, or the end of the last program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DebuggedProgram {
    /// A program runs. The number differs for each start of a program.
    Runs(u32),
    /// No program runs any more.
    Ended(ProgramEnd),
}

/// The part of the host that starts the programs of a processor and knows which messages they serve. GDB's commands
/// `monitor reset`, `monitor load` and `monitor vectors` use it.
pub trait ProgramHost: Send {
    /// Ends the program of the processor, and then starts one: the same program again, or that of a file
    /// with arguments. Returns before the program has come to its first statement, where it will be held.
    /// The receiver gets the text of an error that comes later.
    ///
    /// # Errors
    /// Returns an error text for the user if no program can be started.
    fn start(&self, file: Option<(&str, Vec<&str>)>) -> Result<Receiver<String>, String>;

    /// Returns a text that lists the messages that the program serves.
    ///
    /// # Errors
    /// Returns an error text for the user if the messages are not known.
    fn vectors(&self) -> Result<String, String>;
}

/// A processor whose program is debugged: all that a [`Session`] must know about the processor and
/// the program.
pub struct Debuggee<W> {
    /// The name of the processor.
    pub name: String,
    /// The means by which commands are sent to the processor's stub.
    pub tracer: Tracer<W>,
    /// The memory that the program can access.
    pub memory: Region<W>,
    /// The address of `memory`, as the program sees it.
    pub base: u64,
    /// The addresses at which breakpoints can be: those of the program.
    pub code: core::ops::Range<u64>,
    /// The number to add to an address in the program's file, to get the address at which the
    /// program has been loaded.
    pub bias: u64,
    /// The file of the processor's debugger lock.
    pub lock: std::path::PathBuf,
    /// Returns the program that the processor runs, or its end.
    pub program: Box<dyn Fn() -> DebuggedProgram + Send>,
    /// The owner of the processor's programs; `None` if programs are started elsewhere.
    pub host: Option<Box<dyn ProgramHost>>,
}

impl<W: MemoryWindow> Debuggee<W> {
    /// Reads `bytes` bytes of the memory that the program sees at `address`, also while the program runs. Aligned words
    /// of 32 bits are read in one piece each.
    ///
    /// Returns `None` if the program has no memory there.
    #[must_use]
    pub fn read(&self, address: u64, bytes: usize) -> Option<Vec<u8>> {
        let (_, before, mut read) = self.words(address, bytes)?;
        Some(read.split_off(before))
    }

    /// Writes `bytes` to the memory that the program sees at `address`, also while the program runs. Aligned words of
    /// 32 bits are written in one piece each, and exactly two of them together in one piece, if the window can do that.
    /// If only a part of a word is written, the other bytes of that word are written as they were read.
    ///
    /// Returns `None` if the program has no memory there.
    #[must_use]
    pub fn write(&self, address: u64, bytes: &[u8]) -> Option<()> {
        let (begin, before, mut words) = self.words(address, bytes.len())?;
        for (place, byte) in words.iter_mut().skip(before).zip(bytes) {
            *place = *byte;
        }
        if let ([first, second], []) = words.as_chunks::<WORD_BYTES>() {
            let pair = [first, second].map(|word| AtomicU32::new(u32::from_ne_bytes(*word)));
            return self.memory.write_words(begin, words.len(), &[&pair]).ok();
        }
        self.memory.write(begin, &words).ok()
    }

    /// The bytes of the memory at an address, from the beginning of a word on: the offset of that word,
    /// how many bytes are before the address, and the bytes.
    fn words(&self, address: u64, len: usize) -> Option<(u32, usize, Vec<u8>)> {
        let offset = u32::try_from(address.checked_sub(self.base)?).ok()?;
        let before = offset % WORD;
        let begin = offset - before;
        let len = len.checked_add(before as usize)?;
        self.memory.check(begin, len).ok()?;
        let mut bytes = vec![0; len];
        self.memory.read(begin, &mut bytes).ok()?;
        Some((begin, before as usize, bytes))
    }
}

impl<W> core::fmt::Debug for Debuggee<W> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Debuggee")
            .field("name", &self.name)
            .finish_non_exhaustive()
    }
}

/// The reason why a debugging session cannot begin, or why it has failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SessionError {
    /// The processor runs no program.
    #[error("{name} runs no program")]
    NoProgram {
        /// The name of the processor.
        name: String,
    },
    /// Another debugger has the processor.
    #[error("another debugger is attached to {name}: it holds the lock on {}", .lock.display())]
    Locked {
        /// The name of the processor.
        name: String,
        /// The file of the lock.
        lock: std::path::PathBuf,
    },
    /// The debugger lock cannot be taken.
    #[error("cannot lock {}: {error}", .lock.display())]
    Lock {
        /// The file of the lock.
        lock: std::path::PathBuf,
        /// The error of the operating system.
        error: io::Error,
    },
    /// The processor does not answer.
    #[error("{name}: {error}")]
    Tracer {
        /// The name of the processor.
        name: String,
        /// The reason.
        error: TracerError,
    },
    /// No program starts.
    #[error("{name}: {reason}")]
    Start {
        /// The name of the processor.
        name: String,
        /// The reason why no program starts, for the user.
        reason: String,
    },
    /// The connection failed, or is not GDB's.
    #[error("the connection of GDB failed: {0}")]
    Connection(String),
}

/// A debugging session on the programs of one or several processors. As long as it exists, breakpoints and fatal
/// exceptions stop these programs. When it is dropped, the programs run on without breakpoints.
#[derive(Debug)]
pub struct Session<W: MemoryWindow> {
    /// GDB's threads, from 1 on.
    pub(super) processors: Vec<AttachedProcessor<W>>,
}

/// A processor whose program the session debugs.
#[derive(Debug)]
pub(super) struct AttachedProcessor<W: MemoryWindow> {
    pub(super) debuggee: Debuggee<W>,
    /// The breakpoints that GDB wants. They are planted while the program runs.
    pub(super) wanted: Vec<Breakpoint>,
    /// The instruction that is stepped, and where that may end.
    pub(super) stepped: u64,
    pub(super) steps: Vec<u64>,
    /// Whether GDB takes the program for running.
    pub(super) runs: bool,
    /// Whether GDB itself has had it stopped.
    pub(super) is_asked_to_stop: bool,
    /// The number of the program that is meant, and not one that is started later by others.
    meant: Cell<Option<u32>>,
    /// Released after the tracer has let go.
    _lock: DebuggerLock,
}

impl<W: MemoryWindow> Session<W> {
    /// Attaches to the programs of `debuggees`, which go on running. GDB sees each of them as a
    /// thread.
    ///
    /// # Errors
    /// [`SessionError::NoProgram`] if a processor runs no program; [`SessionError::Locked`] if another debugger still
    /// has a processor after 3 s; [`SessionError::Lock`] if the file of a debugger lock cannot be made or locked;
    /// [`SessionError::Tracer`] if a processor does not answer, or its debug area cannot be accessed.
    pub fn attach(debuggees: Vec<Debuggee<W>>) -> Result<Self, SessionError> {
        let mut processors = Vec::new();
        for debuggee in debuggees {
            let attached = AttachedProcessor::locked(debuggee)?;
            if !attached.is_alive() {
                let name = attached.debuggee.name.clone();
                return Err(SessionError::NoProgram { name });
            }
            let tracer = attached.tracer();
            // Removes the breakpoints that a former debugger has left behind.
            attached.named(tracer.plant(&[], false))?;
            let mode = attached.named(tracer.mode())?;
            let is_attached = true;
            attached.named(tracer.set_mode(DebugRequest {
                attached: is_attached,
                ..mode
            }))?;
            processors.push(attached);
        }
        Ok(Self { processors })
    }

    /// Makes the [`ProgramHost`] of `debuggee` start the program of that processor again, and waits until the program
    /// is held before its first statement.
    ///
    /// # Errors
    /// [`SessionError::Locked`] if another debugger still has the processor after 3 s; [`SessionError::Lock`] if the
    /// file of the debugger lock cannot be made or locked; [`SessionError::Tracer`] if the debug area cannot be
    /// accessed; [`SessionError::Start`] if the program cannot be started, or does not come to its first statement
    /// within 15 s.
    pub fn start(debuggee: Debuggee<W>) -> Result<Self, SessionError> {
        let attached = AttachedProcessor::locked(debuggee)?;
        attached.start(None)?;
        Ok(Self {
            processors: vec![attached],
        })
    }
}

impl<W: MemoryWindow> AttachedProcessor<W> {
    fn locked(debuggee: Debuggee<W>) -> Result<Self, SessionError> {
        let (name, lock) = (&debuggee.name, &debuggee.lock);
        let lock = match DebuggerLock::take(lock, SUCCESSION) {
            Ok(Some(lock)) => lock,
            Ok(None) => {
                let (name, lock) = (name.clone(), lock.clone());
                return Err(SessionError::Locked { name, lock });
            }
            Err(error) => {
                let lock = lock.clone();
                return Err(SessionError::Lock { lock, error });
            }
        };
        Ok(Self {
            debuggee,
            wanted: Vec::new(),
            stepped: 0,
            steps: Vec::new(),
            runs: true,
            is_asked_to_stop: false,
            meant: Cell::new(None),
            _lock: lock,
        })
    }

    /// Has a program start, the same one or that of a file, and waits until it is held.
    pub(super) fn start(&self, file: Option<(&str, Vec<&str>)>) -> Result<(), SessionError> {
        let tracer = self.tracer();
        let former = (self.debuggee.program)();
        let holds = self.named(tracer.holds())?;
        let mode = self.named(tracer.mode())?;
        let with = |hold_start| DebugRequest {
            attached: true,
            hold_start,
            ..mode
        };
        self.named(tracer.set_mode(with(true)))?;
        let started = match &self.debuggee.host {
            Some(host) => host.start(file),
            None => Err("this gateway cannot start its programs".into()),
        };
        // The former one may come to a breakpoint meanwhile.
        let is_held = || {
            let now = (self.debuggee.program)();
            let is_new = matches!(now, DebuggedProgram::Runs(_)) && now != former;
            let is_held = matches!(tracer.state(), Ok(ProgramState::Held(_)));
            is_new && is_held && tracer.holds() != Ok(holds)
        };
        let begun = Instant::now();
        let started = started.and_then(|later| {
            while !is_held() {
                if let Ok(reason) = later.try_recv() {
                    return Err(reason);
                }
                if begun.elapsed() >= START {
                    return Err("the program did not reach its first statement".into());
                }
                std::thread::sleep(NAP);
            }
            Ok(())
        });
        self.named(tracer.set_mode(with(false)))?;
        self.meant.set(None);
        started.map_err(|reason| SessionError::Start {
            name: self.debuggee.name.clone(),
            reason,
        })
    }

    /// Returns the end of the debugged program; `None` while it runs.
    pub(super) fn ended(&self) -> Option<ProgramEnd> {
        match (self.debuggee.program)() {
            DebuggedProgram::Runs(number) => {
                let meant = self.meant.get().unwrap_or(number);
                self.meant.set(Some(meant));
                (meant != number).then_some(ProgramEnd::Killed)
            }
            DebuggedProgram::Ended(ended) => Some(ended),
        }
    }

    /// Whether the program has not ended.
    pub(super) fn is_alive(&self) -> bool {
        self.ended().is_none()
    }

    pub(super) const fn tracer(&self) -> &Tracer<W> {
        &self.debuggee.tracer
    }

    pub(super) fn named<T>(&self, result: Result<T, TracerError>) -> Result<T, SessionError> {
        result.map_err(|error| SessionError::Tracer {
            name: self.debuggee.name.clone(),
            error,
        })
    }
}

impl<W: MemoryWindow> Drop for AttachedProcessor<W> {
    fn drop(&mut self) {
        // If this fails, the watcher of the processor does it.
        let left = self.tracer().mode().map(DebugRequest::left);
        let _ = left.and_then(|mode| self.tracer().set_mode(mode));
        if self.is_alive() {
            let _ = self.tracer().release();
        }
    }
}
