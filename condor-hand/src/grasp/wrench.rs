use nalgebra::Vector3;

use crate::math::is_finite;

/// A force and a moment. The item that uses a wrench says about which point the moment is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wrench {
    /// The force, N.
    pub force: Vector3<f64>,
    /// The moment, N m.
    pub moment: Vector3<f64>,
}

/// A small motion of a rigid body, or its velocity: the motion of one point of the body, and the
/// rotation. The item that uses a twist says which point that is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Twist {
    /// The motion of the body's point, m, or m/s.
    pub linear: Vector3<f64>,
    /// The rotation as axis times angle, rad, or rad/s.
    pub angular: Vector3<f64>,
}

impl Wrench {
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
    pub fn add_force(&mut self, force: &Vector3<f64>, lever: &Vector3<f64>) {
        self.force += force;
        self.moment += lever.cross(force);
    }
}

impl Twist {
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
pub(super) fn finite(vector: &Vector3<f64>) -> bool {
    vector.iter().all(|&component| is_finite(component))
}
