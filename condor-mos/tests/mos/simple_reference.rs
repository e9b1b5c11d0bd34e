//! The simple servo against a reference that goes tick by tick.

use condor_mos::sim::Processor;
use condor_mos::{Clock, Overrun, Rate, SimpleServo, StartError, Statistics, Timer};
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
    released: u64,
    skipped: u64,
    run: u64,
    /// Releases, and ticks of runs, before the last change of the rate.
    before: (u64, u64),
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
        self.skipped += self.pending.len() as u64;
        self.pending.clear();
    }

    fn obey(&mut self, command: Command) {
        match command {
            Command::Wait(ticks) => self.advance(self.now + ticks),
            Command::Hold(ticks) => self.held_until = self.now + ticks,
            Command::SetRate(rate) => {
                (self.origin, self.passed) = (self.due(), 0);
                self.before = (self.released, self.total_run);
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
            running: u64::from(self.running.is_some()),
            pending: self.pending.len() as u64,
            worst_lateness: self.worst_lateness as u32,
            worst_run: self.worst_run as u32,
            total_run: self.total_run,
            released_before: self.before.0,
            total_before: self.before.1,
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

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
            before: (0, 0),
            released: 0, skipped: 0, run: 0, worst_lateness: 0, worst_run: 0, total_run: 0,
        };
        let processor = Processor::new(FREQUENCY);
        let servo = SimpleServo::try_new(processor.clone(), first, CLOCK).unwrap();
        let mut starts = Vec::new();
        let mut body = |_| {
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
