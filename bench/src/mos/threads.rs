//! A thread for each loop: the baseline, and how beginners write it.

use std::sync::{Arc, Barrier};
use std::thread;
use std::time::Duration;

use super::system::{Rank, be_fifo, sleep_until};
use super::turn::{Loop, Turn};
use crate::Result;

/// Starts a thread for every loop, then is the background.
fn run(turn: &'static Turn, fifo: bool, body: fn(&Loop, u64) -> Result<()>) -> Result<()> {
    // The background would not let threads begin that have its own priority still.
    let ready = Arc::new(Barrier::new(turn.loops.len() + 1));
    for (index, servo_loop) in turn.loops.iter().enumerate() {
        let ready = Arc::clone(&ready);
        thread::Builder::new().spawn(move || {
            if fifo {
                // Where that is not permitted, the report says so.
                let _ = be_fifo(Rank::Loop(index));
            }
            ready.wait();
            if let Err(error) = body(servo_loop, turn.start_ns) {
                eprintln!("loop {index}: {error}");
            }
        })?;
    }
    ready.wait();
    turn.background()
}

/// Rate-monotonic `SCHED_FIFO` priorities where permitted, and absolute deadlines.
pub(super) fn run_fifo(turn: &'static Turn) -> Result<()> {
    run(turn, true, |servo_loop, start_ns| {
        for release in 0.. {
            sleep_until(start_ns + release * servo_loop.period_ns)?;
            servo_loop.run(release);
        }
        Ok(())
    })
}

/// `thread::sleep` for a period after every run.
pub(super) fn run_sleep(turn: &'static Turn) -> Result<()> {
    run(turn, false, |servo_loop, start_ns| {
        sleep_until(start_ns)?;
        for release in 0.. {
            servo_loop.run(release);
            thread::sleep(Duration::from_nanos(servo_loop.period_ns));
        }
        Ok(())
    })
}
