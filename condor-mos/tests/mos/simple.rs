//! What the simple servo promises, case by case.

use std::panic::{AssertUnwindSafe, catch_unwind};

use condor_mos::sim::{Processor, Vectored};
use condor_mos::{
    Armed, Clock, Instant, LoopError, LoopId, Overrun, Platform, Rate, RateError, SimpleServo,
    StartError, Timer, Wrapping,
};

const FREQUENCY: Rate = Rate::hz(1000);
const CLOCK: Clock = Clock::of::<u64>(FREQUENCY);

/// A timer that counts with 16 bits, on the simulator's.
struct Narrow(Processor);

impl Timer for Narrow {
    type Instant = Wrapping<16>;

    fn frequency(&self) -> Rate {
        self.0.frequency()
    }

    fn now(&self) -> Wrapping<16> {
        Wrapping::new(self.0.now() as u32)
    }

    fn arm(&self, at: Wrapping<16>) -> Armed {
        if self.now().has_reached(at) {
            return Armed::Past;
        }
        self.0.arm(self.0.now() + u64::from(at.since(self.now())))
    }

    fn disarm(&self) {
        self.0.disarm();
    }
}

impl Platform for Narrow {
    fn interruptible(&self, rank: u32, body: impl FnOnce()) {
        self.0.interruptible(rank, body);
    }
}

#[test]
fn a_counter_shorter_than_the_period_changes_nothing() {
    let processor = Processor::new(Rate::hz(1_000_000));
    let rate = Rate::fraction(3, 7); // 2 333 333 1/3 ticks
    let clock = Clock::of::<Wrapping<16>>(Rate::hz(1_000_000));
    let servo = SimpleServo::new(Narrow(processor.clone()), rate, clock);
    let mut starts = Vec::new();
    let mut body = |_| {
        starts.push(processor.now());
        processor.work(100);
    };
    servo
        .scope(Overrun::Fault, &mut body, || {
            processor.with_handler(
                || servo.on_timer(),
                || {
                    processor.run_until(123);
                    servo.start().unwrap();
                    processor.run_until(68_000_000);
                    // From the release that is due next, at 70 s.
                    servo.set_rate(Rate::hz(1)).unwrap();
                    processor.run_until(72_500_000);
                },
            );
        })
        .unwrap();
    let exact = (0..=30_u64).map(|release| 123 + (7_000_000 * release + 1) / 3);
    let others = [71_000_123, 72_000_123];
    assert_eq!(starts, exact.chain(others).collect::<Vec<_>>());
    assert_eq!(servo.statistics().worst_lateness, 0);
}

#[test]
fn a_servo_does_not_drift_in_a_million_releases() {
    let processor = Processor::new(Rate::hz(32_768));
    let rate = Rate::hz(60);
    let servo = SimpleServo::new(processor.clone(), rate, Clock::of::<u64>(Rate::hz(32_768)));
    let (mut runs, mut worst) = (0_u64, 0);
    let mut body = |_| {
        worst = worst.max((60 * processor.now()).abs_diff(32_768 * runs));
        runs += 1;
    };
    servo
        .scope(Overrun::Skip, &mut body, || {
            processor.with_handler(
                || servo.on_timer(),
                || {
                    servo.start().unwrap();
                    processor.run_until(32_768 * 1_000_000 / 60);
                },
            );
        })
        .unwrap();
    assert!(runs >= 1_000_000);
    assert!(worst <= 30, "half a tick in sixtieths: {worst}");
}

#[test]
fn a_static_servo_is_commanded_from_its_loop_and_the_background() {
    static PROCESSOR: std::sync::LazyLock<Processor> =
        std::sync::LazyLock::new(|| Processor::new(FREQUENCY));
    static SERVO: std::sync::LazyLock<SimpleServo<Processor>> =
        std::sync::LazyLock::new(|| SimpleServo::new(PROCESSOR.clone(), Rate::hz(100), CLOCK));
    fn body(runs: &mut u32, _: u64) {
        *runs += 1;
        match *runs {
            3 => SERVO.disable().unwrap(),
            4 => SERVO.stop(),
            _ => {}
        }
    }
    assert_eq!(SERVO.enable(), Err(LoopError::Unassigned { id: LoopId(0) }));
    SERVO
        .assign(Overrun::Skip, body, Box::leak(Box::new(0)))
        .unwrap();
    let again = SERVO.assign(Overrun::Skip, body, Box::leak(Box::new(0)));
    assert_eq!(again, Err(LoopError::Taken { id: LoopId(0) }));
    PROCESSOR.with_handler(
        || SERVO.on_timer(),
        || {
            SERVO.start().unwrap();
            PROCESSOR.run_until(100);
            assert_eq!(
                (SERVO.statistics().run, SERVO.statistics().enabled),
                (3, false)
            );
            SERVO.enable().unwrap();
            PROCESSOR.run_until(200);
            assert_eq!(SERVO.statistics().run, 4);
        },
    );
}

#[test]
fn what_cannot_be_is_refused() {
    let fast = Rate::hz(1001);
    let too_fast = RateError::TooFast {
        rate: fast,
        frequency: FREQUENCY,
    };
    let processor = Processor::new(FREQUENCY);
    let refused = SimpleServo::try_new(processor.clone(), fast, CLOCK);
    assert_eq!(refused.err(), Some(too_fast));
    let other = Clock::of::<u64>(Rate::hz(1));
    let servo = SimpleServo::new(processor, Rate::hz(1), other);
    assert_eq!(
        servo.start(),
        Err(StartError::Clock {
            timer: CLOCK,
            schedule: other
        })
    );
    assert!(servo.set_rate(fast).is_err());
    assert_eq!(servo.statistics().rate, Rate::hz(1));
}

#[test]
fn a_loop_that_unwinds_has_ended_and_is_disarmed() {
    let processor = Processor::new(FREQUENCY);
    let servo = SimpleServo::new(processor.clone(), Rate::hz(100), CLOCK);
    let mut body = |_| panic!("for the test");
    let unwound = catch_unwind(AssertUnwindSafe(|| {
        servo.scope(Overrun::Skip, &mut body, || {
            processor.with_handler(|| servo.on_timer(), || servo.start())
        })
    }));
    assert!(unwound.is_err());
    let counts = servo.statistics();
    assert_eq!((counts.run, counts.running, counts.enabled), (1, 0, false));
    // Free for another one, at whose next instant the loop runs.
    let mut runs = 0;
    let mut body = |_| runs += 1;
    servo
        .scope(Overrun::Skip, &mut body, || {
            processor.with_handler(|| servo.on_timer(), || processor.run_until(101));
        })
        .unwrap();
    assert_eq!(runs, 10);
}

#[test]
fn a_loop_that_runs_in_the_timers_own_vector_overruns_all_the_same() {
    let processor = Vectored::new(FREQUENCY);
    let servo = SimpleServo::new(processor.clone(), Rate::hz(100), CLOCK);
    let mut starts = Vec::new();
    let mut body = |_| {
        starts.push(processor.now());
        // During the second run the loop is due twice.
        processor.work(if starts.len() == 2 { 25 } else { 3 });
    };
    servo
        .scope(Overrun::CatchUp(1), &mut body, || {
            processor.with_handler(
                || servo.on_timer(),
                || {
                    servo.start().unwrap();
                    processor.run_until(45);
                },
            );
        })
        .unwrap();
    assert_eq!(starts, [0, 10, 35, 40]);
    let counts = servo.statistics();
    assert_eq!((counts.released, counts.run, counts.skipped), (5, 4, 1));
}
