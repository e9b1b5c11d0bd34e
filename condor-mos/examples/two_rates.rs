//! Two servo loops and a background, first in threads, then on one stack in signal handlers.
//!
//! `two_rates [SECONDS]`: for how long each, 5 s if not given.

use std::error::Error;
use std::process::ExitCode;
use std::thread;
use std::time::{Duration, Instant};

use condor_mos::linux::{CLOCK, RealTime, SignalPlatform, Threads};
use condor_mos::{EventTable, LoopId, LoopLock, Loops, Overrun, Rate, Scheduler};

const RATES: [Rate; 2] = [Rate::hz(400), Rate::hz(50)];
const SERVO: LoopId = LoopId(0);
const TRAJECTORY: LoopId = LoopId(1);

/// The state that the loops share: a joint that follows a target.
#[derive(Clone, Copy, Default)]
struct Joint {
    target: u32,
    position: u32,
}

impl Joint {
    /// The 400 Hz loop: an eighth of the way to the target.
    fn servo(&mut self) {
        let way = self.target.wrapping_sub(self.position).cast_signed() / 8;
        self.position = self.position.wrapping_add_signed(way);
    }

    /// The 50 Hz loop: the target moves on.
    fn trajectory(&mut self) {
        self.target = self.target.wrapping_add(1000);
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

/// Runs both loops on whatever `loops` is, and reports.
fn control(loops: &impl Loops<Instant = u64>, length: Duration) -> Result<(), Box<dyn Error>> {
    let joint = LoopLock::new(&[SERVO, TRAJECTORY], Joint::default());
    let mut servo = |_| joint.lock(loops, Joint::servo).unwrap_or(());
    let mut trajectory = |_| joint.lock(loops, Joint::trajectory).unwrap_or(());
    let rounds = loops.scope(|scope| {
        scope.assign(SERVO, Overrun::Skip, &mut servo)?;
        scope.assign(TRAJECTORY, Overrun::Skip, &mut trajectory)?;
        Ok::<_, Box<dyn Error>>(loops.run(|| background(length))?)
    })?;
    println!("{:#}", loops.statistics(SERVO)?);
    println!("{}", loops.statistics(SERVO)?);
    println!("{}", loops.statistics(TRAJECTORY)?);
    let Joint { target, position } = joint.lock(loops, |joint| *joint)?;
    println!("target {target}, position {position}; {rounds} rounds of the background");
    Ok(())
}

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), Box<dyn Error>> {
    let seconds = std::env::args().nth(1).map_or(Ok(5), |text| text.parse())?;
    let length = Duration::from_secs(seconds);

    let threads = Threads::new(&RATES, RealTime::default())?;
    println!("Threads");
    control(&threads, length)?;
    println!("{}", threads.privileges());

    // A loop interrupts the background without any privilege, but not other programs.
    let privileges = RealTime::default().request();
    // SAFETY: both loops only compute, on a stack of megabytes, and so does the lock.
    let signals = unsafe { SignalPlatform::new() };
    let scheduler = Scheduler::new(signals, EventTable::<2, 8>::new(&RATES, CLOCK));
    println!("\nOne stack, in signals");
    control(&scheduler, length)?;
    println!("{privileges}");
    Ok(())
}
