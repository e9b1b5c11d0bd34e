use nalgebra::SVector;

use crate::Subject;
use crate::math::clamp;
use crate::number::{NumberError, Requirement, check, finite};

/// The lower and upper limits of the positions of N joints: rad, or m for a prismatic joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointLimits<const N: usize> {
    lower: SVector<f64, N>,
    upper: SVector<f64, N>,
}

/// One of the two limits of a joint: the lower or the upper one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The lower limit.
    Low,
    /// The upper limit.
    High,
}

impl<const N: usize> JointLimits<N> {
    /// Makes limits from the lowest and the highest position of each joint, rad (m for a prismatic
    /// joint).
    ///
    /// # Errors
    /// [`NumberError`] for the first joint whose lower limit is not below its upper one, or whose limits are not
    /// finite.
    pub fn new(lower: SVector<f64, N>, upper: SVector<f64, N>) -> Result<Self, NumberError> {
        for (joint, (&low, &high)) in lower.iter().zip(upper.iter()).enumerate() {
            let above = Requirement::Above(low);
            finite("the lower limit, rad or m,", low)
                .and_then(|()| check("the upper limit, rad or m,", high, above))
                .map_err(|error| error.at(Subject::Joint(joint as u16)))?;
        }
        Ok(Self { lower, upper })
    }

    /// Returns the lowest position of each joint, rad (m for a prismatic joint).
    #[must_use]
    pub fn lower(&self) -> &SVector<f64, N> {
        &self.lower
    }

    /// Returns the highest position of each joint, rad (m for a prismatic joint).
    #[must_use]
    pub fn upper(&self) -> &SVector<f64, N> {
        &self.upper
    }

    /// Returns the posture in the middle of all limits, rad (m for a prismatic joint).
    #[must_use]
    pub fn middle(&self) -> SVector<f64, N> {
        (self.lower + self.upper) * 0.5
    }

    /// Returns `q` with each position moved to the nearest one within its limits; a NaN becomes the
    /// lower limit.
    #[must_use]
    pub fn clamp(&self, q: &SVector<f64, N>) -> SVector<f64, N> {
        q.zip_zip_map(&self.lower, &self.upper, clamp)
    }
}
