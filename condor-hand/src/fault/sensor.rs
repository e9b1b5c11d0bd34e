use super::{FaultCode, FaultRange, FaultSite, FingerFault, SensorFaultLimits, Stuck, Threshold};
use crate::math::{abs, is_finite};

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

/// The site that is checked, and the first fault of all sites, which stays.
pub(super) struct Latch<'a> {
    pub(super) first: &'a mut Option<FingerFault>,
    pub(super) site: FaultSite,
}

impl Latch<'_> {
    pub(super) fn report(&mut self, code: FaultCode, is_fault: bool, value: f64) {
        if is_fault && self.first.is_none() {
            let (site, value) = (self.site, value);
            *self.first = Some(FingerFault { code, site, value });
        }
    }
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
    /// The faults that the checks of its kind find, and after how many samples.
    fn own(&self) -> [(FaultCode, u16); OWN];
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
        desired: Option<f64>,
        (measured, is_possible): (f64, bool),
        latch: &mut Latch<'_>,
    ) {
        let of_all = limits.sensor();
        let wanted = desired.unwrap_or(measured);
        if !(is_possible && is_finite(measured) && is_finite(wanted)) {
            return self.lose(of_all, wanted, measured, latch);
        }
        let stays = self.moved.stays(&of_all.stuck, desired, measured);
        let error = wanted - measured;
        let far = of_all.tracking.is_below(abs(error));
        let fails = [of_all.range.excludes(measured), stays, far];
        let own = limits.fails(measured);
        // In most ticks none fails, and nothing is counted.
        let any = |all: &[bool]| all.iter().fold(false, |any, &fails| any | fails);
        if !self.quiet | any(&fails) | any(&own) {
            self.count(limits, [measured, measured, error], fails, own, latch);
        }
    }

    /// Counts the checks that a sample fails, and ends the counts of the others.
    #[cold]
    fn count(
        &mut self,
        limits: &impl Limits<OWN>,
        values: [f64; 3],
        fails: [bool; 3],
        own: [bool; OWN],
        latch: &mut Latch<'_>,
    ) {
        self.lost = Run(0);
        let (of_all, [measured, ..]) = (limits.sensor(), values);
        let checks = [
            (FaultCode::OutOfRange, of_all.range.samples),
            (FaultCode::Stuck, of_all.stuck.samples),
            (FaultCode::Tracking, of_all.tracking.samples),
        ];
        let (runs, own_runs) = &mut self.runs;
        for (((run, (code, samples)), fails), value) in
            runs.iter_mut().zip(checks).zip(fails).zip(values)
        {
            latch.report(code, run.reaches(samples, fails), value);
        }
        for ((run, (code, samples)), fails) in own_runs.iter_mut().zip(limits.own()).zip(own) {
            latch.report(code, run.reaches(samples, fails), measured);
        }
        self.quiet = runs.iter().chain(own_runs.iter()).all(|run| run.is_over());
    }

    /// Counts a sample that is not finite or not possible.
    #[cold]
    fn lose(
        &mut self,
        limits: &SensorFaultLimits,
        wanted: f64,
        measured: f64,
        latch: &mut Latch<'_>,
    ) {
        let (code, value) = if !is_finite(measured) {
            (FaultCode::NotFinite, measured)
        } else if !is_finite(wanted) {
            (FaultCode::NotFinite, wanted)
        } else if abs(measured - self.moved.there) <= limits.stuck.band {
            (FaultCode::Stuck, measured)
        } else {
            (FaultCode::Jump, measured)
        };
        latch.report(code, self.lost.reaches(limits.lost_samples, true), value);
        self.quiet = false;
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
