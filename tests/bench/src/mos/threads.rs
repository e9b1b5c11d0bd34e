//! The baseline: a thread for each loop.

use std::sync::{Arc, Barrier};
use std::thread;

use super::system::{Rank, be_fifo, sleep_until};
use super::turn::{Loop, Turn};
use crate::Result;

/// Starts a thread for every loop, with rate-monotonic `SCHED_FIFO` priorities where permitted and
/// absolute deadlines, then is the background.
pub(super) fn run(turn: &'static Turn) -> Result<()> {
    // The background would not let threads begin that have its own priority still.
    let ready = Arc::new(Barrier::new(turn.loops.len() + 1));
    for (index, servo_loop) in turn.loops.iter().enumerate() {
        let ready = Arc::clone(&ready);
        thread::Builder::new().spawn(move || {
            // If that is not permitted, the report says so.
            let _ = be_fifo(Rank::Loop(index));
            ready.wait();
            if let Err(error) = run_loop(servo_loop, turn.start_ns) {
                eprintln!("loop {index}: {error}");
            }
        })?;
    }
    ready.wait();
    turn.background()
}

fn run_loop(servo_loop: &Loop, start_ns: u64) -> Result<()> {
    for release in 0.. {
        sleep_until(start_ns + release * servo_loop.period_ns)?;
        servo_loop.run(release);
    }
    Ok(())
}
