//! Loom's proof that two processors with loads and stores alone are never both inside a bakery.
//!
//! Run with `RUSTFLAGS="--cfg condor_loom" cargo test --release --test spin_lock_loom`.

use condor_mbox::spin_lock::{
    Bakery, Incarnations, LockOwner, NativeSwap, SpinLockError, TestAndSet,
};
use condor_mbox::{Processor, SingleContext, SpinLock};
use loom::cell::UnsafeCell;
use loom::sync::Arc;
use loom::thread;

use crate::model::LoomWindow;

const PROCESSORS: u8 = 2;

/// The memory of a lock.
fn memory() -> LoomWindow {
    LoomWindow::seen(Bakery::bytes(PROCESSORS) as u32)
}

/// Explores every execution with at most this many preemptions. All four models take 3 seconds;
/// with six preemptions, or without a bound, the bakery's do not end in minutes.
const PREEMPTIONS: usize = 4;

fn check(model: impl Fn() + Send + Sync + 'static) {
    let mut loom = loom::model::Builder::new();
    loom.preemption_bound = Some(PREEMPTIONS);
    loom.check(model);
}

/// Everybody lives, but for one.
struct Except(Option<LockOwner>);

impl Incarnations for Except {
    fn is_current(&self, owner: LockOwner) -> bool {
        self.0 != Some(owner)
    }
}

fn owner(processor: u8) -> LockOwner {
    LockOwner::new(Processor(processor), 1).unwrap()
}

/// Two processors each try `visits` times; loom reports an access to the cell that another one
/// has not released.
fn two_visitors<L: TestAndSet + 'static>(visits: [u32; 2], form: fn(LoomWindow) -> L) {
    check(move || {
        let memory = memory();
        let inside = Arc::new(UnsafeCell::new(0));
        let visit = move |number: u8, memory: LoomWindow, inside: Arc<UnsafeCell<u32>>| {
            let lock = SpinLock::new(form(memory));
            let mut visited = 0;
            for _ in 0..visits[usize::from(number)] {
                if let Ok(_guard) = lock.try_lock(owner(number), &Except(None)) {
                    // SAFETY: only the owner of the lock is here, which is what loom checks.
                    inside.with_mut(|count| unsafe { *count += 1 });
                    visited += 1;
                }
            }
            visited
        };
        let other = {
            let (memory, inside) = (memory.clone(), inside.clone());
            thread::spawn(move || visit(1, memory, inside))
        };
        let mut visited = visit(0, memory.clone(), inside.clone());
        visited += other.join().unwrap();
        // SAFETY: the other thread has ended.
        assert_eq!(inside.with(|count| unsafe { *count }), visited);
        // Whatever happened, the lock is left free.
        let lock = SpinLock::new(form(memory));
        assert!(lock.try_lock(owner(0), &Except(None)).is_ok());
    });
}

#[test]
fn two_processors_are_never_both_inside_a_bakery() {
    two_visitors([1, 2], |memory| {
        Bakery::new(memory, 0, PROCESSORS, SingleContext::new()).unwrap()
    });
}

#[test]
fn two_processors_are_never_both_inside_a_swap() {
    two_visitors([2, 2], |memory| NativeSwap::new(memory, 0).unwrap());
}

/// Both find the owner dead and recover: one of them gets the lock, and only one.
fn two_recoverers<L: TestAndSet + 'static>(form: fn(LoomWindow) -> L) {
    check(move || {
        let memory = memory();
        let dead = LockOwner::new(Processor(0), 7).unwrap();
        std::mem::forget(
            SpinLock::new(form(memory.clone()))
                .try_lock(dead, &Except(None))
                .unwrap(),
        );
        let recover = move |number: u8, memory: LoomWindow| {
            let lives = Except(Some(dead));
            let lock = SpinLock::new(form(memory));
            let Err(SpinLockError::OwnerDead { owner: found }) =
                lock.try_lock(owner(number), &lives)
            else {
                return 0;
            };
            assert_eq!(found, dead);
            u32::from(lock.recover(dead, owner(number), &lives).is_ok())
        };
        let other = {
            let memory = memory.clone();
            thread::spawn(move || recover(1, memory))
        };
        let recovered = recover(0, memory) + other.join().unwrap();
        assert!(recovered <= 1);
    });
}

#[test]
fn one_of_two_recovers_a_bakery() {
    two_recoverers(|memory| Bakery::new(memory, 0, PROCESSORS, SingleContext::new()).unwrap());
}

#[test]
fn one_of_two_recovers_a_swap() {
    two_recoverers(|memory| NativeSwap::new(memory, 0).unwrap());
}
