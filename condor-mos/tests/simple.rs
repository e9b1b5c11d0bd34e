//! The simple servo against a reference that goes tick by tick.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use condor_mos::sim::Processor;
use condor_mos::{
    Armed, Clock, Instant, LoopError, LoopId, Overrun, Platform, Rate, RateError, SimpleServo,
    StartError, Statistics, Timer, Wrapping,
};
use proptest::prelude::*;

const FREQUENCY: Rate = Rate::hz(1000);
const CLOCK: Clock = Clock::of::<u64>(FREQUENCY);

/// What the background does.
#[derive(Clone, Copy, Debug)]
enum Command {
    Wait(u64),
    Hold(u64),
    SetRate(Rate),
    Enable,
    Disable,
    Start,
    Stop,
    Spurious,
}

/// Periods of 2 to 60 ticks, hardly ever whole ones.
fn rate() -> impl Strategy<Value = Rate> {
    (1..30_u32, 3..61_u32)
        .prop_map(|(parts, ticks)| Rate::fraction(1000 * parts, ticks * parts - 1))
}

fn command() -> impl Strategy<Value = Command> {
    prop_oneof![
        6 => (1..300_u64).prop_map(Command::Wait),
        2 => (1..100_u64).prop_map(Command::Hold),
        2 => rate().prop_map(Command::SetRate),
        1 => Just(Command::Enable),
        1 => Just(Command::Disable),
        3 => Just(Command::Start),
        1 => Just(Command::Stop),
        1 => Just(Command::Spurious),
    ]
}

fn overrun() -> impl Strategy<Value = Overrun> {
    prop_oneof![
        Just(Overrun::Skip),
        (0..4_u8).prop_map(Overrun::CatchUp),
        Just(Overrun::Fault),
    ]
}

/// How long a run takes. What overran for ever would never come back to the background.
fn duration(durations: &[u64], run: usize) -> u64 {
    if run < 100 {
        durations[run % durations.len()]
    } else {
        1
    }
}

/// The reference: what is due comes from exact fractions, and every tick is gone through.
struct Reference {
    now: u64,
    held_until: u64,
    started: bool,
    enabled: bool,
    faulted: bool,
    overrun: Overrun,
    rate: Rate,
    /// Where the grid of the rate begins, and how many of its instants have passed.
    origin: u64,
    passed: u64,
    /// The instants of the releases that wait.
    pending: Vec<u64>,
    /// When the run in progress began, and what remains of it.
    running: Option<(u64, u64)>,
    durations: Vec<u64>,
    starts: Vec<u64>,
    released: u32,
    skipped: u32,
    run: u32,
    worst_lateness: u64,
    worst_run: u64,
    total_run: u64,
}

impl Reference {
    fn due(&self) -> u64 {
        let ticks = u64::from(self.rate.denominator()) * u64::from(FREQUENCY.numerator());
        let parts = u64::from(self.rate.numerator());
        self.origin + (2 * self.passed * ticks + parts) / (2 * parts)
    }

    fn pass_events(&mut self) {
        while self.started && self.due() <= self.now {
            let due = self.due();
            self.passed += 1;
            if !self.enabled {
                continue;
            }
            self.released += 1;
            let unfinished = self.pending.len() + usize::from(self.running.is_some());
            let allowed = match self.overrun {
                Overrun::CatchUp(releases) => usize::from(releases),
                Overrun::Skip | Overrun::Fault => 0,
            };
            if unfinished <= allowed {
                self.pending.push(due);
                continue;
            }
            self.skipped += 1;
            if self.overrun == Overrun::Fault {
                (self.enabled, self.faulted) = (false, true);
            }
        }
    }

    fn begin(&mut self) {
        if self.running.is_none() && !self.pending.is_empty() {
            let lateness = self.now - self.pending.remove(0);
            self.worst_lateness = self.worst_lateness.max(lateness);
            let duration = duration(&self.durations, self.starts.len());
            self.starts.push(self.now);
            self.running = Some((self.now, duration));
        }
    }

    fn interrupt(&mut self) {
        self.pass_events();
        self.begin();
    }

    /// Goes on until `end`, and until the loop is not in progress.
    fn advance(&mut self, end: u64) {
        loop {
            if let Some((since, 0)) = self.running {
                let ticks = self.now - since;
                self.running = None;
                self.run += 1;
                self.worst_run = self.worst_run.max(ticks);
                self.total_run += ticks;
                self.begin();
            }
            if self.running.is_none() && self.now >= end {
                return;
            }
            if self.started && self.now >= self.held_until {
                self.interrupt();
            }
            if let Some((_, remaining)) = &mut self.running {
                *remaining -= 1;
            }
            self.now += 1;
        }
    }

    fn forget(&mut self) {
        self.skipped += self.pending.len() as u32;
        self.pending.clear();
    }

    fn obey(&mut self, command: Command) {
        match command {
            Command::Wait(ticks) => self.advance(self.now + ticks),
            Command::Hold(ticks) => self.held_until = self.now + ticks,
            Command::SetRate(rate) => {
                (self.origin, self.passed) = (self.due(), 0);
                self.rate = rate;
            }
            Command::Enable => (self.enabled, self.faulted) = (true, false),
            Command::Disable => {
                self.enabled = false;
                self.forget();
            }
            Command::Start if self.started => {}
            Command::Start => {
                (self.started, self.origin, self.passed) = (true, self.now, 0);
                self.interrupt();
                self.advance(self.now);
            }
            Command::Stop => {
                self.started = false;
                self.forget();
            }
            Command::Spurious => {
                self.interrupt();
                self.advance(self.now);
            }
        }
    }

    fn statistics(&self) -> Statistics {
        Statistics {
            rate: self.rate,
            frequency: FREQUENCY,
            enabled: self.enabled,
            faulted: self.faulted,
            released: self.released,
            run: self.run,
            skipped: self.skipped,
            running: u32::from(self.running.is_some()),
            pending: self.pending.len() as u32,
            worst_lateness: self.worst_lateness as u32,
            worst_run: self.worst_run as u32,
            total_run: self.total_run,
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn a_servo_does_what_the_reference_does(
        first in rate(),
        overrun in overrun(),
        durations in prop::collection::vec(1..90_u64, 1..6),
        commands in prop::collection::vec(command(), 1..25),
    ) {
        let mut reference = Reference {
            now: 0, held_until: 0, started: false, enabled: true, faulted: false, overrun,
            rate: first, origin: 0, passed: 0, pending: Vec::new(), running: None,
            durations: durations.clone(), starts: Vec::new(),
            released: 0, skipped: 0, run: 0, worst_lateness: 0, worst_run: 0, total_run: 0,
        };
        let processor = Processor::new(FREQUENCY);
        let servo = SimpleServo::try_new(processor.clone(), first, CLOCK).unwrap();
        let mut starts = Vec::new();
        let mut body = || {
            let duration = duration(&durations, starts.len());
            starts.push(processor.now());
            let seen = servo.statistics();
            assert_eq!((seen.running, seen.released), (1, seen.run + seen.skipped + 1 + seen.pending));
            processor.work(duration);
        };
        servo.scope(overrun, &mut body, || {
            processor.with_handler(|| servo.on_timer(), || {
                for &command in &commands {
                    match command {
                        Command::Wait(ticks) => processor.run_until(processor.now() + ticks),
                        Command::Hold(ticks) => processor.hold_interrupts(ticks),
                        Command::SetRate(rate) => servo.set_rate(rate).unwrap(),
                        Command::Enable => servo.enable().unwrap(),
                        Command::Disable => servo.disable().unwrap(),
                        Command::Start => {
                            let started = reference.started;
                            assert_eq!(servo.start(), if started { Err(StartError::Started) } else { Ok(()) });
                        }
                        Command::Stop => servo.stop(),
                        Command::Spurious => servo.on_timer(),
                    }
                    reference.obey(command);
                    assert_eq!(processor.now(), reference.now, "{command:?}");
                    let (mut counts, expected) = (servo.statistics(), reference.statistics());
                    if matches!(overrun, Overrun::CatchUp(2..)) {
                        // Of three and more that wait, the instants between are not kept.
                        counts.worst_lateness = expected.worst_lateness;
                    }
                    assert_eq!(counts, expected, "{command:?}");
                }
            });
        }).unwrap();
        prop_assert_eq!(starts, reference.starts);
    }
}

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
    fn dispatch(&self, _: u32, run: impl FnOnce()) {
        run();
    }

    fn interruptible(&self, body: impl FnOnce()) {
        self.0.interruptible(body);
    }
}

#[test]
fn a_counter_shorter_than_the_period_changes_nothing() {
    let processor = Processor::new(Rate::hz(1_000_000));
    let rate = Rate::fraction(3, 7); // 2 333 333 1/3 ticks
    let clock = Clock::of::<Wrapping<16>>(Rate::hz(1_000_000));
    let servo = SimpleServo::new(Narrow(processor.clone()), rate, clock);
    let mut starts = Vec::new();
    let mut body = || {
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
                    processor.run_until(70_000_000);
                },
            );
        })
        .unwrap();
    let exact = (0..30_u64).map(|release| 123 + (7_000_000 * release + 1) / 3);
    assert_eq!(starts, exact.collect::<Vec<_>>());
    assert_eq!(servo.statistics().worst_lateness, 0);
}

#[test]
fn a_servo_does_not_drift_in_a_million_releases() {
    let processor = Processor::new(Rate::hz(32_768));
    let rate = Rate::hz(60);
    let servo = SimpleServo::new(processor.clone(), rate, Clock::of::<u64>(Rate::hz(32_768)));
    let (mut runs, mut worst) = (0_u64, 0);
    let mut body = || {
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
    fn body(runs: &mut u32) {
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
    let mut body = || panic!("for the test");
    let unwound = catch_unwind(AssertUnwindSafe(|| {
        servo.scope(Overrun::Skip, &mut body, || servo.start())
    }));
    assert!(unwound.is_err());
    let counts = servo.statistics();
    assert_eq!((counts.run, counts.running, counts.enabled), (1, 0, false));
    // Free for another one, at whose next instant the loop runs.
    let mut runs = 0;
    let mut body = || runs += 1;
    servo
        .scope(Overrun::Skip, &mut body, || {
            processor.with_handler(|| servo.on_timer(), || processor.run_until(101));
        })
        .unwrap();
    assert_eq!(runs, 10);
}

/// A platform on which a loop runs in a vector that is pended.
struct Vectored {
    processor: Processor,
    pended: AtomicBool,
}

impl Timer for Vectored {
    type Instant = u64;

    fn frequency(&self) -> Rate {
        self.processor.frequency()
    }

    fn now(&self) -> u64 {
        self.processor.now()
    }

    fn arm(&self, at: u64) -> Armed {
        self.processor.arm(at)
    }

    fn disarm(&self) {
        self.processor.disarm();
    }
}

impl Platform for Vectored {
    fn dispatch(&self, ranks: u32, _: impl FnOnce()) {
        assert_eq!(ranks, 1);
        self.pended.store(true, Relaxed);
    }

    fn interruptible(&self, body: impl FnOnce()) {
        self.processor.interruptible(body);
    }
}

#[test]
fn a_loop_runs_in_its_vector_where_there_is_one() {
    let processor = Processor::new(FREQUENCY);
    let platform = Vectored {
        processor: processor.clone(),
        pended: AtomicBool::new(false),
    };
    let servo = SimpleServo::new(platform, Rate::hz(100), CLOCK);
    let mut starts = Vec::new();
    let mut body = || {
        starts.push(processor.now());
        // The second run is interrupted twice.
        processor.work(if starts.len() == 2 { 25 } else { 3 });
    };
    let vector = || {
        while servo.platform().pended.swap(false, Relaxed) {
            servo.on_vector();
        }
    };
    servo
        .scope(Overrun::CatchUp(1), &mut body, || {
            let handler = || {
                servo.on_timer();
                vector();
            };
            processor.with_handler(handler, || {
                servo.start().unwrap();
                vector();
                processor.run_until(45);
            });
        })
        .unwrap();
    assert_eq!(starts, [0, 10, 35, 40]);
    let counts = servo.statistics();
    assert_eq!((counts.released, counts.run, counts.skipped), (5, 4, 1));
}
