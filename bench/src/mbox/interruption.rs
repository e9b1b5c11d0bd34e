//! Takes the processor away from one side, as a preemption does.
//!
//! A strategy that spins first and then sleeps could sleep ever after: whoever sleeps answers
//! late, so that the other side sleeps, too.

use std::fs;
use std::thread;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};

use crate::Result;

/// Far longer than any spinning: the length of a scheduler's slice.
pub(super) const GONE: Duration = Duration::from_millis(4);

/// A stopped process has been reported as stopped within this time.
const STOP_LIMIT: Duration = Duration::from_secs(2);

/// Makes a call while the server is stopped, and lets the server go on after a while.
///
/// Gives how long the call took.
pub(super) fn of_server(server: Pid, call: impl FnOnce() -> Result<()>) -> Result<Duration> {
    stop(server)?;
    thread::scope(|scope| {
        let resuming = scope.spawn(move || {
            thread::sleep(GONE);
            kill_process(server, Signal::CONT)
        });
        let begin = Instant::now();
        call()?;
        let took = begin.elapsed();
        resuming
            .join()
            .map_err(|_| "the thread that resumes the server panicked")??;
        Ok(took)
    })
}

/// Lets the server wait for longer than it spins.
pub(super) fn of_client() {
    thread::sleep(GONE);
}

/// Stops a process, and waits until it has stopped.
fn stop(process: Pid) -> Result<()> {
    kill_process(process, Signal::STOP)?;
    let deadline = Instant::now() + STOP_LIMIT;
    let path = format!("/proc/{}/stat", process.as_raw_nonzero());
    loop {
        // The state follows the name, which may have spaces but ends with the last bracket.
        let stat = fs::read_to_string(&path)?;
        if stat
            .rsplit_once(") ")
            .is_some_and(|(_, rest)| rest.starts_with('T'))
        {
            return Ok(());
        }
        if Instant::now() > deadline {
            return Err("the server does not stop".into());
        }
    }
}
