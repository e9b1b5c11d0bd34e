//! Regions, published values and locks in memory that another processor rewrites before every access.

use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::time::Duration;

use crate::published::PublishedReadError;
use crate::shared_log::SharedLogReader;
use crate::sim::SimWindow;
use crate::spin_lock::{Bakery, Incarnations, LockOwner, NativeSwap, SpinLockError, TestAndSet};
use crate::window::{AccessError, CompareExchange, WindowError, WindowErrorKind};
use crate::{
    Clock, Instant, LoadOrder, MemoryWindow, Offset, Processor, Published, Region, SharedLog,
    SingleContext, SpinLock, StoreOrder,
};

use super::Tally;
use super::script::Script;

const BYTES: u32 = 1024;
const PROCESSORS: u8 = 3;
/// The incarnation of every processor: the first is over, the second is current.
const INCARNATION: u32 = 2;
const TICK_NS: u64 = 100;
/// The number of accesses that no call may reach between two readings of the clock.
const MOST_ACCESSES_PER_TICK: u64 = 500;
const MOST_OPERATIONS: usize = 64;

type Value = [u32; 5];

struct Shared {
    memory: SimWindow,
    lost: Cell<bool>,
    noise: RefCell<Noise>,
    accesses: Cell<u64>,
    accesses_at_tick: Cell<u64>,
    ns: Cell<u64>,
}

/// Words that are written before accesses, over and over.
struct Noise {
    bytes: Vec<u8>,
    at: usize,
    moves: u64,
    stopped: bool,
}

impl Noise {
    fn play(&mut self, shared: &Shared) {
        if self.stopped || self.bytes.is_empty() {
            return;
        }
        let mut script = Script::new(&self.bytes[self.at..]);
        let choice = script.byte();
        let offset = u32::from(script.byte()) * 4 % BYTES;
        let old = shared
            .memory
            .load(offset, LoadOrder::Relaxed)
            .expect("inside");
        let owner = |number, incarnation| word_of(Processor(number), incarnation);
        let value = match choice % 16 {
            0 => Some(0),
            1 => Some(u32::MAX),
            2 | 3 => Some(old.wrapping_add(script.difference())),
            4 => Some(script.word()),
            5 => Some(old ^ 1),
            6 => Some(owner(script.byte() % 4, INCARNATION)),
            7 => Some(owner(script.byte() % 4, 1)),
            8 => Some(u32::MAX << 1),
            9 => {
                shared.lost.set(script.byte().is_multiple_of(8));
                None
            }
            _ => None,
        };
        if let Some(value) = value {
            let stored = shared.memory.store(offset, value, StoreOrder::Relaxed);
            stored.expect("inside");
            self.moves += 1;
        }
        self.at += script.position();
        if self.at >= self.bytes.len() {
            self.at = 0;
        }
    }
}

/// Returns the word by which a lock names an owner.
fn word_of(processor: Processor, incarnation: u32) -> u32 {
    (u32::from(processor.0) + 1) << 26 | incarnation
}

#[derive(Clone)]
struct Noisy(Rc<Shared>);

#[derive(Debug)]
struct Refused(WindowErrorKind);

impl WindowError for Refused {
    fn kind(&self) -> WindowErrorKind {
        self.0
    }
}

fn refused(error: AccessError) -> Refused {
    Refused(error.kind())
}

impl Noisy {
    fn reach(&self) -> Result<&SimWindow, Refused> {
        let shared = &self.0;
        shared.accesses.set(shared.accesses.get() + 1);
        assert!(
            shared.accesses.get() - shared.accesses_at_tick.get() < MOST_ACCESSES_PER_TICK,
            "a call does not end"
        );
        shared.noise.borrow_mut().play(shared);
        if shared.lost.get() {
            return Err(Refused(WindowErrorKind::Lost));
        }
        Ok(&shared.memory)
    }
}

impl MemoryWindow for Noisy {
    type Error = Refused;

    fn size(&self) -> u32 {
        BYTES
    }

    fn load(&self, offset: u32, order: LoadOrder) -> Result<u32, Refused> {
        self.reach()?.load(offset, order).map_err(refused)
    }

    fn store(&self, offset: u32, value: u32, order: StoreOrder) -> Result<(), Refused> {
        self.reach()?.store(offset, value, order).map_err(refused)
    }

    fn check(&self, offset: u32, len: usize) -> Result<(), Refused> {
        self.0.memory.check(offset, len).map_err(refused)
    }
}

impl CompareExchange for Noisy {
    fn compare_exchange(&self, offset: u32, current: u32, new: u32) -> Result<u32, Refused> {
        let memory = self.reach()?;
        memory
            .compare_exchange(offset, current, new)
            .map_err(refused)
    }
}

impl Clock for Noisy {
    fn now(&self) -> Instant {
        let shared = &self.0;
        shared.accesses_at_tick.set(shared.accesses.get());
        shared.ns.set(shared.ns.get() + TICK_NS);
        Instant::from_ns(shared.ns.get())
    }
}

struct Known;

impl Incarnations for Known {
    fn is_current(&self, owner: LockOwner) -> bool {
        owner.is_incarnation(INCARNATION)
    }
}

/// Tests regions, published values and locks in memory that a hostile processor changes before
/// every access. `bytes`, from the fuzzer, decide the operations and the changes. Returns counts of
/// what happened.
///
/// # Panics
/// Panics if an operation does what its documentation excludes.
pub fn run(bytes: &[u8]) -> Tally {
    let (calm, noise) = bytes.split_at(bytes.len() / 2);
    let window = Noisy(Rc::new(Shared {
        memory: SimWindow::new(BYTES),
        lost: Cell::new(false),
        noise: RefCell::new(Noise {
            bytes: noise.to_vec(),
            at: 0,
            moves: 0,
            stopped: false,
        }),
        accesses: Cell::new(0),
        accesses_at_tick: Cell::new(0),
        ns: Cell::new(0),
    }));
    let region = Region::users(window.clone()).expect("larger than the doorbell's line");
    let mut script = Script::new(calm);
    for _ in 0..MOST_OPERATIONS {
        if script.is_over() {
            break;
        }
        // Each operation begins with a reading of the clock, from which its accesses are counted.
        window.now();
        operate(&window, &region, &mut script);
    }
    window.0.noise.borrow_mut().stopped = true;
    window.0.lost.set(false);
    heals(&window, &region);
    let states = window.0.noise.borrow().moves;
    Tally {
        states,
        accesses: window.0.accesses.get(),
        ..Tally::default()
    }
}

/// Returns any offset, mostly a valid one.
fn offset(script: &mut Script<'_>) -> u32 {
    match script.byte() % 16 {
        0 => script.word(),
        1 => BYTES.wrapping_add(script.difference()),
        2 => u32::MAX.wrapping_add(script.difference()),
        3 => u32::from(script.byte()),
        _ => u32::from(script.byte() % 64) * 4,
    }
}

fn operate(window: &Noisy, region: &Region<Noisy>, script: &mut Script<'_>) {
    let place = offset(script);
    match script.byte() % 8 {
        0 => {
            let end = u64::from(place) + size_of::<Value>() as u64;
            let inside = place.is_multiple_of(4) && end <= u64::from(region.size());
            let found = region.get(Offset::<Value>::at(place));
            assert!(found.is_err() || inside);
            assert!(region.set(Offset::at(place), &[1_u32; 5]).is_err() || inside);
        }
        1 => {
            let part = region.part(place, offset(script));
            if let Ok(part) = part {
                assert!(place + part.size() <= region.size());
                // No word beyond the end of `part` can be read through it.
                assert!(part.word(part.size()).is_err());
            }
        }
        2 | 3 => {
            if let Ok(subscriber) = Published::<Value>::at(place).subscriber(region) {
                let attempts = script.byte();
                let found = subscriber.with_attempts(u32::from(attempts % 8)).read();
                if attempts.is_multiple_of(8) {
                    assert_eq!(
                        found.err(),
                        Some(PublishedReadError::Contended { attempts: 0 })
                    );
                }
            }
        }
        4 => {
            if let Ok(mut publisher) = Published::<Value>::at(place).publisher(region) {
                for value in 0..4 {
                    // A publication can fail and the next one can succeed: the memory comes and goes.
                    let _ = publisher.publish(&[value; 5]);
                }
            }
        }
        5 => {
            if let Ok(lock) = NativeSwap::new(region, place) {
                contend(window, &SpinLock::new(lock), script);
            }
        }
        6 => {
            let lock = NativeSwap::new(region, place);
            let len = 192 + 4 * u32::from(script.byte());
            if let (Ok(lock), Ok(memory)) = (lock, region.part(offset(script), len)) {
                append(window, SpinLock::new(lock), &memory, script);
            }
        }
        _ => {
            let lock = Bakery::new(region, place, PROCESSORS, SingleContext::new());
            if let Ok(lock) = lock {
                contend(window, &SpinLock::new(lock), script);
            }
        }
    }
}

fn owner(number: u8) -> LockOwner {
    LockOwner::new(Processor(number), INCARNATION).expect("a small number")
}

/// Appends to a log and reads it; both can fail, and end.
fn append<L: TestAndSet>(
    window: &Noisy,
    lock: SpinLock<L>,
    memory: &Region<Noisy>,
    script: &mut Script<'_>,
) {
    const TEXT: &str = "ä line that is longer than an entry of a log, which keeps the beginning of it that has room: \
                        not more than one hundred and twelve bytes";
    let log = SharedLog::new(memory.clone(), lock).expect("it has room");
    let mut reader = SharedLogReader::new(memory.clone()).expect("it has room");
    for _ in 0..4 {
        window.now();
        let me = owner(script.byte() % PROCESSORS);
        let text = TEXT.get(..usize::from(script.byte())).unwrap_or(TEXT);
        // Another processor may have made something else of the log.
        let _ = log.try_append(me, &Known, window, text);
        window.now();
        while let Ok(Some(entry)) = reader.next_entry() {
            window.now();
            // A hostile writer may append for ever, so the loop ends with the script.
            if entry.text().len() < 8 || script.is_over() {
                break;
            }
        }
    }
}

fn contend<L: TestAndSet>(window: &Noisy, lock: &SpinLock<L>, script: &mut Script<'_>) {
    let me = owner(script.byte() % (PROCESSORS + 1));
    let outcome = match script.byte() % 3 {
        0 => lock.try_lock(me, &Known),
        1 => {
            let timeout = Duration::from_nanos(u64::from(script.byte()) * 50);
            let begun = window.0.ns.get();
            let outcome = lock.lock(me, &Known, window, timeout);
            let passed = Duration::from_nanos(window.0.ns.get() - begun);
            assert!(passed <= timeout + Duration::from_nanos(3 * TICK_NS));
            outcome
        }
        _ => {
            let dead = LockOwner::new(Processor(script.byte() % PROCESSORS), 1).expect("small");
            lock.recover(dead, me, &Known)
        }
    };
    match outcome {
        Ok(guard) if script.byte() & 1 == 0 => drop(guard),
        // A lost memory is reported, or has come back.
        Ok(guard) => drop(guard.release()),
        // An owner that is reported dead is not alive.
        Err(SpinLockError::OwnerDead { owner }) => {
            assert!(owner.processor().is_none() || !Known.is_current(owner));
            drop(lock.recover(owner, me, &Known));
        }
        Err(_) => {}
    }
}

/// Checks that the next publications and a cleared lock work, whatever is in the memory now.
fn heals(window: &Noisy, region: &Region<Noisy>) {
    window.now();
    let cell = Published::<Value>::at(0);
    let mut publisher = cell.publisher(region).expect("inside");
    for value in 1..=3 {
        publisher.publish(&[value; 5]).expect("the memory is there");
    }
    let subscriber = cell.subscriber(region).expect("inside");
    assert_eq!(subscriber.read().expect("three publications").value, [3; 5]);
    window.now();
    let memory = region.part(256, 192).expect("inside");
    for word in (0..192).step_by(4) {
        memory.set_word(word, 0).expect("inside");
    }
    region.set_word(0, 0).expect("inside");
    let lock = SpinLock::new(NativeSwap::new(region, 0).expect("inside"));
    let log = SharedLog::new(memory.clone(), lock).expect("it has room");
    let mut reader = SharedLogReader::new(memory).expect("it has room");
    log.try_append(owner(0), &Known, window, "healed")
        .expect("a free lock");
    let entry = reader.next_entry().expect("a log");
    assert_eq!(entry.expect("an entry").text(), "healed");
    window.now();
    let at = 256;
    for word in (at..at + Bakery::bytes(PROCESSORS) as u32).step_by(4) {
        region.set_word(word, 0).expect("inside");
    }
    let swap = SpinLock::new(NativeSwap::new(region, at).expect("inside"));
    drop(swap.try_lock(owner(0), &Known).expect("a free lock"));
    let bakery = Bakery::new(region, at, PROCESSORS, SingleContext::new()).expect("inside");
    let bakery = SpinLock::new(bakery);
    let guard = bakery.try_lock(owner(1), &Known).expect("a free lock");
    assert!(bakery.try_lock(owner(2), &Known).is_err());
    drop(guard);
    drop(bakery.try_lock(owner(2), &Known).expect("a free lock"));
}
