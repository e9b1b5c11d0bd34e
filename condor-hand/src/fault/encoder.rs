//! [`Encoders`]: the checks of the sensors of actuators' positions.

use nalgebra::SVector;

use super::sensor::{Latch, Limits, Sample, Sensor};
use super::{
    EncoderFaultLimits, Fault, FaultCode, FaultPlace, FaultQuantity, Observation, SensorFaultLimits,
};
use crate::math::{abs, is_finite};
use crate::number::Requirement;

/// The checks of the sensors of actuators' positions.
///
/// [`Observation::lost`] tells which joints have readings that cannot be. If exactly one of the sensors from which such
/// a joint is computed shows what cannot be of its actuator, the reading of that sensor is the one that cannot be. If
/// several do, the joint itself has been moved or held.
#[derive(Clone, Copy, Debug)]
pub(super) struct Encoders<const A: usize>([Encoder; A]);

#[derive(Clone, Copy, Debug)]
struct Encoder {
    checks: Sensor<0>,
    /// The last reading that was believed, rad or m; NaN before the first one.
    last: f64,
    /// The time since then, s.
    away_s: f64,
}

impl<const A: usize> Encoders<A> {
    pub(super) fn new() -> Self {
        let checks = Sensor::new();
        let (last, away_s) = (f64::NAN, 0.0);
        Self(
            [Encoder {
                checks,
                last,
                away_s,
            }; A],
        )
    }

    /// Checks the readings of one tick. Returns a bit for each joint that is computed from a sensor whose checks fail.
    #[inline(never)]
    pub(super) fn update<const N: usize>(
        &mut self,
        limits: &[Option<EncoderFaultLimits>; A],
        seen: &Observation<'_, N, A>,
        seconds: f64,
        first: &mut Option<Fault>,
    ) -> u32 {
        for encoder in &mut self.0 {
            encoder.away_s += seconds;
        }
        let instead = if seen.lost == 0 {
            [None; A]
        } else {
            self.instead(limits, seen, seconds)
        };
        let samples = seen.actuator_positions.iter().zip(seen.arms).zip(instead);
        let encoders = self.0.iter_mut().zip(limits).zip(samples);
        let mut excused = 0;
        for (actuator, ((encoder, limits), ((&measured, arms), instead))) in encoders.enumerate() {
            let Some(limits) = limits else { continue };
            if instead.is_none() && is_finite(measured) {
                (encoder.last, encoder.away_s) = (measured, 0.0);
            }
            let sample = Sample {
                measured,
                desired: desired(arms, seen.desired_positions),
                instead,
            };
            let latch = &mut Latch {
                first,
                place: FaultPlace::Actuator(actuator),
                quantity: FaultQuantity::Position,
                seconds,
                is_excused: false,
            };
            encoder.checks.update(limits, sample, latch);
            if encoder.checks.is_counting() {
                excused |= limits.tells;
            }
        }
        excused
    }

    /// Returns the values that readings had to have that cannot be, when readings of joints are lost.
    #[cold]
    fn instead<const N: usize>(
        &self,
        limits: &[Option<EncoderFaultLimits>; A],
        seen: &Observation<'_, N, A>,
        seconds: f64,
    ) -> [Option<f64>; A] {
        // A sensor that jumps displaces other joints, so that one that stands may seem to be wrong.
        for kind in [Encoder::before_jump, Encoder::beyond_stop] {
            let mut instead = [None; A];
            let samples = seen.actuator_positions.iter().zip(seen.arms);
            let encoders = self.0.iter().zip(limits).zip(samples);
            let (mut once, mut twice) = (0, 0);
            for (instead, ((encoder, limits), (&measured, arms))) in
                instead.iter_mut().zip(encoders)
            {
                let Some(limits) = limits else { continue };
                let lost = limits.tells & seen.lost;
                if lost != 0 && is_finite(measured) {
                    let sums = [seen.rates, seen.believed].map(|all| along(arms, all));
                    *instead = kind(encoder, &limits.sensor, measured, sums, seconds);
                }
                if instead.is_some() {
                    twice |= once & lost;
                    once |= lost;
                }
            }
            for (instead, limits) in instead.iter_mut().zip(limits) {
                if limits.is_some_and(|limits| limits.tells & twice != 0) {
                    *instead = None;
                }
            }
            if once != 0 {
                return instead;
            }
        }
        [None; A]
    }
}

impl Encoder {
    /// Returns where the actuator went before the sensor jumped; `None` if it did not.
    fn before_jump(
        &self,
        limits: &SensorFaultLimits,
        measured: f64,
        [rate, _]: [f64; 2],
        seconds: f64,
    ) -> Option<f64> {
        let (moved, way) = (measured - self.last, rate * self.away_s);
        let reach = limits.reach(seconds);
        let has_jumped = abs(moved - way) > reach && abs(moved) > reach;
        has_jumped.then_some(self.last + way)
    }

    /// Returns where the actuator is by its joints while the sensor stands; `None` if the sensor is there.
    fn beyond_stop(
        &self,
        limits: &SensorFaultLimits,
        measured: f64,
        [_, believed]: [f64; 2],
        _: f64,
    ) -> Option<f64> {
        let is_away = abs(believed - measured) > limits.plausible.travel;
        let stands = self.checks.stands(&limits.stuck, measured);
        (stands && is_away).then_some(believed)
    }
}

/// The desired position of an actuator with these arms; `None` if the position of a joint that it moves is not
/// controlled.
fn desired<const N: usize>(arms: &[f64; N], joints: &[Option<f64>; N]) -> Option<f64> {
    let mut sum = 0.0;
    for (arm, joint) in arms.iter().zip(joints) {
        if *arm != 0.0 {
            sum += arm * (*joint)?;
        }
    }
    Some(sum)
}

/// The position or rate of an actuator with these arms, by those of its joints.
fn along<const N: usize>(arms: &[f64; N], joints: &SVector<f64, N>) -> f64 {
    let joints = arms.iter().zip(joints.as_slice());
    joints.fold(0.0, |sum, (arm, joint)| sum + arm * joint)
}

impl Limits<0> for EncoderFaultLimits {
    fn sensor(&self) -> &SensorFaultLimits {
        &self.sensor
    }

    fn own(&self) -> [(FaultCode, u16, Requirement); 0] {
        []
    }

    #[inline]
    fn fails(&self, _: f64) -> [bool; 0] {
        []
    }
}
