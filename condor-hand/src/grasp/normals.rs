use nalgebra::Vector3;

use super::wrench::finite;
use super::{Contacts, GraspError};
use crate::math::{is_finite, sqrt};
use crate::{NumberError, Requirement, Subject};

/// The unit normals of an object's surface at M contacts, which point into the object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Normals<const M: usize> {
    inward: [Vector3<f64>; M],
}

impl<const M: usize> Normals<M> {
    /// Makes the unit normals from `directions`, which must point into the object and may have any
    /// length above zero.
    ///
    /// # Errors
    /// [`Number`](GraspError::Number) for a direction whose length is zero or not finite.
    pub fn new(directions: [Vector3<f64>; M]) -> Result<Self, GraspError> {
        let mut inward = directions;
        for (contact, normal) in inward.iter_mut().enumerate() {
            // Scaled first, so that the squares neither vanish nor overflow.
            let greatest = normal.amax();
            let scaled = *normal / greatest;
            let length = sqrt(scaled.norm_squared());
            if !(finite(normal) && finite(&scaled) && length > 0.0) {
                let sum = normal.x + normal.y + normal.z;
                let length = if is_finite(sum) { greatest } else { sum };
                return Err(NumberError {
                    at: Subject::Contact(contact as u16),
                    what: "the length of the normal",
                    value: length,
                    must: Requirement::Above(0.0),
                }
                .into());
            }
            *normal = scaled / length;
        }
        Ok(Self { inward })
    }

    /// Makes the normals of a ball: each one points from the contact to `center`, the ball's centre
    /// (m).
    ///
    /// # Errors
    /// [`Number`](GraspError::Number) for a contact at the centre.
    pub fn of_ball(contacts: &Contacts<M>, center: &Vector3<f64>) -> Result<Self, GraspError> {
        Self::new(contacts.points().map(|point| center - point))
    }

    /// Returns the unit normals, one for each contact, which point into the object.
    #[must_use]
    pub fn inward(&self) -> &[Vector3<f64>; M] {
        &self.inward
    }
}
