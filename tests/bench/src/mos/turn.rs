//! [`Turn`]: what one contestant runs, and what it leaves behind.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use super::background;
use super::system::now_ns;
use crate::Result;
use crate::measure::quantile;

/// Loops that run together.
pub(super) const LOOPS: usize = 3;

/// Their rates in hertz, the fastest first; each divides a second into whole nanoseconds.
const RATES_HZ: [u64; LOOPS] = [400, 100, 50];

/// The period of the fastest loop.
const FASTEST_NS: u64 = 1_000_000_000 / RATES_HZ[0];

/// Everything repeats after this time: the loops, and the 250 Hz and 1 kHz ticks of
/// kernels.
const WINDOW_NS: u64 = 20_000_000;

/// The time from the making of a turn to its first release: runtimes have started their threads by then.
const LEAD_NS: u64 = 30_000_000;

/// The windows that are not measured: caches and the kernel's choice of idle states settle.
const WARM_UP_WINDOWS: usize = 1;

/// A servo loop, and when its releases ran.
pub(super) struct Loop {
    /// Nanoseconds from release to release.
    pub(super) period_ns: u64,
    /// When the body of each release began; [`NEVER`] if it did not.
    begun_ns: Box<[AtomicU64]>,
}

/// The value in place of a time if the release did not run.
const NEVER: u64 = u64::MAX;

/// Counts the runs of all loops of this process, which plays one turn.
static RUNS: AtomicU64 = AtomicU64::new(0);

impl Loop {
    /// Runs the body of the loop: notes the time at which release number `release`, from 0, began.
    ///
    /// Costs one reading of the clock, makes no system call and may run in a signal handler.
    #[inline]
    pub(super) fn run(&self, release: u64) {
        let now = now_ns();
        // Relaxed: read by the background, on the same core.
        RUNS.fetch_add(1, Ordering::Relaxed);
        // Releases after the end are of no interest. Relaxed: read when all is over, by a thread
        // that has slept or was interrupted since.
        if let Some(cell) = self.begun_ns.get(release as usize) {
            cell.store(now, Ordering::Relaxed);
        }
    }

    /// Returns the lateness of each release that began, in nanoseconds.
    fn lateness(&self, start_ns: u64) -> Vec<f64> {
        let late = |(release, begun): (usize, &AtomicU64)| {
            let begun = begun.load(Ordering::Relaxed);
            let due = start_ns + release as u64 * self.period_ns;
            (begun != NEVER).then_some(begun as f64 - due as f64)
        };
        self.begun_ns.iter().enumerate().filter_map(late).collect()
    }
}

/// One contestant's time on the measuring core.
pub(super) struct Turn {
    /// The loops, the fastest first.
    pub(super) loops: [Loop; LOOPS],
    /// When release 0 of every loop is due, in nanoseconds of `CLOCK_MONOTONIC`.
    pub(super) start_ns: u64,
    /// Ticks that were taken from the background, one after the other period of the fastest loop.
    stolen: Box<[AtomicU64]>,
}

impl Turn {
    /// Makes a turn that begins soon and takes about `length`.
    pub(super) fn new(length: Duration) -> Self {
        let windows = WARM_UP_WINDOWS + (length.as_nanos() as u64 / WINDOW_NS).max(2) as usize;
        let end_ns = windows as u64 * WINDOW_NS;
        let cells = |count: usize, value| (0..count).map(|_| AtomicU64::new(value)).collect();
        Self {
            loops: RATES_HZ.map(|rate_hz| {
                let period_ns = 1_000_000_000 / rate_hz;
                Loop {
                    period_ns,
                    begun_ns: cells((end_ns / period_ns) as usize, NEVER),
                }
            }),
            stolen: cells((end_ns / FASTEST_NS) as usize, 0),
            start_ns: now_ns() + LEAD_NS,
        }
    }

    /// Runs the background on the calling thread until the turn is over.
    ///
    /// To be called once, on the thread that called the contestant. It does nothing but notice
    /// when it does not run.
    pub(super) fn background(&self) -> Result<()> {
        // Slices are cut between two releases, so that no interruption is cut in two.
        let begin_ns = self.start_ns + FASTEST_NS / 2;
        Ok(background::watch(
            begin_ns,
            FASTEST_NS,
            &RUNS,
            &self.stolen,
        )?)
    }

    /// Returns the figures of the turn, once the background has ended: median and 99th percentile of the
    /// lateness of the fastest loop, ns; the CPU that a release takes from the background, ns, the median
    /// over the windows.
    ///
    /// # Errors
    /// Returns an error if the fastest loop did not run.
    pub(super) fn figures(&self, ns_per_tick: f64) -> Result<[f64; 3]> {
        let per_window = (WINDOW_NS / FASTEST_NS) as usize;
        let mut lateness = self.loops[0].lateness(self.start_ns);
        let skipped = WARM_UP_WINDOWS * per_window;
        let stolen = self.stolen_per_window(per_window) * ns_per_tick;
        let stolen = stolen / self.releases_per_window() as f64;
        if lateness.len() < skipped + 2 * per_window {
            return Err("the loop did not run".into());
        }
        let measured = &mut lateness[skipped..];
        Ok([quantile(measured, 0.5), quantile(measured, 0.99), stolen])
    }

    /// Ticks that are taken in a window.
    ///
    /// What the rest of the machine and its host take is long and rare. So this is not the median
    /// of the windows but the sum of medians: of the first slices of all windows, of the second
    /// ones, and so on. What a slice holds is the same in every window.
    fn stolen_per_window(&self, slices: usize) -> f64 {
        let median_of = |slice: usize| {
            let same = self.stolen.iter().skip(slice).step_by(slices);
            let same = same.skip(WARM_UP_WINDOWS);
            let mut ticks: Vec<f64> = same
                .map(|ticks| ticks.load(Ordering::Relaxed) as f64)
                .collect();
            quantile(&mut ticks, 0.5)
        };
        (0..slices).map(median_of).sum()
    }

    /// Returns the releases of all loops in one window.
    fn releases_per_window(&self) -> u64 {
        let releases = |servo_loop: &Loop| WINDOW_NS / servo_loop.period_ns;
        self.loops.iter().map(releases).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a turn of four windows in which release `n` of the fastest loop is `late(n)` ns late.
    fn played(late: impl Fn(u64) -> u64) -> Turn {
        let turn = Turn::new(Duration::from_millis(60));
        for (release, begun) in (0_u64..).zip(&turn.loops[0].begun_ns) {
            let due = turn.start_ns + release * 2_500_000;
            begun.store(due + late(release), Ordering::Relaxed);
        }
        turn
    }

    #[test]
    fn lateness_is_counted_from_the_grid() {
        let [p50, p99, _] = played(|release| 100 + release % 8).figures(1.0).unwrap();
        assert!([p50, p99].iter().eq(&[103.0, 107.0]), "{p50} {p99}");
    }

    #[test]
    fn a_rare_interruption_by_others_is_not_charged_to_the_loops() {
        let turn = played(|_| 0);
        for ticks in &turn.stolen {
            ticks.store(9_000, Ordering::Relaxed);
        }
        turn.stolen[20].store(50_000_000, Ordering::Relaxed);
        // Eight slices a window, and eleven releases.
        let [.., stolen] = turn.figures(0.5).unwrap();
        assert!((stolen - 8.0 * 4_500.0 / 11.0).abs() < 1e-9, "{stolen}");
    }

    #[test]
    fn a_loop_that_does_not_run_is_an_error() {
        assert!(Turn::new(Duration::from_millis(60)).figures(1.0).is_err());
    }
}
