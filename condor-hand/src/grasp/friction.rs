use nalgebra::Vector3;

use super::contacts::check;
use super::{GraspError, Normals, quantity, too_large};
use crate::math::{is_finite, sqrt};
use crate::number::positive;

/// The Coulomb friction of a fingertip that touches the object in a point.
///
/// With the coefficient of friction mu, the normal part `f_n` and the tangential part `f_t` of the
/// force, the contact sticks while `|f_t| <= mu f_n`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactFriction {
    sliding: f64,
}

impl ContactFriction {
    /// Makes the friction of a point contact with this coefficient of friction: the contact slips
    /// when the tangential force exceeds `coefficient` times the normal force.
    ///
    /// # Errors
    /// [`Number`](GraspError::Number) unless the coefficient is positive.
    pub fn point(coefficient: f64) -> Result<Self, GraspError> {
        positive("a coefficient of friction", coefficient)?;
        Ok(Self {
            sliding: coefficient,
        })
    }

    /// Returns for each contact how far it is from slipping, N: `mu f_n - |f_t|`. The margin is negative if the contact
    /// slips, or if the finger pulls on the surface. `forces` are those of the fingers on the object, N.
    ///
    /// # Errors
    /// [`Number`](GraspError::Number) if an input is not finite, or if a result exceeds the range of
    /// the type.
    pub fn margins<const M: usize>(
        &self,
        normals: &Normals<M>,
        forces: &[Vector3<f64>; M],
    ) -> Result<[f64; M], GraspError> {
        check(forces, quantity::FORCE)?;
        let mut margins = [0.0; M];
        for (margin, (force, normal)) in margins.iter_mut().zip(forces.iter().zip(normals.inward()))
        {
            let along = force.dot(normal);
            let across = force - normal * along;
            *margin = self.sliding * along - sqrt(across.norm_squared());
            if !is_finite(*margin) {
                return Err(too_large(quantity::FORCE));
            }
        }
        Ok(margins)
    }
}
