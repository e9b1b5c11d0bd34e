//! One owner at a time, whoever stops and dies wherever, for every form of the lock.

use std::cell::Cell;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use condor_mbox::spin_lock::{
    Bakery, HardwareSemaphore, Incarnations, LockOwner, NativeSwap, SemaphoreSwap, SpinLockError,
    TestAndSet,
};
use condor_mbox::window::WindowErrorKind;
use condor_mbox::{Clock, Exclusion, Instant, MemoryWindow, Processor, Region, SpinLock};

use crate::memory::{Memory, Mortal};

const PROCESSORS: u8 = 4;
/// Two words that are equal whenever nobody is inside the lock.
const LEFT: u32 = 0;
const RIGHT: u32 = 4;
const LOCK: u32 = 8;

/// Where the entry of processor `number` in a bakery begins.
const fn entry(number: u32) -> u32 {
    LOCK + 64 * (1 + number)
}

const WORDS: usize = 2 + Bakery::bytes(PROCESSORS) / 4;

/// What all forms of the lock share besides the memory.
#[derive(Default)]
struct Board {
    semaphore: AtomicBool,
    contexts: [Mutex<()>; PROCESSORS as usize],
}

impl HardwareSemaphore for Board {
    fn try_take(&self) -> bool {
        !self.semaphore.swap(true, Ordering::AcqRel)
    }

    fn give(&self) {
        self.semaphore.store(false, Ordering::Release);
    }
}

/// The contexts of one processor, which are threads here.
struct Alone<'a>(&'a Mutex<()>);

impl Exclusion for Alone<'_> {
    fn with<R>(&self, body: impl FnOnce() -> R) -> R {
        let _alone = self.0.lock().unwrap();
        body()
    }
}

type Lock<'a> = SpinLock<Box<dyn TestAndSet + 'a>>;
type Form = for<'a> fn(&'a Mortal<'a>, &'a Board, LockOwner) -> Lock<'a>;

fn native<'a>(window: &'a Mortal<'a>, _: &'a Board, _: LockOwner) -> Lock<'a> {
    SpinLock::new(Box::new(NativeSwap::new(window, LOCK).unwrap()))
}

fn context(board: &Board, me: LockOwner) -> Alone<'_> {
    Alone(&board.contexts[me.processor().unwrap().index()])
}

fn semaphore<'a>(window: &'a Mortal<'a>, board: &'a Board, me: LockOwner) -> Lock<'a> {
    let lock = SemaphoreSwap::new(window, LOCK, board, context(board, me)).unwrap();
    SpinLock::new(Box::new(lock))
}

fn bakery<'a>(window: &'a Mortal<'a>, board: &'a Board, me: LockOwner) -> Lock<'a> {
    let lock = Bakery::new(window, LOCK, PROCESSORS, context(board, me)).unwrap();
    SpinLock::new(Box::new(lock))
}

const FORMS: [Form; 3] = [native, semaphore, bakery];

fn owner(processor: u8, incarnation: u32) -> LockOwner {
    LockOwner::new(Processor(processor), incarnation).unwrap()
}

/// Everybody lives but these.
struct Except<'a>(&'a [LockOwner]);

impl Incarnations for Except<'_> {
    fn is_current(&self, owner: LockOwner) -> bool {
        !self.0.contains(&owner)
    }
}

const EVERYBODY: Except<'_> = Except(&[]);

/// A clock that moves at every look.
#[derive(Default)]
struct Looks(AtomicU64);

impl Clock for Looks {
    fn now(&self) -> Instant {
        Instant::from_ns(self.0.fetch_add(1000, Ordering::Relaxed))
    }
}

/// Adds one to both words, one after the other.
fn change(window: &impl MemoryWindow) -> Result<(), ()> {
    let region = Region::whole(window);
    for word in [LEFT, RIGHT] {
        let value = region.word(word).map_err(|_| ())?;
        region.set_word(word, value + 1).map_err(|_| ())?;
    }
    Ok(())
}

fn is_whole(memory: &Memory) -> bool {
    let region = Region::whole(memory);
    region.word(LEFT) == region.word(RIGHT)
}

fn repair(memory: &Memory) {
    let region = Region::whole(memory);
    region.set_word(RIGHT, region.word(LEFT).unwrap()).unwrap();
}

#[test]
fn a_held_lock_is_busy_for_everybody() {
    for form in FORMS {
        let (memory, board) = (Memory::new(WORDS), Board::default());
        let window = Mortal::new(&memory, u32::MAX);
        let (me, other) = (owner(0, 5), owner(3, 9));
        let mine = form(&window, &board, me);
        let others = form(&window, &board, other);
        for _ in 0..3 {
            let guard = mine.try_lock(me, &EVERYBODY).unwrap();
            let busy = SpinLockError::Busy { owner: Some(me) };
            assert_eq!(others.try_lock(other, &EVERYBODY).unwrap_err(), busy);
            // Another context of the owner's processor gets it no more than anybody else.
            assert_eq!(mine.try_lock(me, &EVERYBODY).unwrap_err(), busy);
            assert_eq!(
                others
                    .lock(
                        other,
                        &EVERYBODY,
                        &Looks::default(),
                        Duration::from_millis(1)
                    )
                    .unwrap_err(),
                SpinLockError::TimedOut { owner: Some(me) }
            );
            assert_eq!(others.recover(me, other, &EVERYBODY).unwrap_err(), busy);
            guard.release().unwrap();
            drop(others.try_lock(other, &EVERYBODY).unwrap());
        }
    }
}

#[test]
fn an_incarnation_that_is_over_gets_no_lock() {
    for form in FORMS {
        let (memory, board) = (Memory::new(WORDS), Board::default());
        let window = Mortal::new(&memory, u32::MAX);
        let me = owner(1, 1);
        let lock = form(&window, &board, me);
        assert_eq!(
            lock.try_lock(me, &Except(&[me])).unwrap_err(),
            SpinLockError::NotCurrent { owner: me }
        );
        let _guard = lock.try_lock(owner(1, 2), &Except(&[me])).unwrap();
    }
}

#[test]
fn lost_memory_is_an_error_and_no_panic() {
    for form in FORMS {
        let (memory, board) = (Memory::new(WORDS), Board::default());
        let me = owner(1, 1);
        let window = Mortal::new(&memory, 0);
        assert_eq!(
            form(&window, &board, me)
                .try_lock(me, &EVERYBODY)
                .unwrap_err(),
            SpinLockError::Memory {
                kind: WindowErrorKind::Lost
            }
        );
    }
}

/// Takes the lock, changes the words and releases it; `true` if it came to the end.
fn visit(lock: &Lock<'_>, me: LockOwner, window: &Mortal<'_>, inside: &Cell<bool>) -> bool {
    let Ok(guard) = lock.try_lock(me, &EVERYBODY) else {
        return false;
    };
    inside.set(true);
    let changed = change(&window).is_ok();
    if changed {
        inside.set(false);
    }
    let released = guard.release().is_ok();
    changed && released
}

/// Runs `check` with the memory as an owner left it who died after every possible access.
fn after_every_death(form: Form, check: impl Fn(&Memory, &Board, LockOwner)) {
    let doomed = owner(1, 1);
    for accesses in 0.. {
        let (memory, board) = (Memory::new(WORDS), Board::default());
        let window = Mortal::new(&memory, accesses);
        let lock = form(&window, &board, doomed);
        let inside = Cell::new(false);
        let finished = visit(&lock, doomed, &window, &inside);
        // Whoever resets a processor frees its semaphores.
        board.give();
        if inside.get() {
            // Not known to be dead, it keeps the lock.
            let alive = Mortal::new(&memory, u32::MAX);
            let lock = form(&alive, &board, owner(0, 1));
            assert_eq!(
                lock.try_lock(owner(0, 1), &EVERYBODY).unwrap_err(),
                SpinLockError::Busy {
                    owner: Some(doomed)
                }
            );
        }
        check(&memory, &board, doomed);
        if finished && !window.is_dead() {
            return;
        }
    }
}

#[test]
fn whatever_an_owner_did_last_its_death_frees_the_lock_for_one() {
    for form in FORMS {
        after_every_death(form, |memory, board, doomed| {
            let window = Mortal::new(memory, u32::MAX);
            let (first, second) = (owner(0, 1), owner(2, 1));
            let one = form(&window, board, first);
            let two = form(&window, board, second);
            let dead = [doomed];
            let lives = Except(&dead);
            match one.try_lock(first, &lives) {
                Ok(guard) => {
                    assert!(is_whole(memory), "it was told nothing");
                    drop(guard);
                }
                Err(error) => {
                    assert_eq!(error, SpinLockError::OwnerDead { owner: doomed });
                    assert_eq!(two.try_lock(second, &lives).unwrap_err(), error);
                    let guard = one.recover(doomed, first, &lives).unwrap();
                    assert_eq!(
                        two.recover(doomed, second, &lives).unwrap_err(),
                        SpinLockError::Busy { owner: Some(first) }
                    );
                    repair(memory);
                    drop(guard);
                    assert_eq!(
                        two.recover(doomed, second, &lives).unwrap_err(),
                        SpinLockError::Busy { owner: None }
                    );
                }
            }
            drop(two.try_lock(second, &lives).unwrap());
            // The dead one in its next incarnation.
            let again = owner(1, 2);
            let lock = form(&window, board, again);
            assert!(visit(&lock, again, &window, &Cell::new(false)));
            assert!(is_whole(memory));
        });
    }
}

#[test]
fn whoever_dies_while_it_recovers_is_recovered_in_turn() {
    for form in FORMS {
        after_every_death(form, |memory, board, doomed| {
            let dead = [doomed];
            let image = |from: &Memory| {
                Memory::filled(WORDS, |at| {
                    Region::whole(from)
                        .word(u32::try_from(at * 4).unwrap())
                        .unwrap()
                })
            };
            for accesses in 0.. {
                let memory = image(memory);
                let window = Mortal::new(&memory, accesses);
                let second = owner(2, 1);
                let lock = form(&window, board, second);
                if let Ok(guard) = lock.recover(doomed, second, &Except(&dead)) {
                    let _ = guard.release();
                }
                board.give();
                let finished = !window.is_dead();

                let window = Mortal::new(&memory, u32::MAX);
                let third = owner(3, 1);
                let both = [doomed, second];
                let lives = Except(&both);
                let lock = form(&window, board, third);
                match lock.try_lock(third, &lives) {
                    Ok(guard) => drop(guard),
                    Err(SpinLockError::OwnerDead { owner }) => {
                        assert!(both.contains(&owner));
                        drop(lock.recover(owner, third, &lives).unwrap());
                    }
                    Err(other) => panic!("{other}"),
                }
                drop(lock.try_lock(third, &lives).unwrap());
                if finished {
                    return;
                }
            }
        });
    }
}

#[test]
fn garbage_for_an_owner_can_be_recovered_from() {
    for form in FORMS {
        for garbage in [1, 0x03FF_FFFF, u32::MAX, 0x8800_0000] {
            let (memory, board) = (Memory::new(WORDS), Board::default());
            Region::whole(&memory).set_word(LOCK, garbage).unwrap();
            let window = Mortal::new(&memory, u32::MAX);
            let me = owner(0, 1);
            let lock = form(&window, &board, me);
            let Err(SpinLockError::OwnerDead { owner }) = lock.try_lock(me, &EVERYBODY) else {
                panic!("{garbage:#x} is nobody");
            };
            assert_eq!(owner.processor(), None);
            drop(lock.recover(owner, me, &EVERYBODY).unwrap());
            drop(lock.try_lock(me, &EVERYBODY).unwrap());
        }
    }
}

#[test]
fn tickets_of_the_dead_and_of_garbage_do_not_count() {
    let (memory, board) = (Memory::new(WORDS), Board::default());
    let region = Region::whole(&memory);
    // Entries of processors 1 and 2, with the largest ticket and one that is being drawn.
    region.set_word(entry(1), u32::MAX).unwrap();
    region.set_word(entry(1) + 4, u32::MAX).unwrap();
    region.set_word(entry(2), 0x0C00_0001).unwrap();
    region.set_word(entry(2) + 4, 0).unwrap();
    let window = Mortal::new(&memory, u32::MAX);
    let me = owner(0, 1);
    let lock = bakery(&window, &board, me);
    assert!(lock.try_lock(me, &Except(&[owner(2, 1)])).is_ok());
    // Processor 2 lives: it is in the middle of drawing, and comes first.
    assert_eq!(
        lock.try_lock(me, &EVERYBODY).unwrap_err(),
        SpinLockError::Busy {
            owner: Some(owner(2, 1))
        }
    );
    // With the largest ticket of all, nobody can be put behind it: the lock is busy.
    region.set_word(entry(2) + 4, u32::MAX).unwrap();
    assert!(matches!(
        lock.try_lock(me, &EVERYBODY),
        Err(SpinLockError::Busy { .. })
    ));
    assert!(lock.try_lock(me, &Except(&[owner(2, 1)])).is_ok());
}

#[test]
fn a_semaphore_that_stays_taken_is_busy() {
    let (memory, board) = (Memory::new(WORDS), Board::default());
    let window = Mortal::new(&memory, u32::MAX);
    let me = owner(0, 1);
    let lock = semaphore(&window, &board, me);
    assert!(board.try_take());
    assert_eq!(
        lock.try_lock(me, &EVERYBODY).unwrap_err(),
        SpinLockError::Busy { owner: None }
    );
    board.give();
    assert!(lock.try_lock(me, &EVERYBODY).is_ok());
}

#[test]
fn locks_outside_their_window_are_refused() {
    let memory = Memory::new(WORDS);
    let end = u32::try_from(WORDS * 4).unwrap();
    for offset in [2, end, u32::MAX - 3] {
        assert!(NativeSwap::new(&memory, offset).is_err());
        assert!(Bakery::new(&memory, offset, PROCESSORS, Alone(&Mutex::new(()))).is_err());
        let semaphore = Board::default();
        assert!(SemaphoreSwap::new(&memory, offset, &semaphore, Alone(&Mutex::new(()))).is_err());
    }
    assert!(Bakery::new(&memory, LOCK + 4, PROCESSORS, Alone(&Mutex::new(()))).is_err());
    // A processor that the bakery has no entry for.
    let board = Board::default();
    let window = Mortal::new(&memory, u32::MAX);
    let lock = bakery(&window, &board, owner(0, 1));
    assert_eq!(
        lock.try_lock(owner(PROCESSORS, 1), &EVERYBODY).unwrap_err(),
        SpinLockError::Memory {
            kind: WindowErrorKind::OutOfBounds
        }
    );
}

#[test]
fn an_owner_is_a_processor_in_a_incarnation() {
    for incarnation in [0, 1, 977, (1 << 26) - 1] {
        for number in [0, 1, 31] {
            let owner = owner(number, incarnation);
            assert_eq!(owner.processor(), Some(Processor(number)));
            assert!(owner.is_incarnation(incarnation));
            assert!(owner.is_incarnation(incarnation.wrapping_add(1 << 26)));
            assert!(!owner.is_incarnation(incarnation.wrapping_add(1)));
        }
    }
    assert!(LockOwner::new(Processor(32), 1).is_err());
    assert_eq!(owner(3, 7).to_string(), "processor 3 in incarnation 7");
}

/// Every thread changes the words as often as the others, on try and in a queue.
#[test]
fn threads_are_alone_inside() {
    const VISITS: u32 = 300;
    for form in FORMS {
        let (memory, board) = (Memory::new(WORDS), Board::default());
        std::thread::scope(|threads| {
            // Two of them are contexts of one processor.
            for number in [0, 1, 1, 2] {
                let (memory, board) = (&memory, &board);
                threads.spawn(move || {
                    let window = Mortal::new(memory, u32::MAX);
                    let me = owner(number, 1);
                    let lock = form(&window, board, me);
                    let mut visits = 0;
                    while visits < VISITS {
                        let guard = if visits % 2 == 0 {
                            lock.try_lock(me, &EVERYBODY)
                        } else {
                            lock.lock(me, &EVERYBODY, &Patient, Duration::from_secs(3600))
                        };
                        match guard {
                            Ok(_guard) => {
                                change(memory).unwrap();
                                visits += 1;
                            }
                            Err(SpinLockError::Busy { .. }) => std::thread::yield_now(),
                            Err(other) => panic!("{other}"),
                        }
                    }
                });
            }
        });
        assert_eq!(Region::whole(&memory).word(LEFT), Ok(4 * VISITS));
        assert_eq!(Region::whole(&memory).word(RIGHT), Ok(4 * VISITS));
    }
}

/// A clock that lets others run at every look, and stands still.
struct Patient;

impl Clock for Patient {
    fn now(&self) -> Instant {
        std::thread::yield_now();
        Instant::from_ns(0)
    }
}
