use crate::config;
use crate::control::elapsed::Elapsed;
use crate::control::{Derivative, Integrator};
use crate::math::{clamp, is_finite};
use crate::number::{NumberError, not_negative, period};
use crate::trajectory::SetPoint;

/// The servo of one axis of the table: `kp e + kv de/dt + ki ∫ e dt` with the position error e,
/// plus the force that the desired velocity v and acceleration a need, `mass a + viscous v`, as
/// feed-forward.
///
/// The force stays within the limit of the drive. While the axis is beyond one of its limits of
/// position, the force never pushes it further out. A position or set-point that is not finite is
/// replaced by the last finite one.
#[derive(Clone, Debug)]
pub struct AxisServo {
    pub(super) axis: config::Axis,
    sample_hz: f64,
    velocity: Derivative<f64, 1>,
    integrator: Integrator,
    last: (f64, SetPoint<f64>),
}

impl AxisServo {
    /// Makes the servo for the configured `axis`. `sample_hz` is the number of calls of
    /// [`update`](Self::update) per second.
    ///
    /// # Errors
    /// [`NumberError`] if a cutoff, a gain or a limit is not possible.
    pub fn new(axis: &config::Axis, sample_hz: f64) -> Result<Self, NumberError> {
        let servo = &axis.servo;
        not_negative("the gain kp", servo.kp)?;
        not_negative("the gain kv", servo.kv)?;
        not_negative("the gain ki", servo.ki)?;
        Ok(Self {
            axis: axis.clone(),
            sample_hz: period(sample_hz).map(|_| sample_hz)?,
            velocity: Derivative::new([servo.velocity_cutoff_hz], sample_hz)?,
            integrator: Integrator::new(servo.integral_max)?,
            last: (axis.home, SetPoint::rest(axis.home)),
        })
    }

    /// Sets the integral term to zero. Call it before the servo begins to drive the axis.
    pub fn reset(&mut self) {
        self.integrator.set(0.0);
    }

    /// Runs one tick, and returns the force for the drive, N. `point` is the set-point of this
    /// tick, `position` the measured position (m), and `period_s` the time since the last tick (s).
    pub fn update(&mut self, point: &SetPoint<f64>, position: f64, period_s: f64) -> f64 {
        let elapsed = Elapsed::new(period_s, self.sample_hz);
        let finite = [point.position, point.velocity, point.acceleration];
        if finite.into_iter().all(is_finite) {
            self.last.1 = *point;
        }
        if is_finite(position) {
            self.last.0 = position;
        }
        let (position, point) = self.last;
        let [velocity] = self.velocity.update_after(&[position], &[true], elapsed);
        let error = point.position - position;
        let (axis, servo) = (&self.axis, &self.axis.servo);
        let rest = servo.kp * error
            + servo.kv * (point.velocity - velocity)
            + axis.mass_kg * point.acceleration
            + axis.viscous * point.velocity;
        let (limits, max_n) = (&axis.limits, axis.max_n);
        let low = if position < limits.low { 0.0 } else { -max_n };
        let high = if position > limits.high { 0.0 } else { max_n };
        let increment = servo.ki * error * elapsed.seconds;
        let force = self.integrator.update(rest, increment, low, high);
        // After an overflow the axis pulls with its full force, to the side of its error.
        force.unwrap_or_else(|| clamp(error * max_n, low, high))
    }

    /// Keeps up with an axis that it does not drive.
    pub(super) fn watch(&mut self, position: f64, period_s: f64) {
        if is_finite(position) {
            self.last = (position, SetPoint::rest(position));
        }
        let elapsed = Elapsed::new(period_s, self.sample_hz);
        self.velocity.update_after(&[self.last.0], &[true], elapsed);
    }

    /// The last position that was finite, m.
    pub(super) fn position(&self) -> f64 {
        self.last.0
    }
}
