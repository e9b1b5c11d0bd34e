use nalgebra::SVector;

use crate::math::tanh;

/// The inertia and the friction of the drives of N joints, which add to the dynamics of the links.
///
/// With the [`Dynamics`](super::Dynamics) of the links, the torque of a motion with the rates qd
/// and the accelerations qdd is `inverse_dynamics + armature qdd + torque(qd)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriveDynamics<const N: usize> {
    /// The inertia of the parts that move with the joint beyond its link, referred to the joint, kg
    /// m².
    pub armature: SVector<f64, N>,
    /// Friction per rate, N m s/rad.
    pub viscous: SVector<f64, N>,
    /// Friction of a joint that moves fast, beyond the viscous, N m.
    pub coulomb: SVector<f64, N>,
    /// The rate below which Coulomb friction fades with the rate, rad/s: at this rate it is
    /// tanh 1 = 0.76 of the whole. Where it is not positive, friction has its whole size at every
    /// rate but zero.
    pub coulomb_rate: SVector<f64, N>,
}

impl<const N: usize> DriveDynamics<N> {
    /// Returns the torques that overcome friction at the rates `qd` (rad/s), N m.
    #[inline]
    #[must_use]
    pub fn torque(&self, qd: &SVector<f64, N>) -> SVector<f64, N> {
        let direction = qd.zip_map(&self.coulomb_rate, direction);
        self.viscous.component_mul(qd) + self.coulomb.component_mul(&direction)
    }
}

/// The part of the Coulomb friction that acts at a rate, with its sign.
#[inline(always)]
fn direction(rate: f64, fades_below: f64) -> f64 {
    if fades_below > 0.0 {
        tanh(rate / fades_below)
    } else if rate > 0.0 {
        1.0
    } else if rate < 0.0 {
        -1.0
    } else {
        0.0
    }
}
