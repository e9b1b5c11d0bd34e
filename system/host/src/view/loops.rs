use std::time::Instant;

use condor_mbox::Processor;
use condor_mos::{Histogram, Statistics};
use serde::Serialize;

use super::{View, ViewError};
use condor_rt::loops::{self, LoopTimes};
use condor_rt::objects::ObjectKind;

/// The counts of all servo loops of a processor at one moment. [`since`](Self::since) computes rates from two samples.
#[derive(Clone, Debug)]
pub struct LoopSample {
    at: Instant,
    incarnation: u32,
    /// Whether runs take the time that is declared for them, and are not measured.
    simulated: bool,
    loops: Vec<(String, Statistics, LoopTimes)>,
}

/// The activity of a servo loop between two samples, or since the loop began: its rate, its run times, its lateness and
/// its overruns.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct LoopRates {
    /// The name of the loop in its processor.
    pub name: String,
    /// The rate that is set, in Hz.
    pub rate_hz: f64,
    /// The rate that was reached between the samples, or since the beginning, in Hz; `None` if
    /// there is only one sample.
    pub reached_hz: Option<f64>,
    /// The mean time of a run, µs: between the samples, or since the beginning; `None` in simulated
    /// time if no time is declared for the loop, since runs are not measured there.
    pub run_us: Option<f64>,
    /// The longest run since the loop began or its counts were reset, in µs; `None` as for
    /// `run_us`.
    pub worst_run_us: Option<f64>,
    /// The fraction of that time, 0 to 1, in which the loop ran; `None` as for `run_us`, or if there
    /// is only one sample.
    pub utilisation: Option<f64>,
    /// The longest time from a release to its start, since the loop began or its counts were reset,
    /// in µs.
    pub worst_lateness_us: f64,
    /// Percentiles of the times from releases to their starts, since the loop began or its counts were
    /// reset.
    pub lateness_percentiles_us: Percentiles,
    /// Percentiles of the times of runs, since the loop began or its counts were reset; `None` as for
    /// `run_us`.
    pub run_percentiles_us: Option<Percentiles>,
    /// The number of its runs since it began or its counts were reset; wraps.
    pub runs: u64,
    /// The number of overruns, releases that were skipped, since it began or its counts were reset;
    /// wraps.
    pub overruns: u64,
    /// Whether it is enabled, that is, released when it is due.
    pub enabled: bool,
    /// Whether it was disabled by an overrun or, where loops run in threads, by a panic.
    pub faulted: bool,
    /// Whether each release is computed when it is due, because the event table has no room for the rates
    /// of the processor's loops.
    pub computed: bool,
}

/// Percentiles of a measured time, in µs. Each is at most half longer than the exact one, and not longer than the
/// longest time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Percentiles {
    /// The time that 50 % of all do not exceed.
    pub p50: f64,
    /// The time that 99 % of all do not exceed.
    pub p99: f64,
    /// The time that 99.9 % of all do not exceed.
    pub p99_9: f64,
}

impl View {
    /// Reads the counts of the servo loops of `processor`, which its background publishes from time to time.
    ///
    /// # Errors
    /// [`ViewError::Mailbox`] if there is no such processor, [`ViewError::Memory`] if its memory
    /// cannot be read, [`ViewError::Version`] if the object table has another version.
    pub fn loops(&self, processor: Processor) -> Result<LoopSample, ViewError> {
        let region = self.region(processor)?;
        let mut found = Vec::new();
        for object in self.objects(processor, ObjectKind::Loop)? {
            let counts = loops::read(&region, &object);
            let counts = counts.map_err(|source| ViewError::Memory { processor, source })?;
            found.extend(counts.map(|(counts, times)| (object.name.to_string(), counts, times)));
        }
        Ok(LoopSample {
            at: Instant::now(),
            incarnation: self.heart(processor)?.incarnation,
            simulated: self.is_simulated(),
            loops: found,
        })
    }
}

impl LoopSample {
    /// Returns the activity of each loop between the sample `before` and this one. If `before` is `None` or belongs to
    /// an earlier run of the program, values that need two samples are `None`.
    ///
    /// The length of the time between the samples follows from the number of releases, which are at exact times, and
    /// not from the times of reading: the counts may have been published some time before. Only for a loop that was not
    /// released meanwhile is it the time between the two readings.
    #[must_use]
    pub fn since(&self, before: Option<&Self>) -> Vec<LoopRates> {
        let before = before.filter(|before| before.incarnation == self.incarnation);
        let rates = |(name, now, times): &(String, Statistics, LoopTimes)| {
            let earlier = before.and_then(|before| {
                let same = before.loops.iter().find(|(other, ..)| other == name)?;
                let releases = now.released.wrapping_sub(same.1.released);
                let seconds = match releases {
                    0 => self.at.duration_since(before.at).as_secs_f64(),
                    _ => float(releases) / now.rate.as_hz(),
                };
                Some((&same.1, seconds))
            });
            rates(name, (now, times), earlier, self.simulated)
        };
        self.loops.iter().map(rates).collect()
    }

    /// Returns the activity of each loop from its beginning to this sample.
    #[must_use]
    pub fn overall(&self) -> Vec<LoopRates> {
        let overall = |(name, counts, times): &(String, Statistics, LoopTimes)| {
            let seconds = float(counts.released) / counts.rate.as_hz();
            let beginning = beginning(counts);
            let since = Some((&beginning, seconds));
            rates(name, (counts, times), since, self.simulated)
        };
        self.loops.iter().map(overall).collect()
    }
}

/// The counts of a loop before its first release.
const fn beginning(counts: &Statistics) -> Statistics {
    Statistics {
        run: 0,
        total_run: 0,
        ..*counts
    }
}

#[allow(
    clippy::cast_precision_loss,
    reason = "2^53 ticks of a nanosecond are a hundred days of running"
)]
const fn float(count: u64) -> f64 {
    count as f64
}

fn rates(
    name: &str,
    (now, times): (&Statistics, &LoopTimes),
    before: Option<(&Statistics, f64)>,
    simulated: bool,
) -> LoopRates {
    let ticks_per_us = now.frequency.as_hz() / 1e6;
    let us = |ticks: u64| float(ticks) / ticks_per_us;
    let mean = |total: u64, runs: u64| {
        if runs == 0 {
            0.0
        } else {
            us(total) / float(runs)
        }
    };
    let since = before.filter(|(_, seconds)| *seconds > 0.0);
    let since = since.map(|(before, seconds)| {
        let runs = now.run.wrapping_sub(before.run);
        let total = now.total_run.saturating_sub(before.total_run);
        (runs, total, seconds)
    });
    let run_us = match since {
        Some((runs, total, _)) if runs > 0 => mean(total, runs),
        _ => mean(now.total_run, now.run),
    };
    let has_times = !simulated || now.worst_run > 0;
    let percentiles = |of: &Histogram, longest: u32| {
        let at = |percent| us(of.percentile(percent).min(longest).into());
        Percentiles {
            p50: at(50.0),
            p99: at(99.0),
            p99_9: at(99.9),
        }
    };
    let utilisation = since.map(|(_, total, seconds)| us(total) / 1e6 / seconds);
    LoopRates {
        name: name.into(),
        rate_hz: now.rate.as_hz(),
        reached_hz: since.map(|(runs, _, seconds)| float(runs) / seconds),
        run_us: has_times.then_some(run_us),
        worst_run_us: has_times.then(|| us(now.worst_run.into())),
        utilisation: utilisation.filter(|_| has_times),
        worst_lateness_us: us(now.worst_lateness.into()),
        lateness_percentiles_us: percentiles(&times.lateness, now.worst_lateness),
        run_percentiles_us: has_times.then(|| percentiles(&times.runs, now.worst_run)),
        runs: now.run,
        overruns: now.skipped,
        enabled: now.enabled,
        faulted: now.faulted,
        computed: now.computed,
    }
}

#[cfg(test)]
mod tests {
    use condor_mos::Rate;

    use super::*;

    fn counts(run: u64, total_run: u64) -> Statistics {
        Statistics {
            rate: Rate::hz(400),
            frequency: Rate::hz(1_000_000_000),
            enabled: true,
            faulted: false,
            computed: false,
            released: run,
            run,
            skipped: 3,
            running: 0,
            pending: 0,
            worst_lateness: 52_000,
            worst_run: 80_000,
            total_run,
            released_before: 0,
            total_before: 0,
        }
    }

    fn times() -> LoopTimes {
        let mut classes = [0; 64];
        // 32 768 to 49 151 ns, and 49 152 to 65 535 ns.
        (classes[30], classes[31]) = (99, 1);
        let lateness = Histogram::new(classes);
        LoopTimes {
            lateness,
            runs: lateness,
        }
    }

    #[test]
    fn percentiles_are_ends_of_classes_and_not_above_the_longest() {
        let rates = rates("servo", (&counts(100, 0), &times()), None, false);
        let Percentiles { p50, p99, p99_9 } = rates.lateness_percentiles_us;
        let p99_9_run = rates.run_percentiles_us.unwrap().p99_9;
        let seen = [p50, p99, p99_9, p99_9_run].map(|us| us.to_string());
        assert_eq!(seen, ["49.151", "49.151", "52", "65.535"]);
    }

    #[test]
    fn rates_are_those_between_two_samples_also_where_counts_wrap() {
        let before = counts(u64::MAX - 99, 1_000_000);
        let now = counts(300, 21_000_000);
        let rates = rates("servo", (&now, &times()), Some((&before, 1.0)), false);
        assert_eq!(rates.reached_hz, Some(400.0));
        assert_eq!(rates.run_us, Some(50.0));
        assert_eq!(rates.utilisation, Some(0.02));
        assert_eq!(rates.worst_run_us, Some(80.0));
        assert_eq!(Some(rates.worst_lateness_us), Some(52.0));
    }

    #[test]
    fn in_simulated_time_there_are_only_declared_times() {
        let declared = counts(300, 15_000_000);
        let undeclared = Statistics {
            worst_run: 0,
            total_run: 0,
            worst_lateness: 0,
            ..declared
        };
        let since = |counts: &Statistics| {
            rates(
                "servo",
                (counts, &times()),
                Some((&beginning(counts), 1.0)),
                true,
            )
        };
        let measured = |rates: LoopRates| (rates.run_us, rates.worst_run_us, rates.utilisation);
        let all = (Some(50.0), Some(80.0), Some(0.015));
        assert_eq!(measured(since(&declared)), all);
        assert_eq!(measured(since(&undeclared)), (None, None, None));
        assert_eq!(since(&undeclared).reached_hz, Some(300.0));
    }

    #[test]
    fn the_overall_rate_is_less_by_what_was_skipped() {
        let sample = LoopSample {
            at: Instant::now(),
            incarnation: 1,
            simulated: false,
            loops: vec![("servo".into(), counts(300, 15_000_000), times())],
        };
        let mut skipping = sample.clone();
        skipping.loops[0].1.released = 400;
        assert_eq!(sample.overall()[0].reached_hz, Some(400.0));
        assert_eq!(skipping.overall()[0].reached_hz, Some(300.0));
        assert_eq!(skipping.overall()[0].utilisation, Some(0.015));
    }

    #[test]
    fn the_time_between_samples_is_that_of_the_releases() {
        let sample = |released, run| {
            let mut counts = counts(run, 1000);
            counts.released = released;
            LoopSample {
                at: Instant::now(),
                incarnation: 1,
                simulated: false,
                loops: vec![("servo".into(), counts, times())],
            }
        };
        let before = sample(u64::MAX - 99, 900);
        let rates = sample(100, 1090).since(Some(&before));
        assert_eq!(rates[0].reached_hz, Some(380.0));
        // Nothing ran, and nothing was due.
        let rates = before.clone().since(Some(&before));
        assert_eq!(rates[0].reached_hz, None);
        std::thread::sleep(std::time::Duration::from_millis(1));
        let rates = sample(u64::MAX - 99, 900).since(Some(&before));
        assert_eq!(rates[0].reached_hz, Some(0.0));
    }

    #[test]
    fn nothing_is_said_across_a_restart() {
        let sample = |incarnation, run| LoopSample {
            at: Instant::now(),
            incarnation,
            simulated: false,
            loops: vec![("servo".into(), counts(run, 1000), times())],
        };
        let (old, new) = (sample(1, 4000), sample(2, 10));
        let rates = new.since(Some(&old));
        assert_eq!(rates.first().unwrap().reached_hz, None);
        let other = sample(2, 20);
        assert!(
            other
                .since(Some(&new))
                .first()
                .unwrap()
                .reached_hz
                .is_some()
        );
    }
}
