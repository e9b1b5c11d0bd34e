use crate::config;
use crate::config::AxisNumber;
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
    velocity: Derivative<1>,
    integrator: Integrator,
    /// The settings on the way to which those of `axis` are, and in how many ticks they get there.
    wanted: config::AxisServoSettings,
    left: u32,
    last: (f64, SetPoint),
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
            wanted: *servo,
            left: 0,
            last: (axis.home, SetPoint::rest(axis.home)),
        })
    }

    /// Sets the integral term to zero. Call it before the servo begins to drive the axis.
    pub fn reset(&mut self) {
        self.integrator.set(0.0);
    }

    /// Returns the value of a number of the servo, to which it has come or comes.
    #[must_use]
    pub const fn number(&self, number: AxisNumber) -> f64 {
        number.of(&self.wanted)
    }

    /// Changes a number of the servo, from the next tick on. Take it from its [range](AxisNumber::range). Gains come to
    /// it over `ticks` ticks, so that the force makes no step; the filter has its cutoff at once.
    ///
    /// # Errors
    /// [`NumberError`] if no servo can have the number; it keeps its own then.
    pub fn set_number(
        &mut self,
        number: AxisNumber,
        value: f64,
        ticks: u32,
    ) -> Result<(), NumberError> {
        let (key, ..) = *number.name();
        not_negative(key, value)?;
        if number == AxisNumber::VelocityCutoff {
            self.velocity.set_cutoff(0, value)?;
            self.axis.servo.velocity_cutoff_hz = value;
        }
        *number.of_mut(&mut self.wanted) = value;
        self.left = ticks.max(1);
        Ok(())
    }

    /// Brings the gains a tick nearer to those that are wanted.
    #[cold]
    fn approach(&mut self) -> Result<(), NumberError> {
        let part = 1.0 / f64::from(self.left);
        self.left -= 1;
        for number in AxisNumber::ALL {
            let wanted = number.of(&self.wanted);
            let gain = number.of_mut(&mut self.axis.servo);
            *gain = if self.left == 0 {
                wanted
            } else {
                *gain + part * (wanted - *gain)
            };
        }
        let mut integrator = Integrator::new(self.axis.servo.integral_max)?;
        integrator.set(self.integrator.term());
        self.integrator = integrator;
        Ok(())
    }

    /// Runs one tick, and returns the force for the drive, N. `point` is the set-point of this
    /// tick, `position` the measured position (m), and `period_s` the time since the last tick (s).
    pub fn update(&mut self, point: &SetPoint, position: f64, period_s: f64) -> f64 {
        let elapsed = Elapsed::new(period_s, self.sample_hz);
        if self.left > 0 {
            // Numbers between two that are possible are possible.
            let _ = self.approach();
        }
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
