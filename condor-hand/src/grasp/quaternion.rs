use nalgebra::{Matrix3, Vector3};

use crate::math::{abs, atan2, max, sin_cos, sqrt};
use crate::pose::rotation_of;

/// A unit quaternion: a rotation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rotation {
    w: f64,
    v: Vector3<f64>,
}

impl Rotation {
    /// From a quaternion of any length but zero.
    pub(super) fn normalized(w: f64, v: Vector3<f64>) -> Self {
        let greatest = max(abs(w), v.amax());
        let (w, v) = (w / greatest, v / greatest);
        let length = sqrt(w * w + v.norm_squared());
        Self {
            w: w / length,
            v: v / length,
        }
    }

    /// About the axis of the vector by its length, rad.
    pub(super) fn by(vector: &Vector3<f64>) -> Self {
        let half = sqrt(vector.norm_squared()) * 0.5;
        let (sine, cosine) = sin_cos(half);
        let factor = if half > 0.0 { sine / half } else { 1.0 };
        Self::normalized(cosine, vector * (factor * 0.5))
    }

    /// This rotation after a small one of the given half-vector.
    pub(super) fn after_small(&self, half: &Vector3<f64>) -> Self {
        Self::normalized(
            self.w - self.v.dot(half),
            half * self.w + self.v + self.v.cross(half),
        )
    }

    pub(super) fn matrix(&self) -> Matrix3<f64> {
        rotation_of(self.w, &self.v)
    }

    /// Axis times angle, the angle in 0..=pi, rad.
    pub(super) fn vector(&self) -> Vector3<f64> {
        let (w, v) = if self.w < 0.0 {
            (-self.w, -self.v)
        } else {
            (self.w, self.v)
        };
        let two = 1.0 + 1.0;
        let sine = sqrt(v.norm_squared());
        // If the square of the sine vanishes, so does the difference of the angle to the sine.
        if sine > 0.0 {
            v * (two * atan2(sine, w) / sine)
        } else {
            v * two
        }
    }
}
