//! The loops of a hand in virtual time: torques at 400 Hz, tendons at 100 Hz, trajectories at 50 Hz, and
//! a background. Prints the event table, what the loops did in ten seconds, and whether they always
//! end in time.
//!
//! `cargo run --release -p condor-mos --features sim --example hand_loops`

use condor_mos::sim::SimPlatform;
use condor_mos::{
    Analysis, ClockSpec, EventTable, LoopError, LoopId, LoopLock, Loops, Overrun, Rate, Scheduler,
    Timer,
};
use std::process::ExitCode;

const MICROSECONDS: Rate = Rate::hz(1_000_000);
const TEN_SECONDS: u64 = 10_000_000;

const TORQUE: LoopId = LoopId(0);
const TENDONS: LoopId = LoopId(1);
const TRAJECTORY: LoopId = LoopId(2);

/// The place of a rate is the number of its loop. One entry less would not compile.
const TABLE: EventTable<3, 8> = EventTable::new(
    &[Rate::hz(400), Rate::hz(100), Rate::hz(50)],
    ClockSpec::of::<u64>(MICROSECONDS),
);

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), LoopError> {
    println!("{TABLE}\n");
    let hand = SimPlatform::new(MICROSECONDS);
    let scheduler = Scheduler::new(hand.clone(), TABLE);

    // The target of the joint, which the trajectory loop passes to the torque loop.
    let goal = LoopLock::new(&[TORQUE, TRAJECTORY], 0.0);
    let mut position = 0.0;

    // In virtual time a loop says how long it computes: here a little longer now and then.
    let mut torque = |_| {
        let goal = goal
            .lock(&scheduler, |goal| *goal)
            .expect("a declared user");
        position += 0.1 * (goal - position);
        hand.work(700 + hand.now() % 90);
    };
    let mut tendons = |_| hand.work(1_500 + hand.now() % 300);
    let mut trajectory = |_| {
        hand.work(4_000 + hand.now() % 700);
        // To 1 rad, in steps of 5 mrad.
        goal.lock(&scheduler, |goal| *goal = f64::min(*goal + 0.005, 1.0))
            .expect("a declared user");
    };

    let loops = scheduler.scope(|scope| {
        scope.assign(TORQUE, Overrun::Skip, &mut torque)?;
        scope.assign(TENDONS, Overrun::Skip, &mut tendons)?;
        scope.assign(TRAJECTORY, Overrun::CatchUp(1), &mut trajectory)?;
        // The background: a program that goes on whenever no loop runs.
        let background = || {
            scheduler.start().expect("the table is for this clock");
            hand.run_until(TEN_SECONDS);
        };
        hand.with_handler(|| scheduler.on_timer(), background);
        Ok::<_, LoopError>([
            scheduler.statistics(TORQUE)?,
            scheduler.statistics(TENDONS)?,
            scheduler.statistics(TRAJECTORY)?,
        ])
    })?;

    println!("{:#}", loops[0]);
    for counts in &loops {
        println!("{counts}");
    }
    println!(
        "\n{}\n\nthe joint is at {position:.3} rad",
        Analysis::measured(&loops)
    );
    Ok(())
}
