use nalgebra::{Matrix3, Vector3};

use crate::math::{atan2, sin_cos, sqrt};

/// The pose of a frame relative to a parent frame: its axes as the columns of a rotation matrix,
/// and its origin in metres.
///
/// ```
/// use condor_hand::{Pose, rotation_about};
/// use nalgebra::Vector3;
///
/// let quarter = core::f64::consts::FRAC_PI_2;
/// let palm = Pose { rotation: rotation_about(&Vector3::z(), quarter), ..Pose::at(0.1, 0.0, 0.0) };
/// let tip = palm.transform(&Vector3::new(0.05, 0.0, 0.0));
/// assert!((tip - Vector3::new(0.1, 0.05, 0.0)).norm() < 1e-12);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// The axes of the frame, as columns.
    pub rotation: Matrix3<f64>,
    /// The origin of the frame, m.
    pub position: Vector3<f64>,
}

impl Pose {
    /// Returns the pose of a frame that is the same as its parent frame.
    #[must_use]
    pub fn identity() -> Self {
        Self {
            rotation: Matrix3::identity(),
            position: Vector3::zeros(),
        }
    }

    /// Returns the pose of a frame whose origin is at (`x`, `y`, `z`), in m, and whose axes are
    /// those of the parent frame.
    #[must_use]
    pub fn at(x: f64, y: f64, z: f64) -> Self {
        Self {
            rotation: Matrix3::identity(),
            position: Vector3::new(x, y, z),
        }
    }

    /// Converts the coordinates of `point` (m) from this frame into the parent frame.
    #[inline(always)]
    #[must_use]
    pub fn transform(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.position + self.rotation * point
    }

    /// Combines two poses. `inner` is the pose of a frame relative to this frame; the result is the
    /// pose of that frame relative to the parent frame of this one.
    #[inline(always)]
    #[must_use]
    pub fn then(&self, inner: &Self) -> Self {
        Self {
            rotation: self.rotation * inner.rotation,
            position: self.transform(&inner.position),
        }
    }
}

/// Returns the rotation matrix for a turn by `angle` (rad) about `axis`, a unit vector: Rodrigues'
/// formula `c 1 + s [a] + (1 - c) a aᵀ`.
#[inline]
#[must_use]
pub fn rotation_about(axis: &Vector3<f64>, angle: f64) -> Matrix3<f64> {
    let (s, c) = sin_cos(angle);
    let turned = axis * (1.0 - c);
    let (x, y, z) = (axis.x, axis.y, axis.z);
    Matrix3::new(
        turned.x * x + c,
        turned.x * y - s * z,
        turned.x * z + s * y,
        turned.y * x + s * z,
        turned.y * y + c,
        turned.y * z - s * x,
        turned.z * x - s * y,
        turned.z * y + s * x,
        turned.z * z + c,
    )
}

/// Returns the rotation of `rotation` as its axis times its angle, which is from 0 to π rad: the inverse of
/// [`rotation_about`]. At π either sign of the axis is right.
///
/// The sine and the cosine of the angle are in the skew part of the matrix and in its trace. From a quarter turn on the
/// axis comes from the symmetric part, since the skew part vanishes at half a turn.
#[must_use]
pub fn rotation_vector(rotation: &Matrix3<f64>) -> Vector3<f64> {
    let r = rotation;
    let skew = Vector3::new(r.m32 - r.m23, r.m13 - r.m31, r.m21 - r.m12) * 0.5;
    let (sine, cosine) = (sqrt(skew.norm_squared()), (r.trace() - 1.0) * 0.5);
    let angle = atan2(sine, cosine);
    if cosine >= 0.0 {
        // A sine whose square vanishes equals its angle.
        return if sine > 0.0 {
            skew * (angle / sine)
        } else {
            skew
        };
    }
    // `(1 - c) a aᵀ`, whose longest column is along the axis.
    let mut axis = Vector3::zeros();
    let mut longest = 0.0;
    let symmetric = (r + r.transpose()) * 0.5 - Matrix3::from_diagonal_element(cosine);
    for column in symmetric.column_iter() {
        let square = column.norm_squared();
        if square > longest {
            longest = square;
            axis = column.into_owned();
        }
    }
    let signed = if axis.dot(&skew) < 0.0 { -angle } else { angle };
    axis * (signed / sqrt(longest))
}

/// The rotation of a unit quaternion.
pub(crate) fn rotation_of(w: f64, v: &Vector3<f64>) -> Matrix3<f64> {
    let (x, y, z) = (v.x, v.y, v.z);
    let one = 1.0;
    let two = one + one;
    Matrix3::new(
        one - two * (y * y + z * z),
        two * (x * y - w * z),
        two * (x * z + w * y),
        two * (x * y + w * z),
        one - two * (x * x + z * z),
        two * (y * z - w * x),
        two * (x * z - w * y),
        two * (y * z + w * x),
        one - two * (x * x + y * y),
    )
}
