//! The suites pass what is right, and name what is wrong.
#![cfg(feature = "conformance")]

use std::cell::Cell;
use std::sync::atomic::AtomicU32;
use std::sync::{Condvar, Mutex};
use std::time::Duration;

use condor_mbox::conformance;
use condor_mbox::window::{WindowErrorKind, WindowWords};
use condor_mbox::{Clock, Doorbell, Instant, LoadOrder, MemoryWindow, Processor, StoreOrder};

use crate::memory::{Memory, MemoryError};

const ME: Processor = Processor(2);

/// What a doorbell in virtual time does with its rings.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    /// Keeps a ring until it is waited for.
    Keeps,
    /// Compares the rings with what was seen.
    Compares,
    /// Wakes only who sleeps already: wrong.
    Forgets,
    /// Keeps nothing that came before the first of two `prepare`: wrong.
    Once,
    /// Takes a number that does not exist for its own, and then is deaf: wrong.
    Confused,
    /// Its time runs backwards: wrong.
    Backwards,
}

/// A doorbell whose time passes in sleep alone.
struct Virtual {
    kind: Kind,
    now_ns: Cell<u64>,
    rings: Cell<u32>,
    pending: Cell<bool>,
    prepared: Cell<u32>,
    deaf: Cell<bool>,
}

impl Virtual {
    fn new(kind: Kind) -> Self {
        Self {
            kind,
            now_ns: Cell::new(1 << 40),
            rings: Cell::new(0),
            pending: Cell::new(false),
            prepared: Cell::new(0),
            deaf: Cell::new(false),
        }
    }

    fn suite(kind: Kind) -> Result<(), conformance::DoorbellFailure> {
        let mine = Self::new(kind);
        conformance::doorbell(&mine, ME, || mine.ring(ME))
    }
}

impl Clock for Virtual {
    fn now(&self) -> Instant {
        if self.kind == Kind::Backwards {
            self.now_ns.set(self.now_ns.get() - 1);
        }
        Instant::from_ns(self.now_ns.get())
    }
}

impl Doorbell for Virtual {
    type Seen = u32;

    fn ring(&self, processor: Processor) {
        if processor == ME && !self.deaf.get() {
            self.rings.set(self.rings.get() + 1);
            self.pending.set(true);
        } else if self.kind == Kind::Confused {
            self.deaf.set(true);
        }
    }

    fn prepare(&self) -> u32 {
        self.prepared.set(self.prepared.get() + 1);
        self.rings.get()
    }

    fn wait(&self, seen: u32, until: Instant, _: Option<Processor>) {
        let rung = match self.kind {
            Kind::Keeps | Kind::Confused | Kind::Backwards => self.pending.take(),
            Kind::Compares => self.rings.get() != seen,
            Kind::Forgets => false,
            Kind::Once => self.prepared.get() == 1 && self.pending.take(),
        };
        self.prepared.set(0);
        if !rung {
            self.now_ns.set(self.now_ns.get().max(until.as_ns()));
        }
    }
}

#[test]
fn doorbells_with_memory_and_doorbells_that_compare_conform() {
    Virtual::suite(Kind::Keeps).unwrap();
    Virtual::suite(Kind::Compares).unwrap();
}

#[test]
fn what_a_wrong_doorbell_breaks_is_named() {
    for (kind, check) in [
        (Kind::Forgets, "a ring after `prepare` ends the wait"),
        (
            Kind::Once,
            "a ring after the second `prepare` ends the wait",
        ),
        (
            Kind::Confused,
            "a ring after rings to numbers that do not exist ends the wait",
        ),
        (Kind::Backwards, "the clock never runs backwards"),
    ] {
        assert_eq!(Virtual::suite(kind).unwrap_err().check, check);
    }
}

/// A doorbell between threads, in real time.
struct Bell {
    start: std::time::Instant,
    rings: Mutex<u32>,
    rung: Condvar,
}

impl Clock for Bell {
    fn now(&self) -> Instant {
        Instant::from_ns(0).after(self.start.elapsed())
    }
}

impl Doorbell for Bell {
    type Seen = u32;

    fn ring(&self, processor: Processor) {
        if processor == ME {
            *self.rings.lock().unwrap() += 1;
            self.rung.notify_all();
        }
    }

    fn prepare(&self) -> u32 {
        *self.rings.lock().unwrap()
    }

    fn wait(&self, seen: u32, until: Instant, _: Option<Processor>) {
        let left = Duration::from_nanos(until.ns_since(self.now()));
        let rings = self.rings.lock().unwrap();
        let _rung = self
            .rung
            .wait_timeout_while(rings, left, |rings| *rings == seen)
            .unwrap();
    }
}

#[test]
fn a_doorbell_in_real_time_conforms() {
    let bell = Bell {
        start: std::time::Instant::now(),
        rings: Mutex::new(0),
        rung: Condvar::new(),
    };
    conformance::doorbell(&bell, ME, || {
        std::thread::scope(|threads| {
            threads.spawn(|| bell.ring(ME));
        });
    })
    .unwrap();
}

/// What a window does wrong.
#[derive(Clone, Copy, PartialEq)]
enum Fault {
    BigEndian,
    ZeroesTheRest,
    LosesTheTopBit,
    CopiesBeforeItChecks,
    AcceptsMisaligned,
    WrapsAround,
    HasOtherWords,
    HasWordsInCaches,
    RefusesNothingReadOnly,
}

struct Faulty(Memory, Fault);

impl MemoryWindow for Faulty {
    type Error = MemoryError;

    fn size(&self) -> u32 {
        self.0.size()
    }

    fn load(&self, offset: u32, order: LoadOrder) -> Result<u32, MemoryError> {
        let offset = match self.1 {
            Fault::AcceptsMisaligned => offset & !3,
            Fault::WrapsAround if offset >= 0x8000_0000 => offset % self.size(),
            _ => offset,
        };
        self.0.load(offset, order)
    }

    fn store(&self, offset: u32, value: u32, order: StoreOrder) -> Result<(), MemoryError> {
        let value = match self.1 {
            Fault::LosesTheTopBit => value & !0x8000_0000,
            _ => value,
        };
        if self.1 == Fault::RefusesNothingReadOnly {
            self.0.store(offset, value, order)?;
            return Err(MemoryError(WindowErrorKind::ReadOnly));
        }
        self.0.store(offset, value, order)
    }

    fn words(&self) -> Option<WindowWords<'_>> {
        let words: &'static [AtomicU32] = match self.1 {
            Fault::HasOtherWords | Fault::HasWordsInCaches => {
                static OTHERS: [AtomicU32; 16] = [const { AtomicU32::new(5) }; 16];
                &OTHERS
            }
            _ => return None,
        };
        // SAFETY: no mailbox has this window, which is wrong on purpose.
        Some(unsafe { WindowWords::new(words) })
    }

    fn is_coherent(&self) -> bool {
        self.1 != Fault::HasWordsInCaches
    }

    fn check(&self, offset: u32, len: usize) -> Result<(), MemoryError> {
        self.0.check(offset, len)
    }

    fn read(&self, offset: u32, into: &mut [u8]) -> Result<(), MemoryError> {
        self.0.read(offset, into)?;
        if self.1 == Fault::BigEndian {
            into.chunks_mut(4).for_each(<[u8]>::reverse);
        }
        Ok(())
    }

    fn write(&self, offset: u32, from: &[u8]) -> Result<(), MemoryError> {
        match self.1 {
            Fault::ZeroesTheRest => {
                let mut whole = from.to_vec();
                whole.resize(from.len().next_multiple_of(4), 0);
                self.0.write(offset, &whole)
            }
            Fault::CopiesBeforeItChecks => {
                let room = self.size().saturating_sub(offset) as usize;
                self.0.write(offset, &from[..from.len().min(room)])?;
                self.0.write(offset, from)
            }
            Fault::RefusesNothingReadOnly => Err(MemoryError(WindowErrorKind::ReadOnly)),
            _ => self.0.write(offset, from),
        }
    }
}

#[test]
fn what_a_wrong_window_breaks_is_named() {
    for (fault, check) in [
        (Fault::BigEndian, "a word is read as little-endian bytes"),
        (Fault::ZeroesTheRest, "a write changes only its own bytes"),
        (Fault::LosesTheTopBit, "a word holds every bit pattern"),
        (
            Fault::CopiesBeforeItChecks,
            "a refused write copies nothing",
        ),
        (Fault::AcceptsMisaligned, "a misaligned load is refused"),
        (Fault::WrapsAround, "a load outside is refused"),
        (
            Fault::HasOtherWords,
            "`words` has the words that loads return",
        ),
        (Fault::HasWordsInCaches, "only coherent memory has `words`"),
    ] {
        let failure = conformance::window(&Faulty(Memory::new(64), fault)).unwrap_err();
        assert_eq!(failure.check, check, "{failure}");
    }
    let window = Faulty(Memory::new(64), Fault::RefusesNothingReadOnly);
    assert_eq!(
        conformance::read_only(&window).unwrap_err().check,
        "a refused store changes nothing"
    );
}

/// Memory that others may write, mapped for reading.
struct ReadOnly(Memory);

impl MemoryWindow for ReadOnly {
    type Error = MemoryError;

    fn size(&self) -> u32 {
        self.0.size()
    }

    fn load(&self, offset: u32, order: LoadOrder) -> Result<u32, MemoryError> {
        self.0.load(offset, order)
    }

    fn store(&self, offset: u32, _: u32, _: StoreOrder) -> Result<(), MemoryError> {
        self.check(offset, 4)?;
        Err(MemoryError(WindowErrorKind::ReadOnly))
    }

    fn check(&self, offset: u32, len: usize) -> Result<(), MemoryError> {
        self.0.check(offset, len)
    }
}

#[test]
fn a_window_for_reading_conforms_as_such() {
    conformance::read_only(&ReadOnly(Memory::filled(64, |at| at as u32))).unwrap();
    let failure = conformance::window(&ReadOnly(Memory::new(64))).unwrap_err();
    assert_eq!(failure.found, Err(WindowErrorKind::ReadOnly));
}
