use nalgebra::Vector3;

use super::{Contacts, GraspError, Normals, Wrench};
use crate::math::{Real, real, sqrt};

/// Forces and torsions of two soft fingertips.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SoftForces<T: Real> {
    /// The force of each finger on the object, N.
    pub forces: [Vector3<T>; 2],
    /// The moment of each fingertip on the object about its inward normal, N m.
    pub torsions: [T; 2],
}

impl<T: Real> Contacts<T, 2> {
    /// Returns forces and torsions of two soft fingertips that together produce the whole wrench
    /// about the point `about` (m). The torsions are the least ones that produce the moment about
    /// the line of the contacts, which forces cannot produce: in an antipodal grasp, half of it
    /// each.
    ///
    /// # Errors
    ///
    /// Those of [`forces`](Self::forces); [`NormalsAcrossLine`](GraspError::NormalsAcrossLine) if
    /// neither normal lies along the line.
    pub fn soft_forces(
        &self,
        wrench: &Wrench<T>,
        about: &Vector3<T>,
        normals: &Normals<T, 2>,
    ) -> Result<SoftForces<T>, GraspError> {
        let [first, second] = self.arms();
        let span = second - first;
        let line = span / sqrt(span.norm_squared());
        let lost = self.forces(wrench, about)?.lost_moment.dot(&line);

        let [one, other] = normals.inward();
        let cosines = [one.dot(&line), other.dot(&line)];
        let [p, q] = cosines;
        let together = p * p + q * q;
        if together <= real(1e-6) {
            let cosines = cosines.map(Real::to_f64);
            return Err(GraspError::NormalsAcrossLine { cosines });
        }
        let torsions = cosines.map(|cosine| lost * cosine / together);
        let [a, b] = torsions;
        // A normal that is off the line has a moment across it too, which the forces make up for.
        let rest = Wrench {
            force: wrench.force,
            moment: wrench.moment - one * a - other * b,
        };
        let forces = self.forces(&rest, about)?.forces;
        Ok(SoftForces { forces, torsions })
    }
}
