use super::root::{derivative, evaluate, sign_changes};
use super::{ProfilePeaks, SetPoint};
use crate::math::{abs, clamp};
use crate::number::{NumberError, finite, positive};

/// The motion of one joint between two states, as a polynomial of time of degree 3 or 5.
///
/// ```
/// use condor_hand::trajectory::Polynomial;
///
/// let reach = Polynomial::minimum_jerk(0.2_f64, 1.0, 0.5)?; // rad, rad, s
/// let middle = reach.at(0.25);
/// assert!((middle.position - 0.6).abs() < 1e-12 && middle.velocity > 0.0);
/// # Ok::<_, condor_hand::NumberError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Polynomial {
    coefficients: [f64; 6],
    duration: f64,
    /// Position and velocity at the end, to the last digit.
    end: (f64, f64),
}

impl Polynomial {
    /// Makes the cubic Hermite polynomial from `start` to `end` in `duration` (s). It has the given
    /// positions and velocities at both ends; the given accelerations are ignored.
    ///
    /// # Errors
    /// [`NumberError`] if the duration in s is not above zero, or a number is not finite.
    #[inline]
    pub fn cubic(start: &SetPoint, end: &SetPoint, duration: f64) -> Result<Self, NumberError> {
        let dx = end.position - start.position;
        let (w0, w1) = (start.velocity * duration, end.velocity * duration);
        let c2 = 3.0 * dx - 2.0 * w0 - w1;
        let c3 = w0 + w1 - 2.0 * dx;
        Self::checked([start.position, w0, c2, c3, 0.0, 0.0], duration, end)
    }

    /// Makes the quintic polynomial from `start` to `end` in `duration` (s). It has the given
    /// positions, velocities and accelerations at both ends. Of all motions between these states it
    /// has the least integral of squared jerk.
    ///
    /// # Errors
    /// [`NumberError`] if the duration in s is not above zero, or a number is not finite.
    pub fn quintic(start: &SetPoint, end: &SetPoint, duration: f64) -> Result<Self, NumberError> {
        let dx = end.position - start.position;
        let (w0, w1) = (start.velocity * duration, end.velocity * duration);
        let square = duration * duration;
        let (b0, b1) = (start.acceleration * square, end.acceleration * square);
        let half = 0.5;
        let c3 = (20.0 * dx - (8.0 * w1 + 12.0 * w0) - (3.0 * b0 - b1)) * half;
        let c4 = (14.0 * w1 + 16.0 * w0 - 30.0 * dx + (3.0 * b0 - 2.0 * b1)) * half;
        let c5 = (12.0 * dx - 6.0 * (w1 + w0) + (b1 - b0)) * half;
        Self::checked([start.position, w0, b0 * half, c3, c4, c5], duration, end)
    }

    /// Makes the motion from rest at `start` to rest at `end` (rad) in `duration` (s) with the
    /// least squared jerk. It is the profile of human reaches: T. Flash and N. Hogan, "The
    /// coordination of arm movements", 1985.
    ///
    /// # Errors
    /// [`NumberError`] if the duration in s is not above zero, or a number is not finite.
    pub fn minimum_jerk(start: f64, end: f64, duration: f64) -> Result<Self, NumberError> {
        Self::quintic(&SetPoint::rest(start), &SetPoint::rest(end), duration)
    }

    #[inline]
    fn checked(coefficients: [f64; 6], duration: f64, end: &SetPoint) -> Result<Self, NumberError> {
        positive("the duration, s,", duration)?;
        // Sums and derivatives of what is this small cannot overflow. A duration whose square
        // vanishes would make every acceleration infinite.
        let largest = coefficients.iter().fold(0.0, |sum, &c| sum + abs(c) * 64.0);
        // If the largest coefficient or the velocity is not finite, neither is the acceleration.
        finite(
            "the acceleration of the profile, rad/s²,",
            largest / (duration * duration),
        )?;
        Ok(Self {
            coefficients,
            duration,
            end: (end.position, end.velocity),
        })
    }

    /// Returns the coefficients of a cubic, lowest power first.
    #[inline(always)]
    pub(super) fn cubic_coefficients(&self) -> [f64; 4] {
        let [c0, c1, c2, c3, _, _] = self.coefficients;
        [c0, c1, c2, c3]
    }

    /// Returns the duration of the motion, s.
    #[must_use]
    pub fn duration(&self) -> f64 {
        self.duration
    }

    /// Returns the set-point `t` seconds after the beginning of the motion. Before the beginning it
    /// is that of the beginning, and after the end that of the end.
    #[inline]
    #[must_use]
    pub fn at(&self, t: f64) -> SetPoint {
        let mut point = self.point(clamp(t / self.duration, 0.0, 1.0));
        if t >= self.duration {
            (point.position, point.velocity) = self.end;
        }
        point
    }

    fn point(&self, s: f64) -> SetPoint {
        let first = derivative(&self.coefficients);
        let second = derivative(&first);
        SetPoint {
            position: evaluate(&self.coefficients, s),
            velocity: evaluate(&first, s) / self.duration,
            acceleration: evaluate(&second, s) / (self.duration * self.duration),
        }
    }

    /// Returns the extremes of position, velocity and acceleration during the motion.
    #[must_use]
    pub fn peaks(&self) -> ProfilePeaks {
        let mut peaks = ProfilePeaks::of(&self.point(0.0));
        peaks.include(&ProfilePeaks::of(&self.point(1.0)));
        let velocity = derivative(&self.coefficients);
        let acceleration = derivative(&velocity);
        let jerk = derivative(&acceleration);
        for (function, degree) in [(velocity, 4), (acceleration, 3), (jerk, 2)] {
            for s in sign_changes(&function, degree) {
                peaks.include(&ProfilePeaks::of(&self.point(s)));
            }
        }
        peaks
    }
}
