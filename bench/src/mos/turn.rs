//! [`Turn`]: what one contestant runs, and what it leaves behind.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use super::background;
use super::system::now_ns;
use crate::Result;
use crate::measure::quantile;

/// Loops that run together, the fastest first.
#[derive(Clone, Copy, Debug)]
pub(super) struct LoopSet {
    /// What the table calls it.
    pub(super) name: &'static str,
    /// The rates in hertz; each divides a second into whole nanoseconds.
    pub(super) rates_hz: &'static [u32],
}

/// Everything repeats after this time: the loops of every set, and the 250 Hz and 1 kHz ticks of
/// kernels.
const WINDOW_NS: u64 = 20_000_000;

/// From the making of a turn to its first release: runtimes have started their threads by then.
const LEAD_NS: u64 = 30_000_000;

/// Not measured: caches and the kernel's choice of idle states settle.
const WARM_UP_WINDOWS: usize = 1;

/// A servo loop, and when its releases ran.
pub(super) struct Loop {
    /// Nanoseconds from release to release.
    pub(super) period_ns: u64,
    /// When the body of each release began; [`NEVER`] if it did not.
    begun_ns: Box<[AtomicU64]>,
}

/// In place of a time: the release did not run.
const NEVER: u64 = u64::MAX;

/// Counts the runs of all loops of this process, which plays one turn.
static RUNS: AtomicU64 = AtomicU64::new(0);

impl Loop {
    /// The body: notes the time at which release number `release`, from 0, began.
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

    /// How late each release began, in nanoseconds.
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
    pub(super) loops: Vec<Loop>,
    /// When release 0 of every loop is due, in nanoseconds of `CLOCK_MONOTONIC`.
    pub(super) start_ns: u64,
    /// Ticks that were taken from the background, slice by slice.
    stolen: Box<[AtomicU64]>,
    /// Nanoseconds of a slice: the period of the fastest loop.
    slice_ns: u64,
}

impl Turn {
    /// A turn of `set` that begins soon and takes about `length`.
    pub(super) fn new(set: LoopSet, length: Duration) -> Self {
        let windows = WARM_UP_WINDOWS + (length.as_nanos() as u64 / WINDOW_NS).max(2) as usize;
        let end_ns = windows as u64 * WINDOW_NS;
        let cells = |count: usize, value| (0..count).map(|_| AtomicU64::new(value)).collect();
        let servo_loop = |rate: &u32| {
            let period_ns = 1_000_000_000 / u64::from(*rate);
            Loop {
                period_ns,
                begun_ns: cells((end_ns / period_ns) as usize, NEVER),
            }
        };
        let loops: Vec<Loop> = set.rates_hz.iter().map(servo_loop).collect();
        let slice_ns = loops.first().map_or(WINDOW_NS, |fastest| fastest.period_ns);
        Self {
            stolen: cells((end_ns / slice_ns) as usize, 0),
            slice_ns,
            loops,
            start_ns: now_ns() + LEAD_NS,
        }
    }

    /// The background: runs on the calling thread until the turn is over.
    ///
    /// To be called once, on the thread that called the contestant. It does nothing but notice
    /// when it does not run.
    pub(super) fn background(&self) -> Result<()> {
        // Slices are cut between two releases, so that no interruption is cut in two.
        let begin_ns = self.start_ns + self.slice_ns / 2;
        Ok(background::watch(
            begin_ns,
            self.slice_ns,
            &RUNS,
            &self.stolen,
        )?)
    }

    /// What was reached, once the background has ended: median and 99th percentile of the lateness of
    /// the fastest loop, ns; the CPU that a release takes from the background, ns, the median over the
    /// windows; how far the fastest loop falls behind its grid, us in a second.
    ///
    /// # Errors
    /// The fastest loop did not run.
    pub(super) fn figures(&self, ns_per_tick: f64) -> Result<[f64; 4]> {
        let late = self.loops.first().ok_or("no loops")?;
        let per_window = (WINDOW_NS / late.period_ns) as usize;
        let mut lateness = late.lateness(self.start_ns);
        let skipped = WARM_UP_WINDOWS * per_window;
        let stolen = self.stolen_per_window(per_window) * ns_per_tick;
        let stolen = stolen / self.releases_per_window() as f64;
        if lateness.len() < skipped + 2 * per_window {
            return Err("the loop did not run".into());
        }
        let measured = &mut lateness[skipped..];
        // The grid moves away by the difference of the ends, free of single late releases.
        let middle_of = |part: &[f64]| quantile(&mut part.to_vec(), 0.5);
        let apart_s = ((measured.len() - per_window) as u64 * late.period_ns) as f64 * 1e-9;
        let moved_ns = middle_of(&measured[measured.len() - per_window..])
            - middle_of(&measured[..per_window]);
        let drift = moved_ns * 1e-3 / apart_s;
        Ok([
            quantile(measured, 0.5),
            quantile(measured, 0.99),
            stolen,
            drift,
        ])
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

    /// The releases of all loops in one window.
    fn releases_per_window(&self) -> u64 {
        let releases = |servo_loop: &Loop| WINDOW_NS / servo_loop.period_ns;
        self.loops.iter().map(releases).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SET: LoopSet = LoopSet {
        name: "400 and 50 Hz",
        rates_hz: &[400, 50],
    };

    /// A turn of four windows in which release `n` of the fastest loop is `late(n)` ns late.
    fn played(late: impl Fn(u64) -> u64) -> Turn {
        let turn = Turn::new(SET, Duration::from_millis(60));
        for (release, begun) in (0_u64..).zip(&turn.loops[0].begun_ns) {
            let due = turn.start_ns + release * 2_500_000;
            begun.store(due + late(release), Ordering::Relaxed);
        }
        turn
    }

    #[test]
    fn lateness_is_counted_from_the_grid() {
        let [p50, p99, _, drift] = played(|release| 100 + release % 8).figures(1.0).unwrap();
        assert!(
            [p50, p99, drift].iter().eq(&[103.0, 107.0, 0.0]),
            "{p50} {p99} {drift}"
        );
    }

    #[test]
    fn drift_is_the_movement_of_the_grid() {
        // 25 ns in 2.5 ms are 10 us in a second.
        let [.., drift] = played(|release| 25 * release).figures(1.0).unwrap();
        assert!((drift - 10.0).abs() < 1e-9, "{drift}");
    }

    #[test]
    fn a_rare_interruption_by_others_is_not_charged_to_the_loops() {
        let turn = played(|_| 0);
        for ticks in &turn.stolen {
            ticks.store(9_000, Ordering::Relaxed);
        }
        turn.stolen[20].store(50_000_000, Ordering::Relaxed);
        // Eight slices a window, and nine releases.
        let [_, _, stolen, _] = turn.figures(0.5).unwrap();
        assert!((stolen - 4_000.0).abs() < 1e-9, "{stolen}");
    }

    #[test]
    fn a_loop_that_does_not_run_is_an_error() {
        assert!(
            Turn::new(SET, Duration::from_millis(60))
                .figures(1.0)
                .is_err()
        );
    }
}
