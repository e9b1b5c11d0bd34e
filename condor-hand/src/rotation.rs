use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use crate::rotation_about;

/// The orientation of a frame relative to its parent frame, in whichever of four notations is
/// easiest to write in a text.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub enum Rotation {
    /// No rotation: the axes are those of the frame around it.
    #[default]
    None,
    /// The rotation matrix, row by row; its columns are the axes.
    Rows([[f64; 3]; 3]),
    /// Roll, pitch and yaw: rotations about the fixed x, then y, then z, rad.
    Rpy([f64; 3]),
    /// A rotation about one axis.
    Axis {
        /// The axis, a unit vector.
        axis: [f64; 3],
        /// The angle, rad.
        angle: f64,
    },
}

impl Rotation {
    /// Returns the same rotation as a matrix, whose columns are the axes of the frame in the parent
    /// frame.
    #[must_use]
    pub fn matrix(&self) -> Matrix3<f64> {
        match *self {
            Self::None => Matrix3::identity(),
            Self::Rows([[a, b, c], [d, e, f], [g, h, i]]) => {
                Matrix3::new(a, b, c, d, e, f, g, h, i)
            }
            Self::Rpy([roll, pitch, yaw]) => {
                rotation_about(&Vector3::z(), yaw)
                    * rotation_about(&Vector3::y(), pitch)
                    * rotation_about(&Vector3::x(), roll)
            }
            Self::Axis { axis, angle } => rotation_about(&Vector3::from(axis), angle),
        }
    }
}
