use crate::control::Integrator;
use crate::control::elapsed::Elapsed;
use crate::math::{clamp, is_finite};
use crate::number::{NumberError, not_negative, period, positive};

/// The gains of the servo that keeps a tendon at its desired tension.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TensionGains {
    /// The gain of the error, N/N; it moves the pole of a first-order actuator from f to f (1 +
    /// kt).
    #[serde(default)]
    pub kt: f64,
    /// The gain of the error's integral, 1/s.
    #[serde(default)]
    pub ki: f64,
    /// The gain of the error's rate, s.
    #[serde(default)]
    pub kd: f64,
    /// The gain of the rate of the tendon's length, N s/m; it damps the motion of the joint.
    #[serde(default)]
    pub kv: f64,
}

/// The tension servos of L tendons side by side. The actuators follow commands in newtons; each command is the desired
/// tension plus a feedback of the tension error.
///
/// The command is `u = f + kt e + ki ∫ e dt + kd de/dt - kv ld`, with the desired tension f, the error
/// `e = f - measured` and the rate ld of the tendon's length. It is limited to 0..=`greatest`, since an actuator cannot
/// push. The integral does not wind up while the command is at a limit. The rate of the error is the difference of two
/// samples; filter noise before the servo.
///
/// With a first-order actuator that holds its command for a sample, `a = exp(-2 pi f / fs)`, the closed loop has its
/// pole at `a - kt (1 - a)`: it is stable for `kt < (1 + a) / (1 - a)`. With one sample of delay the characteristic is
/// `z² - a z + kt (1 - a)`, stable for `kt < 1 / (1 - a)`.
///
/// A value that is not finite has no effect on the output: a desired tension is replaced by the last finite one;
/// without a measured tension only the integral's part of the feedback remains; without a rate of the length there is
/// no damping.
#[derive(Clone, Copy, Debug)]
pub struct TensionServos<const L: usize> {
    gains: [TensionGains; L],
    greatest: [f64; L],
    sample_hz: f64,
    /// The integral terms, N.
    integrals: [Integrator; L],
    desired: [f64; L],
    last_error: [f64; L],
    /// Whether there is such an error.
    has_last: [bool; L],
}

impl<const L: usize> TensionServos<L> {
    /// Makes servos with these gains, whose integrals are zero. Commands are at most `greatest` (N),
    /// and `sample_hz` is the number of calls of [`update`](Self::update) per second.
    ///
    /// # Errors
    /// [`NumberError`] for the first value that is negative or not finite.
    pub fn new(
        gains: [TensionGains; L],
        greatest: [f64; L],
        sample_hz: f64,
    ) -> Result<Self, NumberError> {
        let mut integrals = [Integrator::new(1.0)?; L];
        for (integral, &greatest) in integrals.iter_mut().zip(&greatest) {
            positive("the largest tension, N,", greatest)?;
            *integral = Integrator::new(greatest)?;
        }
        period(sample_hz)?;
        check(&gains)?;
        Ok(Self {
            gains,
            greatest,
            sample_hz,
            integrals,
            desired: [0.0; L],
            last_error: [0.0; L],
            has_last: [false; L],
        })
    }

    /// Changes the gains of all servos. The integral terms of the commands stay.
    ///
    /// # Errors
    /// [`NumberError`] for the first gain that is negative or not finite; all gains stay then.
    pub fn set_gains(&mut self, gains: [TensionGains; L]) -> Result<(), NumberError> {
        check(&gains)?;
        self.gains = gains;
        Ok(())
    }

    /// Sets all integral terms to zero, and forgets the last errors.
    pub fn reset(&mut self) {
        for integral in &mut self.integrals {
            integral.set(0.0);
        }
        self.has_last = [false; L];
    }

    /// Runs one tick of all servos, and returns the commands of the actuators, 0..=`greatest` in N.
    /// `desired` and `measured` are tensions in N, and `length_rate` are the rates of the tendons'
    /// lengths in m/s.
    pub fn update(
        &mut self,
        desired: &[f64; L],
        measured: &[f64; L],
        length_rate: &[f64; L],
    ) -> [f64; L] {
        self.update_after(
            desired,
            measured,
            length_rate,
            Elapsed::period(self.sample_hz),
        )
    }

    /// The same for samples so long after the last ones.
    #[inline(always)]
    pub(crate) fn update_after(
        &mut self,
        asked: &[f64; L],
        measured: &[f64; L],
        length_rate: &[f64; L],
        elapsed: Elapsed,
    ) -> [f64; L] {
        let mut command = [0.0; L];
        for i in 0..L {
            let TensionGains { kt, ki, kd, kv } = self.gains[i];
            let is_measured = is_finite(measured[i]);
            if is_finite(asked[i]) {
                self.desired[i] = clamp(asked[i], 0.0, self.greatest[i]);
            }
            let desired = self.desired[i];
            let error = if is_measured {
                desired - measured[i]
            } else {
                0.0
            };
            let rate = if is_measured && self.has_last[i] {
                (error - self.last_error[i]) * elapsed.hz * elapsed.weight
            } else {
                0.0
            };
            (self.last_error[i], self.has_last[i]) = (error, is_measured);
            let damping = if is_finite(length_rate[i]) {
                kv * length_rate[i]
            } else {
                0.0
            };
            let rest = desired + kt * error + kd * rate - damping;
            let increment = ki * error * elapsed.seconds;
            let output = self.integrals[i].update(rest, increment, 0.0, self.greatest[i]);
            // Products of huge numbers can still overflow; then the actuator gets the open loop.
            command[i] = output.unwrap_or(desired);
        }
        command
    }
}

fn check(gains: &[TensionGains]) -> Result<(), NumberError> {
    for &TensionGains { kt, ki, kd, kv } in gains {
        not_negative("the gain kt", kt)?;
        not_negative("the gain ki", ki)?;
        not_negative("the gain kd", kd)?;
        not_negative("the gain kv", kv)?;
    }
    Ok(())
}
