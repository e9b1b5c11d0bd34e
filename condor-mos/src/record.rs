//! The records that a scheduler keeps of its loops, which a type selects.

use core::sync::atomic::{Ordering, compiler_fence};

/// The choice of the statistics that a [`Scheduler`](crate::Scheduler) keeps of each loop, as a
/// type parameter: [`NoStatistics`], [`Counts`] (the default) or [`Histograms`].
#[allow(private_bounds, reason = "nobody else implements it")]
pub trait Keep: Record {}

pub(crate) trait Record: Copy + Send + 'static {
    const NEW: Self;

    /// Whether it wants to know about starts and ends, which takes a reading of the counter.
    const MEASURES: bool;

    /// The loop starts, so many ticks after it was due.
    fn start(&mut self, lateness: u32);

    /// The loop has finished, after `ticks` of its own.
    fn finish(&mut self, ticks: u32);

    /// Releases that will not run.
    fn skip(&mut self, releases: u32);

    /// The loop has another rate from here on; `released` releases had the former ones.
    fn change(&mut self, released: u64);

    fn counts(&self) -> Counts;

    /// None if only counts are kept.
    fn histograms(&self) -> Option<Histograms> {
        None
    }
}

/// The choice of no statistics: a scheduler counts and measures nothing, which saves readings of
/// the counter.
#[derive(Clone, Copy, Debug)]
pub struct NoStatistics;

impl Keep for NoStatistics {}

impl Record for NoStatistics {
    const NEW: Self = Self;
    const MEASURES: bool = false;

    #[inline(always)]
    fn start(&mut self, _: u32) {}

    #[inline(always)]
    fn finish(&mut self, _: u32) {}

    #[inline(always)]
    fn skip(&mut self, _: u32) {}

    fn change(&mut self, _: u64) {}

    fn counts(&self) -> Counts {
        Counts::NEW
    }
}

/// The choice of simple statistics, for [`Loops::statistics`](crate::Loops::statistics): counts of
/// runs and skipped releases, the sum and the longest of the run times, and the longest lateness.
#[derive(Clone, Copy, Debug)]
pub struct Counts {
    pub(crate) worst_lateness: u32,
    pub(crate) worst_run: u32,
    /// The low words of the runs that have finished and of their ticks, and the high ones.
    pub(crate) run: u32,
    pub(crate) total: u32,
    pub(crate) run_high: u32,
    pub(crate) total_high: u32,
    pub(crate) skipped: u64,
    /// Releases, and ticks of all runs, before the rate was changed last.
    pub(crate) released_before: u64,
    pub(crate) total_before: u64,
}

impl Keep for Counts {}

impl Counts {
    pub(crate) fn run(&self) -> u64 {
        u64::from(self.run_high) << 32 | u64::from(self.run)
    }

    pub(crate) fn total_run(&self) -> u64 {
        u64::from(self.total_high) << 32 | u64::from(self.total)
    }
}

/// Called where what follows is seldom: with the fence, a compiler does not do it under a condition.
#[cold]
fn seldom() {
    compiler_fence(Ordering::Release);
}

impl Record for Counts {
    const NEW: Self = Self {
        worst_lateness: 0,
        worst_run: 0,
        run: 0,
        total: 0,
        run_high: 0,
        total_high: 0,
        skipped: 0,
        released_before: 0,
        total_before: 0,
    };
    const MEASURES: bool = true;

    #[inline(always)]
    fn start(&mut self, lateness: u32) {
        if lateness > self.worst_lateness {
            seldom();
            self.worst_lateness = lateness;
        }
    }

    #[inline(always)]
    fn finish(&mut self, ticks: u32) {
        self.run = self.run.wrapping_add(1);
        self.total = self.total.wrapping_add(ticks);
        if self.total < ticks {
            seldom();
            self.total_high = self.total_high.wrapping_add(1);
        }
        if self.run == 0 {
            seldom();
            self.run_high = self.run_high.wrapping_add(1);
        }
        if ticks > self.worst_run {
            seldom();
            self.worst_run = ticks;
        }
    }

    fn skip(&mut self, releases: u32) {
        self.skipped += u64::from(releases);
    }

    fn change(&mut self, released: u64) {
        self.released_before = released;
        self.total_before = self.total_run();
    }

    fn counts(&self) -> Counts {
        *self
    }
}

/// The choice of full statistics: [`Counts`], and the distributions of a loop's lateness and run
/// times, which [`Loops::histograms`](crate::Loops::histograms) returns.
#[derive(Clone, Copy, Debug)]
pub struct Histograms {
    counts: Counts,
    lateness: Histogram,
    run: Histogram,
}

impl Keep for Histograms {}

impl Histograms {
    /// Returns the distribution of lateness, which is the time in ticks from a release to the start
    /// of its run.
    #[must_use]
    pub const fn lateness(&self) -> &Histogram {
        &self.lateness
    }

    /// Returns the distribution of run times in ticks; the time of loops that interrupted a run is
    /// not included.
    #[must_use]
    pub const fn run(&self) -> &Histogram {
        &self.run
    }
}

impl Record for Histograms {
    const NEW: Self = Self {
        counts: Counts::NEW,
        lateness: Histogram::NEW,
        run: Histogram::NEW,
    };
    const MEASURES: bool = true;

    #[inline]
    fn start(&mut self, lateness: u32) {
        self.counts.start(lateness);
        self.lateness.count(lateness);
    }

    #[inline]
    fn finish(&mut self, ticks: u32) {
        self.counts.finish(ticks);
        self.run.count(ticks);
    }

    fn skip(&mut self, releases: u32) {
        self.counts.skip(releases);
    }

    fn change(&mut self, released: u64) {
        self.counts.change(released);
    }

    fn counts(&self) -> Counts {
        self.counts
    }

    fn histograms(&self) -> Option<Histograms> {
        Some(*self)
    }
}

/// The distribution of a measured time in ticks: how many measurements fall into each of 64
/// classes. There are two classes for each power of two, so a time is known to within half of
/// itself. A count stays at 2^32 - 1 when it reaches that.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Histogram {
    classes: [u32; 64],
}

impl Histogram {
    pub(crate) const NEW: Self = Self::new([0; 64]);

    /// Makes the distribution with these counts of the classes, the shortest times first.
    #[must_use]
    pub const fn new(classes: [u32; 64]) -> Self {
        Self { classes }
    }

    /// Returns the counts of the classes, the shortest times first.
    #[must_use]
    pub const fn classes(&self) -> &[u32; 64] {
        &self.classes
    }

    /// The class of a time: its highest bit, and the bit behind that.
    #[inline]
    pub(crate) fn class(ticks: u32) -> usize {
        match ticks.checked_ilog2() {
            None => 0,
            Some(0) => 1,
            Some(high) => (2 * high + (ticks >> (high - 1) & 1)) as usize,
        }
    }

    /// The longest time of a class.
    pub(crate) fn longest(class: usize) -> u32 {
        match class {
            0 | 1 => class as u32,
            _ => {
                let half = 1_u64 << (class / 2 - 1);
                let end = half * (class % 2 + 3) as u64;
                (end - 1) as u32
            }
        }
    }

    #[inline]
    pub(crate) fn count(&mut self, ticks: u32) {
        if let Some(class) = self.classes.get_mut(Self::class(ticks)) {
            *class = class.saturating_add(1);
        }
    }

    /// Returns the number of measurements.
    #[must_use]
    pub fn total(&self) -> u64 {
        self.classes.iter().map(|&class| u64::from(class)).sum()
    }

    /// Returns a time in ticks that `percent` percent of all measurements do not exceed; 50 is the
    /// median. The result is the upper end of a class, at most 1.5 times the exact percentile.
    /// Returns 0 if there are no measurements.
    #[must_use]
    pub fn percentile(&self, percent: f64) -> u32 {
        // Below 2^53 nothing is lost.
        #[allow(clippy::cast_precision_loss)]
        let wanted = self.total() as f64 * percent / 100.0;
        let (mut seen, mut longest) = (0.0, 0);
        for (class, &count) in self.classes.iter().enumerate() {
            if count > 0 && (seen < wanted || seen == 0.0) {
                longest = Self::longest(class);
            }
            seen += f64::from(count);
        }
        longest
    }
}
