//! Two servo loops and a background, first in threads, then on one stack in signal handlers.
//!
//! `two_rates [SECONDS]`: for how long each, 5 s if not given.

use std::error::Error;
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use condor_mos::linux::{CLOCK, RealTime, Signals, Threads};
use condor_mos::{EventTable, LoopError, LoopId, Overrun, Rate, Scheduler, Statistics};

const RATES: [Rate; 2] = [Rate::hz(400), Rate::hz(50)];
const SERVO: LoopId = LoopId(0);
const TRAJECTORY: LoopId = LoopId(1);

/// What the loops and the background share: a joint that follows a target.
#[derive(Default)]
struct Joint {
    target: AtomicU32,
    position: AtomicU32,
}

impl Joint {
    /// The 400 Hz loop: an eighth of the way to the target.
    fn servo(&self) {
        let target = self.target.load(Ordering::Relaxed);
        let position = self.position.load(Ordering::Relaxed);
        let way = target.wrapping_sub(position).cast_signed() / 8;
        let position = position.wrapping_add_signed(way);
        self.position.store(position, Ordering::Relaxed);
    }

    /// The 50 Hz loop: the target moves on.
    fn trajectory(&self) {
        self.target.fetch_add(1000, Ordering::Relaxed);
    }
}

/// The background: does a little and sleeps, until the end. It has the priority of the loops that
/// interrupt it, so a computing one would keep the core from all others.
fn background(length: Duration) -> u64 {
    let end = Instant::now() + length;
    let mut rounds = 0;
    while Instant::now() < end {
        rounds += 1;
        thread::sleep(Duration::from_millis(1));
    }
    rounds
}

fn in_threads(length: Duration) -> Result<(), Box<dyn Error>> {
    let joint = Joint::default();
    let threads = Threads::new(RATES, RealTime::default())?;
    let (mut servo, mut trajectory) = (|_| joint.servo(), |_| joint.trajectory());
    let rounds = threads.scope(|scope| {
        scope.assign(SERVO, Overrun::Skip, &mut servo)?;
        scope.assign(TRAJECTORY, Overrun::Skip, &mut trajectory)?;
        threads.start()?;
        let rounds = background(length);
        threads.stop();
        Ok::<_, Box<dyn Error>>(rounds)
    })?;
    println!("Threads\n{}", threads.privileges());
    print(|id| threads.statistics(id))?;
    report(&joint, rounds);
    Ok(())
}

fn on_one_stack(length: Duration) -> Result<(), Box<dyn Error>> {
    let joint = Joint::default();
    // A loop interrupts the background without any privilege, but not other programs.
    let privileges = RealTime::default().request();
    let table = EventTable::<2, 8>::new(&RATES, CLOCK);
    let scheduler = Scheduler::new(Signals::new(), table);
    let (mut servo, mut trajectory) = (|_| joint.servo(), |_| joint.trajectory());
    let rounds = scheduler.scope(|scope| {
        scope.assign(SERVO, Overrun::Skip, &mut servo)?;
        scope.assign(TRAJECTORY, Overrun::Skip, &mut trajectory)?;
        let program = || {
            scheduler.start()?;
            let rounds = background(length);
            scheduler.stop();
            Ok::<_, Box<dyn Error>>(rounds)
        };
        let signals = scheduler.platform();
        // SAFETY: both loops only compute and use atomics, on a stack of megabytes.
        unsafe { signals.with_handler(|| scheduler.on_timer(), program) }?
    })?;
    println!("\nOne stack, in signals\n{privileges}");
    print(|id| scheduler.statistics(id))?;
    report(&joint, rounds);
    Ok(())
}

fn print(statistics: impl Fn(LoopId) -> Result<Statistics, LoopError>) -> Result<(), LoopError> {
    println!("{:#}", statistics(SERVO)?);
    println!("{}", statistics(SERVO)?);
    println!("{}", statistics(TRAJECTORY)?);
    Ok(())
}

fn report(joint: &Joint, rounds: u64) {
    let target = joint.target.load(Ordering::Relaxed);
    let position = joint.position.load(Ordering::Relaxed);
    println!("target {target}, position {position}; {rounds} rounds of the background");
}

fn main() -> Result<(), Box<dyn Error>> {
    let seconds = std::env::args().nth(1).map_or(Ok(5), |text| text.parse())?;
    let length = Duration::from_secs(seconds);
    in_threads(length)?;
    on_one_stack(length)
}
