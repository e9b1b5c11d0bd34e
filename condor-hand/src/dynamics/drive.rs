use nalgebra::SVector;

use crate::Real;
use crate::math::tanh;

/// The inertia and the friction of the drives of N joints, which add to the dynamics of the links.
///
/// With the [`Dynamics`](super::Dynamics) of the links, the torque of a motion with the rates qd
/// and the accelerations qdd is `inverse_dynamics + armature qdd + torque(qd)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriveDynamics<T: Real, const N: usize> {
    /// The inertia of the parts that move with the joint beyond its link, referred to the joint, kg
    /// m².
    pub armature: SVector<T, N>,
    /// Friction per rate, N m s/rad.
    pub viscous: SVector<T, N>,
    /// Friction of a joint that moves fast, beyond the viscous, N m.
    pub coulomb: SVector<T, N>,
    /// The rate below which Coulomb friction fades with the rate, rad/s: at this rate it is
    /// tanh 1 = 0.76 of the whole. Where it is not positive, friction has its whole size at every
    /// rate but zero.
    pub coulomb_rate: SVector<T, N>,
}

impl<T: Real, const N: usize> DriveDynamics<T, N> {
    /// Returns the torques that overcome friction at the rates `qd` (rad/s), N m.
    #[inline]
    #[must_use]
    pub fn torque(&self, qd: &SVector<T, N>) -> SVector<T, N> {
        let direction = qd.zip_map(&self.coulomb_rate, direction);
        self.viscous.component_mul(qd) + self.coulomb.component_mul(&direction)
    }
}

/// The part of the Coulomb friction that acts at a rate, with its sign.
#[inline(always)]
fn direction<T: Real>(rate: T, fades_below: T) -> T {
    if fades_below > T::zero() {
        tanh(rate / fades_below)
    } else if rate > T::zero() {
        T::one()
    } else if rate < T::zero() {
        -T::one()
    } else {
        T::zero()
    }
}
