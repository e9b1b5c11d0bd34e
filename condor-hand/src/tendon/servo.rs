use crate::control::Integrator;
use crate::control::elapsed::{Elapsed, sum_is_finite};
use crate::math::{Real, clamp, is_finite};
use crate::number::{NumberError, not_negative, period, positive};

/// The gains of the servo that keeps a tendon at its desired tension.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TensionGains<T> {
    /// The gain of the error, N/N; it moves the pole of a first-order actuator from f to f (1 +
    /// kt).
    #[serde(default)]
    pub kt: T,
    /// The gain of the error's integral, 1/s.
    #[serde(default)]
    pub ki: T,
    /// The gain of the error's rate, s.
    #[serde(default)]
    pub kd: T,
    /// The gain of the rate of the tendon's length, N s/m; it damps the motion of the joint.
    #[serde(default)]
    pub kv: T,
}

/// The tension servos of L tendons side by side. The actuators follow commands in newtons; each command is the desired
/// tension plus a feedback of the tension error.
///
/// The command is `u = f + kt e + ki ∫ e dt + kd de/dt - kv ld`, with the desired tension f, the error
/// `e = f - measured` and the rate ld of the tendon's length. It is limited to 0..=`max_n`, since an actuator cannot
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
pub struct TensionServos<T: Real, const L: usize> {
    kt: [T; L],
    ki: [T; L],
    kd: [T; L],
    kv: [T; L],
    max_n: T,
    sample_hz: T,
    /// The integral terms, N.
    term: [T; L],
    desired: [T; L],
    last_error: [T; L],
    /// Whether there is such an error.
    has_last: [bool; L],
}

impl<T: Real, const L: usize> TensionServos<T, L> {
    /// Makes servos with these gains, whose integrals are zero. Commands are at most `max_n` (N),
    /// and `sample_hz` is the number of calls of [`update`](Self::update) per second.
    ///
    /// # Errors
    /// [`NumberError`] for the first value that is negative or not finite.
    pub fn new(gains: [TensionGains<T>; L], max_n: T, sample_hz: T) -> Result<Self, NumberError> {
        positive("the largest tension, N,", max_n)?;
        period(sample_hz)?;
        let none = [T::zero(); L];
        let mut servos = Self {
            kt: none,
            ki: none,
            kd: none,
            kv: none,
            max_n,
            sample_hz,
            term: none,
            desired: none,
            last_error: none,
            has_last: [false; L],
        };
        servos.set_gains(gains)?;
        Ok(servos)
    }

    /// Changes the gains of all servos. The integral terms of the commands stay.
    ///
    /// # Errors
    /// [`NumberError`] for the first gain that is negative or not finite; all gains stay then.
    pub fn set_gains(&mut self, gains: [TensionGains<T>; L]) -> Result<(), NumberError> {
        for TensionGains { kt, ki, kd, kv } in gains {
            not_negative("the gain kt", kt)?;
            not_negative("the gain ki", ki)?;
            not_negative("the gain kd", kd)?;
            not_negative("the gain kv", kv)?;
        }
        self.kt = gains.map(|gains| gains.kt);
        self.ki = gains.map(|gains| gains.ki);
        self.kd = gains.map(|gains| gains.kd);
        self.kv = gains.map(|gains| gains.kv);
        Ok(())
    }

    /// Sets all integral terms to zero, and forgets the last errors.
    pub fn reset(&mut self) {
        self.term = [T::zero(); L];
        self.has_last = [false; L];
    }

    /// Runs one tick of all servos, and returns the commands of the actuators, 0..=`max_n` in N.
    /// `desired` and `measured` are tensions in N, and `length_rate` are the rates of the tendons'
    /// lengths in m/s.
    #[inline]
    pub fn update(&mut self, desired: &[T; L], measured: &[T; L], length_rate: &[T; L]) -> [T; L] {
        let elapsed = Elapsed::new(T::one() / self.sample_hz, self.sample_hz);
        self.update_after(desired, measured, length_rate, elapsed)
    }

    /// The same for samples so long after the last ones.
    #[inline(always)]
    #[allow(clippy::needless_bitwise_bool, reason = "lanes have no branches")]
    pub(crate) fn update_after(
        &mut self,
        asked: &[T; L],
        measured: &[T; L],
        length_rate: &[T; L],
        elapsed: Elapsed<T>,
    ) -> [T; L] {
        let (zero, max_n) = (T::zero(), self.max_n);
        let mut next = *self;
        let mut command = [zero; L];
        let mut test = [zero; L];
        for i in 0..L {
            let term = self.term[i];
            let desired = clamp(asked[i], zero, max_n);
            let error = desired - measured[i];
            let rate = (error - self.last_error[i]) * elapsed.hz * elapsed.weight;
            let damping = self.kv[i] * length_rate[i];
            let rest = desired + self.kt[i] * error + self.kd[i] * rate - damping;
            let increment = self.ki[i] * error * elapsed.seconds;
            let moved = clamp(term + increment, -max_n, max_n);
            let output = rest + moved;
            let winds_up = ((output > max_n) & (moved > term)) | ((output < zero) & (moved < term));
            next.term[i] = if winds_up { term } else { moved };
            next.desired[i] = desired;
            next.last_error[i] = error;
            command[i] = clamp(output, zero, max_n);
            // This sum is not finite if a value above is not.
            test[i] = asked[i] + increment + output;
        }
        if !(self.has_last.iter().all(|&has| has) && sum_is_finite(&test)) {
            return self.update_each(asked, measured, length_rate, elapsed);
        }
        self.term = next.term;
        self.desired = next.desired;
        self.last_error = next.last_error;
        command
    }

    /// The same, one by one.
    #[cold]
    #[inline(never)]
    fn update_each(
        &mut self,
        asked: &[T; L],
        measured: &[T; L],
        length_rate: &[T; L],
        elapsed: Elapsed<T>,
    ) -> [T; L] {
        let zero = T::zero();
        let mut command = [zero; L];
        for i in 0..L {
            if is_finite(asked[i]) {
                self.desired[i] = clamp(asked[i], zero, self.max_n);
            }
            let (mut error, mut rate, mut damping) = (zero, zero, zero);
            if is_finite(length_rate[i]) {
                damping = self.kv[i] * length_rate[i];
            }
            if is_finite(measured[i]) {
                error = self.desired[i] - measured[i];
                if self.has_last[i] {
                    rate = (error - self.last_error[i]) * elapsed.hz * elapsed.weight;
                }
                self.last_error[i] = error;
            }
            self.has_last[i] = is_finite(measured[i]);
            let rest = self.desired[i] + self.kt[i] * error + self.kd[i] * rate - damping;
            let increment = self.ki[i] * error * elapsed.seconds;
            let mut integrator = Integrator::at(self.term[i], self.max_n);
            let output = integrator.update(rest, increment, zero, self.max_n);
            // Products of huge numbers can still overflow; then the actuator gets the open loop.
            command[i] = output.unwrap_or(self.desired[i]);
            self.term[i] = integrator.term();
        }
        command
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn servos_side_by_side_answer_as_one_by_one() {
        let gains = |kt, ki, kd, kv| TensionGains { kt, ki, kd, kv };
        let gains = [gains(2.0, 30.0, 1e-3, 5.0), gains(1.0, 0.0, 0.0, 0.0)];
        let mut both = TensionServos::new(gains, 100.0, 400.0).unwrap();
        let awkward = [
            f64::NAN,
            f64::INFINITY,
            f64::NEG_INFINITY,
            f64::MAX,
            -0.0,
            f64::MIN_POSITIVE,
        ];
        let value = |tick: usize, salt: usize| {
            if tick % 13 == salt {
                awkward[tick / 13 % 6]
            } else {
                f64::from(u8::try_from(tick * (salt + 7) % 251).unwrap()) - 40.0
            }
        };
        for tick in 0..2000 {
            match tick {
                500 => both.reset(),
                1000 => both.set_gains([gains[1]; 2]).unwrap(),
                _ => {}
            }
            let pair = |salt| [value(tick, salt), value(tick, salt + 1)];
            let (desired, measured, rate) = (pair(0), pair(2), pair(4));
            let elapsed = Elapsed::new([1.0, 0.9, 3.0][tick % 3] / 400.0, 400.0);
            let mut alone = both;
            let expected = alone.update_each(&desired, &measured, &rate, elapsed);
            let together = both.update_after(&desired, &measured, &rate, elapsed);
            assert_eq!(together.map(f64::to_bits), expected.map(f64::to_bits));
            assert_eq!(both.term.map(f64::to_bits), alone.term.map(f64::to_bits));
            assert_eq!(
                (both.desired, both.has_last),
                (alone.desired, alone.has_last)
            );
        }
    }
}
