//! Time that passes inside critical sections: no release starts before it is due.

use condor_mos::sim::{SimPlatform, Vectored, WrappingProcessor};
use condor_mos::{
    Armed, ClockSpec, LoopId, Loops, Overrun, Platform, Rate, Scan, Scheduler, Statistics, Timer,
    Wrapping,
};
use proptest::prelude::*;

const FREQUENCY: Rate = Rate::hz(1000);
const LOOPS: usize = 3;
/// Ticks of a run in the property.
const END: u64 = 20_000;
/// Runs of all loops together after which they take no time, so that those that catch up come to an
/// end.
const BUSY_RUNS: usize = 200;

/// A processor with vectors whose counter has 16 bits.
struct NarrowVectored(Vectored);

impl Timer for NarrowVectored {
    type Instant = Wrapping<16>;

    fn frequency(&self) -> Rate {
        self.0.frequency()
    }

    fn now(&self) -> Wrapping<16> {
        Timer::now(&WrappingProcessor::<16>((*self.0).clone()))
    }

    fn arm(&self, at: Wrapping<16>) -> Armed {
        WrappingProcessor::<16>((*self.0).clone()).arm(at)
    }

    fn disarm(&self) {
        self.0.disarm();
    }
}

impl Platform for NarrowVectored {
    const VECTORS: bool = true;

    fn pend(&self, ranks: u32) {
        self.0.pend(ranks);
    }

    fn interruptible(&self, rank: u32, body: impl FnOnce()) {
        self.0.interruptible(rank, body);
    }
}

/// What loops do, and how long the timer takes.
#[derive(Clone, Debug)]
struct Program {
    access_time: u32,
    rates: [Rate; LOOPS],
    overrun: Overrun,
    work: Vec<u64>,
}

/// The counts of all loops at the end, on a `platform` that is `processor`.
fn run<P: Platform + Sync>(
    platform: P,
    processor: &SimPlatform,
    program: &Program,
) -> [Statistics; LOOPS] {
    let clock = ClockSpec::of::<P::Instant>(FREQUENCY);
    let schedule = Scan::<LOOPS>::try_new(&program.rates, clock).expect("it is slow enough");
    let scheduler = Scheduler::new(platform, schedule);
    let runs = std::sync::atomic::AtomicUsize::new(0);
    let mut bodies: [_; LOOPS] = std::array::from_fn(|_| {
        |_| {
            let run = runs.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
            if run < BUSY_RUNS {
                processor.work(program.work[run % program.work.len()]);
            }
        }
    });
    processor.set_access_time(program.access_time);
    scheduler.scope(|scope| {
        for (number, body) in bodies.iter_mut().enumerate() {
            let id = LoopId(number as u8);
            scope.assign(id, program.overrun, body).expect("it is free");
        }
        processor.with_vectors(
            |rank| scheduler.on_vector(rank),
            || {
                processor.with_handler(
                    || scheduler.on_timer(),
                    || {
                        scheduler.start().expect("it has this clock");
                        processor.run_until(END);
                    },
                );
            },
        );
    });
    std::array::from_fn(|number| scheduler.statistics(LoopId(number as u8)).expect("a loop"))
}

/// On every kind of processor: at the same instants, whatever the counter's width.
fn check(program: &Program) {
    let new = || SimPlatform::new(FREQUENCY);
    let processor = new();
    let long = run(processor.clone(), &processor, program);
    let processor = new();
    let word = run(
        WrappingProcessor::<32>(processor.clone()),
        &processor,
        program,
    );
    let processor = new();
    let half = run(
        WrappingProcessor::<16>(processor.clone()),
        &processor,
        program,
    );
    assert_eq!((word, half), (long, long));
    let processor = Vectored(SimPlatform::new(FREQUENCY));
    let vectors = run(processor.clone(), &processor, program);
    let processor = Vectored(SimPlatform::new(FREQUENCY));
    let narrow = run(NarrowVectored(processor.clone()), &processor, program);
    assert_eq!(narrow, vectors);
    for counts in [long, vectors].as_flattened() {
        assert!(u64::from(counts.worst_lateness) < END, "{counts}");
        assert!(u64::from(counts.worst_run) < END, "{counts}");
    }
}

fn overrun() -> impl Strategy<Value = Overrun> {
    prop_oneof![
        Just(Overrun::Skip),
        (1..3_u8).prop_map(Overrun::CatchUp),
        Just(Overrun::Fault),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn counts_do_not_depend_on_the_width_of_the_counter(
        access_time in 0..4_u32,
        // Nearly the same periods: again and again instants are a tick apart.
        periods in prop::array::uniform3(90..100_u32),
        overrun in overrun(),
        work in prop::collection::vec(0..60_u64, 1..5),
    ) {
        let rates = periods.map(|ticks| Rate::fraction(1000, ticks));
        check(&Program { access_time, rates, overrun, work });
    }
}

#[test]
fn a_faster_loop_that_is_due_a_tick_after_a_slower_one_is_not_late() {
    // At tick 7 the slower loop is due. A tick later, while that is being released, the faster one.
    let rates = [Rate::hz(250), Rate::fraction(1000, 7)];
    let processor = SimPlatform::new(FREQUENCY);
    let clock = ClockSpec::of::<Wrapping<32>>(FREQUENCY);
    let schedule = Scan::<2>::try_new(&rates, clock).expect("it is slow enough");
    let scheduler = Scheduler::new(WrappingProcessor::<32>(processor.clone()), schedule);
    let mut starts = Vec::new();
    let (mut fast, mut slow) = (|_| starts.push(processor.now()), |_| {});
    scheduler.scope(|scope| {
        scope.assign(LoopId(0), Overrun::Skip, &mut fast).unwrap();
        scope.assign(LoopId(1), Overrun::Skip, &mut slow).unwrap();
        processor.with_handler(
            || scheduler.on_timer(),
            || {
                scheduler.start().unwrap();
                processor.run_until(7);
                processor.set_access_time(1);
                processor.run_until(8);
            },
        );
    });
    let fast = scheduler.statistics(LoopId(0)).unwrap();
    // Due at 8. Read at 7 and 8; armed for 12 at 9; begun at 10.
    assert_eq!((fast.run, fast.worst_lateness), (3, 2), "{fast}");
    assert_eq!(starts, [0, 4, 11]);
    let slow = scheduler.statistics(LoopId(1)).unwrap();
    assert!(slow.worst_lateness < 10, "{slow}");
}

#[test]
fn an_interrupt_a_tick_before_the_instant_begins_a_loop_in_time() {
    let processor = SimPlatform::new(FREQUENCY);
    let clock = ClockSpec::of::<Wrapping<32>>(FREQUENCY);
    let platform = WrappingProcessor::<32>(processor.clone());
    let scheduler = Scheduler::new(platform, Scan::<1>::new(&[Rate::hz(100)], clock));
    let mut body = |_| {};
    let counts = scheduler.scope(|scope| {
        scope.assign(LoopId(0), Overrun::Skip, &mut body).unwrap();
        let background = || {
            scheduler.start().unwrap();
            processor.run_until(9);
            processor.set_access_time(1);
            // Reads 9; arms 10, at 10; 20, at 11.
            processor.interrupt();
            scheduler.statistics(LoopId(0)).unwrap()
        };
        processor.with_handler(|| scheduler.on_timer(), background)
    });
    assert_eq!((counts.run, counts.worst_lateness), (2, 2), "{counts}");
}
