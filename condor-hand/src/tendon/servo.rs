use crate::control::Integrator;
use crate::control::bank::Elapsed;
use crate::math::{Real, clamp, is_finite};
use crate::number::{NumberError, not_negative, period, positive};

/// The gains of a [`TensionServo`].
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

/// The servo of one tendon, whose actuator itself follows commands in newtons. The command is the
/// desired tension plus a feedback of the error.
///
/// `u = f + kt e + ki ∫ e dt + kd de/dt - kv ld`, with `e = f - measured` and the rate ld of the
/// tendon's length, limited to 0..=`max_n`, since an actuator cannot push. The integral does not
/// wind up while the command is at a limit. The rate of the error is the difference of two samples;
/// filter noise before the servo.
///
/// With a first-order actuator that holds its command for a sample, `a = exp(-2 pi f / fs)`, the
/// closed loop has its pole at `a - kt (1 - a)`: it is stable for `kt < (1 + a) / (1 - a)`. With one
/// sample of delay the characteristic is `z² - a z + kt (1 - a)`, stable for `kt < 1 / (1 - a)`.
///
/// A value that is not finite has no effect on the output: a desired tension is replaced by the
/// last finite one; without a measured tension only the integral's part of the feedback remains;
/// without a rate of the length there is no damping.
#[derive(Clone, Copy, Debug)]
pub struct TensionServo<T: Real = f64> {
    pub(super) gains: TensionGains<T>,
    pub(super) integrator: Integrator<T>,
    pub(super) max_n: T,
    period: T,
    sample_hz: T,
    pub(super) desired: T,
    pub(super) last_error: Option<T>,
}

impl<T: Real> TensionServo<T> {
    /// Makes a servo at rest, with commands up to `max_n` newtons, `sample_hz` times a second.
    ///
    /// # Errors
    /// [`NumberError`] for the first value that is negative or not finite.
    pub fn new(gains: TensionGains<T>, max_n: T, sample_hz: T) -> Result<Self, NumberError> {
        positive("the largest tension, N,", max_n)?;
        let mut servo = Self {
            gains,
            integrator: Integrator::new(max_n)?,
            max_n,
            period: period(sample_hz)?,
            sample_hz,
            desired: T::zero(),
            last_error: None,
        };
        servo.set_gains(gains)?;
        Ok(servo)
    }

    /// Changes the gains; the integral's part of the command stays.
    ///
    /// # Errors
    /// [`NumberError`] for the first gain that is negative or not finite; all gains stay
    /// then.
    pub fn set_gains(&mut self, gains: TensionGains<T>) -> Result<(), NumberError> {
        let TensionGains { kt, ki, kd, kv } = gains;
        not_negative("the gain kt", kt)?;
        not_negative("the gain ki", ki)?;
        not_negative("the gain kd", kd)?;
        not_negative("the gain kv", kv)?;
        self.gains = gains;
        Ok(())
    }

    /// Returns the command in newtons, 0..=`max_n`, for a desired and a measured tension in newtons
    /// and the rate of the tendon's length in m/s.
    #[inline]
    pub fn update(&mut self, desired: T, measured: T, length_rate: T) -> T {
        let elapsed = Elapsed::new(self.period, self.sample_hz);
        self.update_after(desired, measured, length_rate, elapsed)
    }

    /// The same for samples so long after the last ones.
    #[inline]
    pub(super) fn update_after(
        &mut self,
        desired: T,
        measured: T,
        length_rate: T,
        elapsed: Elapsed<T>,
    ) -> T {
        let zero = T::zero();
        if is_finite(desired) {
            self.desired = clamp(desired, zero, self.max_n);
        }
        let TensionGains { kt, ki, kd, kv } = self.gains;
        let damping = if is_finite(length_rate) {
            kv * length_rate
        } else {
            zero
        };
        let (error, rate) = if is_finite(measured) {
            let error = self.desired - measured;
            let rate = self
                .last_error
                .map_or(zero, |last| (error - last) * elapsed.hz * elapsed.weight);
            self.last_error = Some(error);
            (error, rate)
        } else {
            self.last_error = None;
            (zero, zero)
        };
        let rest = self.desired + kt * error + kd * rate - damping;
        let increment = ki * error * elapsed.seconds;
        // Products of huge numbers can still overflow; then the actuator gets the open loop.
        self.integrator
            .update(rest, increment, zero, self.max_n)
            .unwrap_or(self.desired)
    }

    /// Empties the integral, and forgets the last error.
    pub fn reset(&mut self) {
        self.integrator.set(T::zero());
        self.last_error = None;
    }
}
