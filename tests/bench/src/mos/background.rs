//! The share of a processor that is taken from the thread that runs when no loop does.
//!
//! The CPU clocks of threads and `getrusage` leave out what the kernel does in an interrupt, or
//! charge it to whom it interrupts, and the work of a release is just that: a timer interrupt, a
//! wake-up, two context switches or a signal frame. So the background looks at the time stamp
//! counter as fast as it can. Whenever two looks are further apart than the loop needs, somebody
//! else had the processor in between. If a loop ran in such a gap, all of it counts: kernel, loop
//! body, helper threads. Gaps without one, such as the kernel's own tick, do not. What remains
//! invisible are colder caches afterwards.

use std::io;
use std::sync::atomic::{AtomicU64, Ordering};

use super::system::{now_ns, sleep_until};
use crate::clock::{Calibration, ticks};

/// A gap is an interruption from this length on: many times the loop, and a fraction of the
/// shortest interrupt.
const GAP_NS: f64 = 250.0;

/// Counts the ticks in which the calling thread does not run because a loop does; each run of a
/// loop counts one more `runs`.
///
/// Waits until `begin_ns` of `CLOCK_MONOTONIC`, then fills one cell of `stolen` every `slice_ns`.
pub(super) fn watch(
    begin_ns: u64,
    slice_ns: u64,
    runs: &AtomicU64,
    stolen: &[AtomicU64],
) -> io::Result<()> {
    let calibration = Calibration::begin();
    // Leaves the core to others while there is time: the kernel would take 50 ms of every second
    // from a core that does nothing but real-time work, in the middle of a turn.
    sleep_until(begin_ns.saturating_sub(slice_ns))?;
    while now_ns() < begin_ns {
        std::hint::spin_loop();
    }
    let per_ns = 1.0 / calibration.ns_per_tick();
    // Both are positive and far below 2^64.
    #[allow(clippy::cast_sign_loss)]
    let ticks_of = |ns: f64| (ns * per_ns) as u64;
    let (gap, slice) = (ticks_of(GAP_NS), ticks_of(slice_ns as f64));
    let mut known = runs.load(Ordering::Relaxed);
    let mut last = ticks();
    let mut end = last.wrapping_add(slice);
    for cell in stolen {
        let mut taken = 0;
        loop {
            let now = ticks();
            let passed = now.wrapping_sub(last);
            last = now;
            if passed > gap {
                // Relaxed: the loop ran on this core, before.
                let runs = runs.load(Ordering::Relaxed);
                if runs != known {
                    taken += passed;
                }
                known = runs;
            }
            if now.wrapping_sub(end).cast_signed() >= 0 {
                break;
            }
        }
        // Read by this thread when the turn is over.
        cell.store(taken, Ordering::Relaxed);
        end = end.wrapping_add(slice);
    }
    Ok(())
}
