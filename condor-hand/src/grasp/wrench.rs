use nalgebra::Vector3;

use crate::math::{Real, is_finite};

/// A force and a moment. The item that uses a wrench says about which point the moment is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wrench<T: Real = f64> {
    /// The force, N.
    pub force: Vector3<T>,
    /// The moment, N m.
    pub moment: Vector3<T>,
}

/// A small motion of a rigid body, or its velocity: the motion of one point of the body, and the
/// rotation. The item that uses a twist says which point that is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Twist<T: Real = f64> {
    /// The motion of the body's point, m, or m/s.
    pub linear: Vector3<T>,
    /// The rotation as axis times angle, rad, or rad/s.
    pub angular: Vector3<T>,
}

impl<T: Real> Wrench<T> {
    /// Returns a wrench without force and moment.
    #[must_use]
    pub fn zero() -> Self {
        Self {
            force: Vector3::zeros(),
            moment: Vector3::zeros(),
        }
    }

    /// Adds a force (N) and the moment that it causes. `lever` (m) is the vector from the point of
    /// this wrench to the point at which the force acts.
    pub fn add_force(&mut self, force: &Vector3<T>, lever: &Vector3<T>) {
        self.force += force;
        self.moment += lever.cross(force);
    }
}

impl<T: Real> Twist<T> {
    /// Returns a twist without motion.
    #[must_use]
    pub fn zero() -> Self {
        Self {
            linear: Vector3::zeros(),
            angular: Vector3::zeros(),
        }
    }

    pub(super) fn is_finite(&self) -> bool {
        finite(&self.linear) && finite(&self.angular)
    }
}

/// All three components are numbers.
#[inline(always)]
pub(super) fn finite<T: Real>(vector: &Vector3<T>) -> bool {
    vector.iter().all(|&component| is_finite(component))
}
