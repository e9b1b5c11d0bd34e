//! The posture of a position and a pitch.

use nalgebra::{SVector, Vector3};

use super::plane::{far, reached};
use super::{Branches, InverseError, check_finite};
use crate::kinematics::PlanarFinger;
use crate::math::{Real, min, wrap};

impl<T: Real> PlanarFinger<T> {
    /// Returns all postures that bring the tip to `target` (m, in the palm) with the last link at
    /// the angle `pitch` (rad, see [`PlanarFinger::pitch`]). There are up to two directions of the
    /// first joint, and for each two sides to which the middle joint is bent. The limits of the
    /// joints are not regarded.
    ///
    /// Only the first angle of `present` (rad) is used, and only if the target is on the axis of
    /// the first joint.
    ///
    /// The axis of the last joint is at the target less the last link; the two links before it and
    /// the line to it form a triangle.
    ///
    /// # Errors
    /// [`InverseError`] if there is no posture; it has the distance by which the target is out of
    /// reach.
    pub fn pitch_branches(
        &self,
        target: &Vector3<T>,
        pitch: T,
        present: &SVector<T, 4>,
    ) -> Result<Branches<T>, InverseError> {
        check_finite("the pitch", [&pitch])?;
        let pitch = wrap(pitch);
        let mut branches = Branches::new();
        let mut short = far();
        for aim in &self.aims(target, present)? {
            let axis = self.last_axis(aim, pitch);
            for flexed in [true, false] {
                match self.two_links(axis, flexed) {
                    Ok((q1, q2)) => {
                        let q3 = wrap(pitch - q1 - q2);
                        // There is room for four.
                        let _ = branches.push(SVector::from([aim.turn, q1, q2, q3]));
                    }
                    Err(by) => short = min(by, short),
                }
            }
        }
        reached(branches, short)
    }
}
