use super::{
    Fault, FaultCode, FaultPlace, FaultQuantity, FaultRange, SensorFaultLimits, Stuck, Threshold,
};
use crate::math::{abs, is_finite};
use crate::number::Requirement::{self, AtMost};

/// Samples in a row.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Run(u16);

impl Run {
    /// Returns true if `bad` has been true for this many samples in a row; never for none.
    pub(super) fn reaches(&mut self, samples: u16, bad: bool) -> bool {
        self.adds(samples, u16::from(bad))
    }

    /// Returns true if this many deadlines in a row were missed, with `seconds` between two ticks, of which
    /// `longest` is the longest that is in time. A gap several times as long misses several deadlines.
    pub(crate) fn misses(&mut self, deadlines: u16, seconds: f64, longest: f64) -> bool {
        // NaN is not a time that has passed.
        let in_time = seconds > 0.0 && seconds <= longest;
        #[allow(
            clippy::cast_sign_loss,
            clippy::cast_possible_truncation,
            reason = "what is too large is the most, and what is no number none"
        )]
        let times = (seconds / longest) as u16;
        self.adds(deadlines, if in_time { 0 } else { times.max(1) })
    }

    /// Counts this sample as so many bad ones in a row; none end the row. Whether `samples` are reached.
    fn adds(&mut self, samples: u16, bad: u16) -> bool {
        self.0 = if bad > 0 && samples > 0 {
            self.0.saturating_add(bad)
        } else {
            0
        };
        samples > 0 && self.0 >= samples
    }

    /// Returns true if the last sample that counts was good.
    const fn is_over(self) -> bool {
        self.0 == 0
    }
}

impl Threshold {
    pub(super) fn is_below(&self, value: f64) -> bool {
        self.value < value
    }
}

impl FaultRange {
    pub(super) fn excludes(&self, value: f64) -> bool {
        value < self.low || value > self.high
    }
}

/// The place that is checked, and the first fault of all places, which stays.
pub(super) struct Latch<'a> {
    pub(super) first: &'a mut Option<Fault>,
    pub(super) place: FaultPlace,
    pub(super) quantity: FaultQuantity,
    /// The time since the last tick, s.
    pub(super) seconds: f64,
    /// Another place is about to have a fault that shows here, too: checks count, and report nothing.
    pub(super) is_excused: bool,
}

impl Latch<'_> {
    pub(super) fn report(
        &mut self,
        code: FaultCode,
        is_fault: bool,
        value: f64,
        allowed: Requirement,
    ) {
        if is_fault && !self.is_excused && self.first.is_none() {
            *self.first = Some(Fault {
                place: self.place,
                quantity: self.quantity,
                code,
                value,
                allowed,
            });
        }
    }
}

/// A reading of a sensor.
#[derive(Clone, Copy)]
pub(super) struct Sample {
    pub(super) measured: f64,
    /// `None` if the quantity is not controlled.
    pub(super) desired: Option<f64>,
    /// The value that the reading had to have, if it cannot be true.
    pub(super) instead: Option<f64>,
}

/// The state of the checks of one sensor: the three that every sensor has, and `OWN` of its kind.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sensor<const OWN: usize> {
    moved: SensorMotion,
    lost: Run,
    runs: ([Run; 3], [Run; OWN]),
    /// No check has failed in the last sample: nothing is being counted.
    quiet: bool,
}

/// The limits of a kind of sensor.
pub(super) trait Limits<const OWN: usize> {
    /// The limits that every sensor has.
    fn sensor(&self) -> &SensorFaultLimits;
    /// The faults that the checks of its kind find, after how many samples, and what they allow.
    fn own(&self) -> [(FaultCode, u16, Requirement); OWN];
    /// Whether a sample fails these checks.
    fn fails(&self, measured: f64) -> [bool; OWN];
}

impl<const OWN: usize> Sensor<OWN> {
    pub(super) fn new() -> Self {
        Self {
            moved: SensorMotion::never(),
            lost: Run(0),
            runs: ([Run(0); 3], [Run(0); OWN]),
            quiet: true,
        }
    }

    /// Judges a sample. One that is not finite, or not possible, does not count for the other checks.
    #[inline(always)]
    pub(super) fn update(
        &mut self,
        limits: &impl Limits<OWN>,
        sample: Sample,
        latch: &mut Latch<'_>,
    ) {
        let of_all = limits.sensor();
        let (measured, desired) = (sample.measured, sample.desired);
        let wanted = desired.unwrap_or(measured);
        if sample.instead.is_some() || !(is_finite(measured) && is_finite(wanted)) {
            return self.lose(of_all, sample, latch);
        }
        let stays = self.moved.stays(&of_all.stuck, desired, measured);
        let far = of_all.tracking.is_below(abs(wanted - measured));
        let fails = [of_all.range.excludes(measured), stays, far];
        let own = limits.fails(measured);
        // In most ticks none fails, and nothing is counted.
        let any = |all: &[bool]| all.iter().fold(false, |any, &fails| any | fails);
        if !self.quiet | any(&fails) | any(&own) {
            self.count(limits, (wanted, measured), fails, own, latch);
        }
    }

    /// Returns true if a check counts samples that fail.
    pub(super) fn is_counting(&self) -> bool {
        let (runs, own_runs) = &self.runs;
        let mut all = runs.iter().chain(own_runs);
        !self.lost.is_over() || all.any(|run| !run.is_over())
    }

    /// Returns true if a reading is where the sensor has been since it moved last.
    pub(super) fn stands(&self, stuck: &Stuck, measured: f64) -> bool {
        abs(measured - self.moved.there) <= stuck.band
    }

    /// Counts the checks that a sample fails, and ends the counts of the others.
    #[cold]
    fn count(
        &mut self,
        limits: &impl Limits<OWN>,
        (wanted, measured): (f64, f64),
        fails: [bool; 3],
        own: [bool; OWN],
        latch: &mut Latch<'_>,
    ) {
        self.lost = Run(0);
        let SensorFaultLimits {
            range,
            stuck,
            tracking,
            ..
        } = limits.sensor();
        let (travel, error) = (abs(wanted - self.moved.wanted), abs(wanted - measured));
        let in_range = Requirement::Within(range.low, range.high);
        let (most, farthest) = (stuck.travel, tracking.value);
        let checks = [
            (FaultCode::OutOfRange, range.samples, measured, in_range),
            (FaultCode::Stuck, stuck.samples, travel, AtMost(most)),
            (
                FaultCode::Tracking,
                tracking.samples,
                error,
                AtMost(farthest),
            ),
        ];
        let (runs, own_runs) = &mut self.runs;
        for ((run, (code, samples, value, allowed)), fails) in
            runs.iter_mut().zip(checks).zip(fails)
        {
            latch.report(code, run.reaches(samples, fails), value, allowed);
        }
        let own_checks = own_runs.iter_mut().zip(limits.own()).zip(own);
        for ((run, (code, samples, allowed)), fails) in own_checks {
            latch.report(code, run.reaches(samples, fails), measured, allowed);
        }
        self.quiet = runs.iter().chain(own_runs.iter()).all(|run| run.is_over());
    }

    /// Counts a sample that is not finite or not possible.
    #[cold]
    fn lose(&mut self, limits: &SensorFaultLimits, sample: Sample, latch: &mut Latch<'_>) {
        let Sample {
            measured, desired, ..
        } = sample;
        let wanted = desired.unwrap_or(measured);
        let possible = &limits.plausible;
        let away = abs(sample.instead.unwrap_or(wanted) - measured);
        let (code, value, allowed) = if !is_finite(measured) {
            (FaultCode::NotFinite, measured, Requirement::Finite)
        } else if !is_finite(wanted) {
            (FaultCode::NotFinite, wanted, Requirement::Finite)
        } else if self.stands(&limits.stuck, measured) && away > possible.travel {
            (FaultCode::Stuck, away, AtMost(possible.travel))
        } else {
            (FaultCode::Jump, away, AtMost(limits.reach(latch.seconds)))
        };
        let is_fault = self.lost.reaches(limits.lost_samples, true);
        latch.report(code, is_fault, value, allowed);
        self.quiet = false;
    }
}

impl SensorFaultLimits {
    /// Returns how far a reading can be from where its rate leads in so many seconds.
    pub(super) fn reach(&self, seconds: f64) -> f64 {
        self.plausible.rate_change * seconds + 2.0 * self.stuck.band
    }
}

/// The measured and the desired value when a sensor moved last.
#[derive(Clone, Copy, Debug)]
struct SensorMotion {
    /// NaN if it has never been seen, so that nothing is near it.
    there: f64,
    wanted: f64,
}

impl SensorMotion {
    fn never() -> Self {
        Self {
            there: f64::NAN,
            wanted: 0.0,
        }
    }

    /// Returns true if the sensor stays while its set-point has gone.
    #[inline]
    fn stays(&mut self, stuck: &Stuck, desired: Option<f64>, measured: f64) -> bool {
        let Some(desired) = desired else {
            *self = Self::never();
            return false;
        };
        if abs(measured - self.there) <= stuck.band {
            return abs(desired - self.wanted) > stuck.travel;
        }
        *self = Self {
            there: measured,
            wanted: desired,
        };
        false
    }
}
