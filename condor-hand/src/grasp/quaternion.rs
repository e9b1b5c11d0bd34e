use nalgebra::{Matrix3, Vector3};

use crate::math::{Real, abs, atan2, max, real, sin_cos, sqrt};
use crate::pose::rotation_of;

/// A unit quaternion: a rotation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rotation<T: Real> {
    w: T,
    v: Vector3<T>,
}

impl<T: Real> Rotation<T> {
    /// From a quaternion of any length but zero.
    pub(super) fn normalized(w: T, v: Vector3<T>) -> Self {
        let greatest = max(abs(w), v.amax());
        let (w, v) = (w / greatest, v / greatest);
        let length = sqrt(w * w + v.norm_squared());
        Self {
            w: w / length,
            v: v / length,
        }
    }

    /// About the axis of the vector by its length, rad.
    pub(super) fn by(vector: &Vector3<T>) -> Self {
        let half = sqrt(vector.norm_squared()) * real(0.5);
        let (sine, cosine) = sin_cos(half);
        let factor = if half > T::zero() {
            sine / half
        } else {
            T::one()
        };
        Self::normalized(cosine, vector * (factor * real(0.5)))
    }

    /// This rotation after a small one of the given half-vector.
    pub(super) fn after_small(&self, half: &Vector3<T>) -> Self {
        Self::normalized(
            self.w - self.v.dot(half),
            half * self.w + self.v + self.v.cross(half),
        )
    }

    pub(super) fn matrix(&self) -> Matrix3<T> {
        rotation_of(self.w, &self.v)
    }

    /// Axis times angle, the angle in 0..=pi, rad.
    pub(super) fn vector(&self) -> Vector3<T> {
        let (w, v) = if self.w < T::zero() {
            (-self.w, -self.v)
        } else {
            (self.w, self.v)
        };
        let two = T::one() + T::one();
        let sine = sqrt(v.norm_squared());
        // If the square of the sine vanishes, so does the difference of the angle to the sine.
        if sine > T::zero() {
            v * (two * atan2(sine, w) / sine)
        } else {
            v * two
        }
    }
}
