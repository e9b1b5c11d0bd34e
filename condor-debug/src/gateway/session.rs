//! [`Session`]: a debugger's hold of a processor, and the connection of a GDB to it.

use std::io;
use std::time::{Duration, Instant};

use condor_mbox::{MemoryWindow, Region};
use gdbstub::common::Signal;
use gdbstub::conn::ConnectionExt;
use gdbstub::stub::run_blocking::{BlockingEventLoop, Event, WaitForStopReasonError};
use gdbstub::stub::{DisconnectReason, GdbStub, GdbStubError, SingleThreadStopReason};

use super::connection::Stream;
use super::lock::DebuggerLock;
use super::riscv::frame;
use crate::{Mode, Reason, State, Tracer, TracerError};

/// The greatest size of a packet.
const PACKET_BYTES: usize = 1 << 15;
/// How often the program is looked at before the wait between looks becomes longer.
const LOOKS: u32 = 2000;
const NAP: Duration = Duration::from_micros(100);
/// After so many looks, some tenths of a second, nobody steps.
const FREQUENT: u32 = 5000;
const LONG_NAP: Duration = Duration::from_millis(2);
/// The bytes of a word of memory.
const WORD: u32 = 4;
/// How long a former debugger, or whoever cleans up after it, may take to let go.
const SUCCESSION: Duration = Duration::from_secs(3);

/// The end of a program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// It returned this status.
    Exited(u8),
    /// It was taken off its processor, or has made a trap.
    Killed,
}

/// The processor and the program that are debugged.
pub struct Debuggee<W> {
    /// The name of the processor.
    pub name: String,
    /// Gives commands to its slave.
    pub tracer: Tracer<W>,
    /// The memory that its program can access.
    pub memory: Region<W>,
    /// The address of that memory, as the program sees it.
    pub base: u64,
    /// The addresses at which breakpoints can be: those of the program.
    pub code: core::ops::Range<u64>,
    /// What is added to an address of the program's file.
    pub bias: u64,
    /// The file of its debugger lock.
    pub lock: std::path::PathBuf,
    /// Says how the program has ended; `None` while it runs. The first program that it finds is meant,
    /// and not one that is started later.
    pub ended: Box<dyn Fn() -> Option<Ended> + Send>,
}

impl<W: MemoryWindow> Debuggee<W> {
    /// Reads the memory that the program sees at `address`, also while the program runs. Words of 32 bits
    /// that are aligned are read in one piece.
    ///
    /// Returns `None` if the program has no memory there.
    #[must_use]
    pub fn read(&self, address: u64, bytes: usize) -> Option<Vec<u8>> {
        let (_, before, mut read) = self.words(address, bytes)?;
        Some(read.split_off(before))
    }

    /// The bytes of the memory at an address, from the beginning of a word on: the offset of that word,
    /// how many bytes are before the address, and the bytes.
    pub(super) fn words(&self, address: u64, len: usize) -> Option<(u32, usize, Vec<u8>)> {
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

/// The reason for which a session failed.
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
    #[error("another debugger has {name}: it holds the lock on {}", .lock.display())]
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
    /// The connection failed, or is not GDB's.
    #[error("the connection of GDB: {0}")]
    Connection(String),
}

/// A debugger's hold of a processor: breakpoints and fatal exceptions stop its program as long as the
/// session lives. When it is dropped, the program runs without breakpoints.
#[derive(Debug)]
pub struct Session<W: MemoryWindow> {
    pub(super) debuggee: Debuggee<W>,
    /// The breakpoints that GDB wants. They are planted while the program runs.
    pub(super) wanted: Vec<u64>,
    /// Released after the tracer has let go.
    _lock: DebuggerLock,
}

impl<W: MemoryWindow> Session<W> {
    /// Attaches to a running program. The program goes on.
    ///
    /// # Errors
    /// [`SessionError::NoProgram`]; [`SessionError::Locked`] if another debugger has had the processor
    /// for 3 s; [`SessionError::Lock`]; [`SessionError::Tracer`].
    pub fn attach(debuggee: Debuggee<W>) -> Result<Self, SessionError> {
        if (debuggee.ended)().is_some() {
            let name = debuggee.name;
            return Err(SessionError::NoProgram { name });
        }
        let session = Self::locked(debuggee)?;
        let tracer = session.tracer();
        // What a former debugger has left behind.
        session.named(tracer.plant(&[], false))?;
        let mode = session.named(tracer.mode())?;
        let attached = true;
        session.named(tracer.set_mode(Mode { attached, ..mode }))?;
        Ok(session)
    }

    /// Attaches to the next program of a processor, which it holds before the first statement. To be
    /// called while the processor runs none; start the program then, and
    /// [wait](Self::wait_for_start).
    ///
    /// # Errors
    /// [`SessionError::Locked`], [`SessionError::Lock`], [`SessionError::Tracer`].
    pub fn attach_to_next(debuggee: Debuggee<W>) -> Result<Self, SessionError> {
        let session = Self::locked(debuggee)?;
        let mode = session.named(session.tracer().mode())?;
        let mode = Mode {
            attached: true,
            hold_start: true,
            ..mode
        };
        session.named(session.tracer().set_mode(mode))?;
        Ok(session)
    }

    /// Waits until the program is held that was started after
    /// [`attach_to_next`](Self::attach_to_next).
    ///
    /// # Errors
    /// [`SessionError::NoProgram`] if none is held at `limit`; [`SessionError::Tracer`].
    pub fn wait_for_start(&self, limit: Duration) -> Result<(), SessionError> {
        let begun = Instant::now();
        while self.named(self.tracer().state())? == State::Runs {
            if begun.elapsed() >= limit {
                let name = self.debuggee.name.clone();
                return Err(SessionError::NoProgram { name });
            }
            std::thread::sleep(NAP);
        }
        let mode = self.named(self.tracer().mode())?;
        let hold_start = false;
        self.named(self.tracer().set_mode(Mode { hold_start, ..mode }))
    }

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
            _lock: lock,
        })
    }

    /// Returns the tracer of the processor.
    pub const fn tracer(&self) -> &Tracer<W> {
        &self.debuggee.tracer
    }

    /// Stops the program, and serves a GDB until it goes away. Returns whether GDB wants the program to be
    /// killed; otherwise the program goes on.
    ///
    /// # Errors
    /// [`SessionError::NoProgram`] if the program has ended; [`SessionError::Tracer`] if the processor does
    /// not answer; [`SessionError::Connection`] if the connection is lost or is not GDB's. The program goes
    /// on then, too.
    pub fn serve(&mut self, mut stream: Stream, limit: Duration) -> Result<bool, SessionError> {
        match stream.begins(limit) {
            Ok(true) => {}
            Ok(false) => {
                return Err(SessionError::Connection(
                    "it does not begin like GDB's".into(),
                ));
            }
            Err(error) => return Err(SessionError::Connection(error.to_string())),
        }
        if (self.debuggee.ended)().is_some() {
            let name = self.debuggee.name.clone();
            return Err(SessionError::NoProgram { name });
        }
        self.named(self.tracer().stop())?;
        let served = self.converse(stream);
        self.wanted.clear();
        if (self.debuggee.ended)().is_none() {
            self.named(self.tracer().plant(&[], true))?;
        }
        served
    }

    fn converse(&mut self, stream: Stream) -> Result<bool, SessionError> {
        let stub = GdbStub::builder(stream).packet_buffer_size(PACKET_BYTES);
        let stub = stub
            .build()
            .map_err(|error| SessionError::Connection(error.to_string()))?;
        match stub.run_blocking::<Loop<W>>(self) {
            Ok(reason) => Ok(reason == DisconnectReason::Kill),
            Err(error) => Err(self.failed(error)),
        }
    }

    fn failed(&self, error: GdbStubError<TracerError, io::Error>) -> SessionError {
        if error.is_target_error() {
            let name = self.debuggee.name.clone();
            return match error.into_target_error() {
                Some(error) => SessionError::Tracer { name, error },
                None => SessionError::NoProgram { name },
            };
        }
        SessionError::Connection(error.to_string())
    }

    fn named<T>(&self, result: Result<T, TracerError>) -> Result<T, SessionError> {
        result.map_err(|error| SessionError::Tracer {
            name: self.debuggee.name.clone(),
            error,
        })
    }

    /// The reason for which the program stands, as GDB is told; `None` if it runs.
    fn stop_reason(&self) -> Result<Option<SingleThreadStopReason<u64>>, TracerError> {
        if let State::Held(reason) = self.tracer().state()? {
            return self.told(reason).map(Some);
        }
        Ok((self.debuggee.ended)().map(|ended| match ended {
            Ended::Exited(status) => SingleThreadStopReason::Exited(status),
            Ended::Killed => SingleThreadStopReason::Terminated(Signal::SIGKILL),
        }))
    }

    fn told(&self, reason: Reason) -> Result<SingleThreadStopReason<u64>, TracerError> {
        Ok(match reason {
            Reason::Stopped => SingleThreadStopReason::Signal(Signal::SIGINT),
            Reason::Breakpoint => SingleThreadStopReason::SwBreak(()),
            Reason::Exception => SingleThreadStopReason::Signal(self.signal()?),
        })
    }

    /// The signal by which Linux tells of an exception.
    fn signal(&self) -> Result<Signal, TracerError> {
        Ok(match self.tracer().register(frame::CAUSE)? {
            0 | 4 | 6 => Signal::SIGBUS,
            2 => Signal::SIGILL,
            3 => Signal::SIGTRAP,
            8..=11 => Signal::SIGSYS,
            _ => Signal::SIGSEGV,
        })
    }
}

impl<W: MemoryWindow> Drop for Session<W> {
    fn drop(&mut self) {
        // Whoever watches the processor does it if this fails.
        let left = self.tracer().mode().map(Mode::left);
        let _ = left.and_then(|mode| self.tracer().set_mode(mode));
        if (self.debuggee.ended)().is_none() {
            let _ = self.tracer().release();
        }
    }
}

/// Waits for GDB and for the program.
struct Loop<W>(core::marker::PhantomData<W>);

type Failure = WaitForStopReasonError<TracerError, io::Error>;

impl<W: MemoryWindow> BlockingEventLoop for Loop<W> {
    type Target = Session<W>;
    type Connection = Stream;
    type StopReason = SingleThreadStopReason<u64>;

    fn wait_for_stop_reason(
        session: &mut Session<W>,
        stream: &mut Stream,
    ) -> Result<Event<Self::StopReason>, Failure> {
        let mut looks = 0;
        loop {
            let stopped = session.stop_reason();
            if let Some(reason) = stopped.map_err(WaitForStopReasonError::Target)? {
                return Ok(Event::TargetStopped(reason));
            }
            looks = FREQUENT.min(looks + 1);
            if looks < LOOKS && looks % 100 != 0 {
                core::hint::spin_loop();
                continue;
            }
            let nap = match looks {
                0..LOOKS => Duration::ZERO,
                LOOKS..FREQUENT => NAP,
                _ => LONG_NAP,
            };
            let heard = stream.is_readable(nap).and_then(|is_readable| {
                Ok(if is_readable {
                    Some(stream.read()?)
                } else {
                    None
                })
            });
            if let Some(byte) = heard.map_err(WaitForStopReasonError::Connection)? {
                return Ok(Event::IncomingData(byte));
            }
        }
    }

    fn on_interrupt(session: &mut Session<W>) -> Result<Option<Self::StopReason>, TracerError> {
        match session.tracer().stop() {
            Ok(reason) => session.told(reason).map(Some),
            // It has ended meanwhile.
            Err(error) => match (session.debuggee.ended)() {
                Some(_) => session.stop_reason(),
                None => Err(error),
            },
        }
    }
}
