//! The ceiling lock: who may take it, and what starts meanwhile.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};

use condor_mos::sim::SimPlatform;
use condor_mos::{
    ClockSpec, LoopId, LoopLock, LoopLockError, Loops, Overrun, Rate, Scan, Scheduler,
};

const FREQUENCY: Rate = Rate::hz(1000);
const IDS: [LoopId; 3] = [LoopId(0), LoopId(1), LoopId(2)];

type Three = Scheduler<SimPlatform, 3, 0>;

/// Runs `background` while the loops of 10, 5 and 2 Hz do `body`.
fn with_loops(
    body: impl Fn(&SimPlatform, &Three, usize) + Sync,
    background: impl Fn(&SimPlatform, &Three),
) {
    let processor = SimPlatform::new(FREQUENCY);
    let clock = ClockSpec::of::<u64>(FREQUENCY);
    let rates = [Rate::hz(10), Rate::hz(5), Rate::hz(2)];
    let scheduler = Scheduler::new(processor.clone(), Scan::new(&rates, clock));
    let mut bodies: [_; 3] = std::array::from_fn(|number| {
        let (processor, scheduler, body) = (&processor, &scheduler, &body);
        move |_| body(processor, scheduler, number)
    });
    scheduler.scope(|scope| {
        for (id, body) in IDS.into_iter().zip(&mut bodies) {
            scope.assign(id, Overrun::Skip, body).unwrap();
        }
        processor.with_handler(
            || scheduler.on_timer(),
            || {
                scheduler.start().unwrap();
                background(&processor, &scheduler);
            },
        );
    });
}

#[test]
fn a_faster_loop_is_undeclared() {
    let lock = LoopLock::new(&IDS[1..], 0);
    with_loops(
        |_, scheduler, number| {
            let locked = lock.lock(scheduler, |runs| *runs += 1);
            let expected = if number == 0 {
                Err(LoopLockError::Undeclared)
            } else {
                Ok(())
            };
            assert_eq!(locked, expected);
        },
        |processor, _| processor.run_until(1000),
    );
    let runs = { lock }.get_mut().to_owned();
    assert_eq!(runs, 5 + 2);
}

#[test]
fn a_lock_inside_itself_is_taken() {
    let lock = LoopLock::new(&IDS, ());
    with_loops(
        |_, _, _| {},
        |_, scheduler| {
            let inner = lock.lock(scheduler, |()| lock.lock(scheduler, |()| {}));
            assert_eq!(inner, Ok(Err(LoopLockError::Taken)));
            assert_eq!(lock.lock(scheduler, |()| {}), Ok(()));
        },
    );
}

#[test]
fn users_wait_and_faster_loops_do_not() {
    let lock = LoopLock::new(&IDS[1..], ());
    with_loops(
        |_, _, _| {},
        |processor, scheduler| {
            let runs = || IDS.map(|id| scheduler.statistics(id).unwrap().run);
            assert_eq!(runs(), [1, 1, 1]);
            // A lock inside with a lower ceiling does not let the users of the outer one go.
            let inner = LoopLock::new(&IDS[2..], ());
            let locked = lock.lock(scheduler, |()| {
                inner
                    .lock(scheduler, |()| processor.run_until(501))
                    .unwrap();
                assert_eq!(runs(), [6, 1, 1]);
            });
            assert_eq!((locked, runs()), (Ok(()), [6, 2, 2]));
        },
    );
}

#[test]
fn the_ceiling_follows_a_change_of_rates() {
    let lock = LoopLock::new(&IDS[2..], ());
    with_loops(
        |_, _, _| {},
        |processor, scheduler| {
            processor.run_until(50);
            // The only user becomes the fastest loop.
            scheduler.set_rate(IDS[2], Rate::hz(50)).unwrap();
            processor.run_until(501);
            assert!(!scheduler.is_changing());
            let runs = || IDS.map(|id| scheduler.statistics(id).unwrap().run);
            let before = runs();
            let locked = lock.lock(scheduler, |()| processor.run_until(801));
            assert_eq!(locked, Ok(()));
            let after = runs();
            // All waited: each has run once, when the lock was given back.
            let more = [0, 1, 2].map(|number| after[number] - before[number]);
            assert_eq!(more, [1, 1, 1]);
        },
    );
}

#[test]
fn a_user_that_unwinds_gives_it_back() {
    let lock = LoopLock::new(&IDS, ());
    with_loops(
        |_, _, _| {},
        |processor, scheduler| {
            let caught = catch_unwind(AssertUnwindSafe(|| {
                lock.lock(scheduler, |()| {
                    processor.run_until(501);
                    resume_unwind(Box::new("a user"));
                })
            }));
            assert!(caught.is_err());
            for id in IDS {
                let seen = scheduler.statistics(id).unwrap();
                assert_eq!((seen.pending, seen.run), (0, 2), "{id:?}");
            }
            assert_eq!(lock.lock(scheduler, |()| {}), Ok(()));
        },
    );
}
