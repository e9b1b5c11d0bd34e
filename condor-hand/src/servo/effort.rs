use crate::control::Integrator;
use crate::control::elapsed::Elapsed;
use crate::math::{clamp, is_finite, max};
use crate::number::{NumberError, not_negative, period};
use crate::transmission::EffortLimits;

/// The gains of the servo that keeps an actuator at its desired effort.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EffortGains {
    /// The gain of the error, N/N or N m/N m; it moves the pole of a first-order actuator from f to f (1 + kp).
    #[serde(default)]
    pub kp: f64,
    /// The gain of the error's integral, 1/s.
    #[serde(default)]
    pub ki: f64,
    /// The gain of the error's rate, s.
    #[serde(default)]
    pub kd: f64,
    /// The gain of the actuator's own rate, N s/m or N m s/rad; it damps the motion of the joints.
    #[serde(default)]
    pub kv: f64,
}

/// The effort servos of A actuators side by side. The actuators follow commands in newtons or newton metres; each
/// command is the desired effort plus a feedback of its error.
///
/// The command is `u = f + kp e + ki ∫ e dt + kd de/dt - kv v`, with the desired effort f, the error
/// `e = f - measured` and the [rate](crate::transmission::Linear::actuators) v of the actuator. It stays within the
/// [range](EffortLimits::command_range) of the actuator's commands; one that pulls a tendon cannot push. The integral
/// does not wind up while the command is at a limit. The rate of the error is the difference of two samples; filter
/// noise before the servo.
///
/// With a first-order actuator that holds its command for a sample, `a = exp(-2 pi f / fs)`, the closed loop has its
/// pole at `a - kp (1 - a)`: it is stable for `kp < (1 + a) / (1 - a)`. With one sample of delay the characteristic is
/// `z² - a z + kp (1 - a)`, stable for `kp < 1 / (1 - a)`.
///
/// A value that is not finite has no effect on the output: a desired effort is replaced by the last finite one;
/// without a measured effort only the integral's part of the feedback remains; without a rate of the actuator there is
/// no damping.
#[derive(Clone, Copy, Debug)]
pub struct EffortServos<const A: usize> {
    gains: [EffortGains; A],
    /// The least and the greatest commands, N or N m.
    ranges: [(f64, f64); A],
    sample_hz: f64,
    /// The integral terms, N or N m.
    integrals: [Integrator; A],
    desired: [f64; A],
    last_error: [f64; A],
    /// Whether there is such an error.
    has_last: [bool; A],
}

impl<const A: usize> EffortServos<A> {
    /// Makes servos with these gains, whose integrals are zero, for actuators with these limits (N, or N m).
    /// `sample_hz` is the number of calls of [`update`](Self::update) per second.
    ///
    /// # Errors
    /// [`NumberError`] for the first value that is negative or not finite.
    pub fn new(
        gains: [EffortGains; A],
        limits: &[EffortLimits; A],
        sample_hz: f64,
    ) -> Result<Self, NumberError> {
        let mut integrals = [Integrator::new(1.0)?; A];
        let ranges = limits.map(|limits| limits.command_range());
        for (integral, &(low, high)) in integrals.iter_mut().zip(&ranges) {
            *integral = Integrator::new(max(-low, high))?;
        }
        period(sample_hz)?;
        check(&gains)?;
        Ok(Self {
            gains,
            ranges,
            sample_hz,
            integrals,
            desired: [0.0; A],
            last_error: [0.0; A],
            has_last: [false; A],
        })
    }

    /// Returns the gains of all servos.
    #[must_use]
    pub const fn gains(&self) -> &[EffortGains; A] {
        &self.gains
    }

    /// Changes the gains of all servos. The integral terms of the commands stay.
    ///
    /// # Errors
    /// [`NumberError`] for the first gain that is negative or not finite; all gains stay then.
    pub fn set_gains(&mut self, gains: [EffortGains; A]) -> Result<(), NumberError> {
        check(&gains)?;
        self.gains = gains;
        Ok(())
    }

    /// Sets all integral terms to zero, and forgets the last errors.
    pub fn reset(&mut self) {
        for integral in &mut self.integrals {
            integral.set(0.0);
        }
        self.has_last = [false; A];
    }

    /// Runs one tick of all servos, and returns the commands of the actuators, N or N m. `desired` and `measured` are
    /// efforts, N or N m, and `rate` are the rates of the actuators, m/s or rad/s.
    pub fn update(&mut self, desired: &[f64; A], measured: &[f64; A], rate: &[f64; A]) -> [f64; A] {
        self.update_after(desired, measured, rate, Elapsed::period(self.sample_hz), A)
    }

    /// The same for samples so long after the last ones, and for the first `count` actuators. The commands of the others
    /// are zero.
    #[inline(always)]
    pub(crate) fn update_after(
        &mut self,
        asked: &[f64; A],
        measured: &[f64; A],
        rate: &[f64; A],
        elapsed: Elapsed,
        count: usize,
    ) -> [f64; A] {
        let mut command = [0.0; A];
        for i in 0..count.min(A) {
            let EffortGains { kp, ki, kd, kv } = self.gains[i];
            let (low, high) = self.ranges[i];
            let is_measured = is_finite(measured[i]);
            if is_finite(asked[i]) {
                self.desired[i] = clamp(asked[i], low, high);
            }
            let desired = self.desired[i];
            let error = if is_measured {
                desired - measured[i]
            } else {
                0.0
            };
            let slope = if is_measured && self.has_last[i] {
                (error - self.last_error[i]) * elapsed.hz * elapsed.weight
            } else {
                0.0
            };
            (self.last_error[i], self.has_last[i]) = (error, is_measured);
            let damping = if is_finite(rate[i]) {
                kv * rate[i]
            } else {
                0.0
            };
            let rest = desired + kp * error + kd * slope - damping;
            let increment = ki * error * elapsed.seconds;
            let output = self.integrals[i].update(rest, increment, low, high);
            // Products of huge numbers can still overflow; then the actuator gets the open loop.
            command[i] = output.unwrap_or(desired);
        }
        command
    }
}

fn check(gains: &[EffortGains]) -> Result<(), NumberError> {
    for &EffortGains { kp, ki, kd, kv } in gains {
        not_negative("the gain kp", kp)?;
        not_negative("the gain ki", ki)?;
        not_negative("the gain kd", kd)?;
        not_negative("the gain kv", kv)?;
    }
    Ok(())
}
