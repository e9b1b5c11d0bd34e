//! Loops as tasks of asynchronous executors.

use std::sync::{Arc, Barrier};
use std::thread;
use std::time::{Duration, Instant};

use embassy_executor::Executor;
use tokio::runtime::{Builder, Runtime};
use tokio::time::interval_at;

use super::system::{Rank, be_fifo, now_ns};
use super::turn::{Loop, Turn};
use crate::Result;

/// Runs `executor` in a thread of its own, under `SCHED_FIFO` if `fifo` and permitted, and the
/// background here.
///
/// The threads that the executor starts inherit policy and core.
fn beside(
    turn: &'static Turn,
    fifo: bool,
    executor: impl FnOnce() -> Result<()> + Send + 'static,
) -> Result<()> {
    // The background would not let a thread begin that has its own priority still.
    let ready = Arc::new(Barrier::new(2));
    let executor_ready = Arc::clone(&ready);
    thread::Builder::new().spawn(move || {
        if fifo {
            // Where that is not permitted, the report says so.
            let _ = be_fifo(Rank::Loop(0));
        }
        executor_ready.wait();
        if let Err(error) = executor() {
            eprintln!("executor: {error}");
        }
    })?;
    ready.wait();
    turn.background()
}

/// tokio with one worker thread for each core of the machine, all on the measuring core.
pub(super) fn run_tokio_multi_thread(turn: &'static Turn) -> Result<()> {
    beside(turn, false, move || {
        run_tokio(turn, &Builder::new_multi_thread().enable_time().build()?)
    })
}

/// tokio with one thread, under `SCHED_FIFO` if so.
pub(super) fn run_tokio_current_thread<const FIFO: bool>(turn: &'static Turn) -> Result<()> {
    beside(turn, FIFO, move || {
        run_tokio(turn, &Builder::new_current_thread().enable_time().build()?)
    })
}

fn run_tokio(turn: &'static Turn, runtime: &Runtime) -> Result<()> {
    let start = Instant::now() + Duration::from_nanos(turn.start_ns.saturating_sub(now_ns()));
    for servo_loop in &turn.loops {
        runtime.spawn(async move {
            let period = Duration::from_nanos(servo_loop.period_ns);
            let mut interval = interval_at(start.into(), period);
            for release in 0.. {
                interval.tick().await;
                servo_loop.run(release);
            }
        });
    }
    runtime.block_on(std::future::pending())
}

/// embassy's executor and timer for std, two threads, under `SCHED_FIFO` if so.
pub(super) fn run_embassy<const FIFO: bool>(turn: &'static Turn) -> Result<()> {
    beside(turn, FIFO, move || {
        let epoch_ns = embassy_epoch_ns();
        Box::leak(Box::new(Executor::new())).run(|spawner| {
            for servo_loop in &turn.loops {
                match embassy_task(servo_loop, turn.start_ns - epoch_ns) {
                    Ok(task) => spawner.spawn(task),
                    Err(error) => eprintln!("embassy: {error:?}"),
                }
            }
        })
    })
}

#[embassy_executor::task(pool_size = 3)]
async fn embassy_task(servo_loop: &'static Loop, start_ns: u64) {
    let period = embassy_time::Duration::from_nanos(servo_loop.period_ns);
    let mut ticker = embassy_time::Ticker::every(period);
    ticker.reset_at(embassy_time::Instant::from_nanos(start_ns) - period);
    for release in 0.. {
        ticker.next().await;
        servo_loop.run(release);
    }
}

/// The time at which embassy's clock stood at 0, which it does not tell.
///
/// Its tick is a microsecond; the moment at which it counts on is found to a fraction of that.
fn embassy_epoch_ns() -> u64 {
    let first = embassy_time::Instant::now();
    loop {
        let (before, now) = (now_ns(), embassy_time::Instant::now());
        if now != first {
            return before - now.as_nanos();
        }
    }
}
