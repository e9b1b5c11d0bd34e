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

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::DriveDynamics;

    fn drive() -> DriveDynamics<f64, 2> {
        DriveDynamics {
            viscous: Vector2::new(2e-3, 0.0),
            coulomb: Vector2::new(0.0, 0.03),
            coulomb_rate: Vector2::new(0.0, 0.5),
            armature: Vector2::zeros(),
        }
    }

    #[test]
    fn viscous_and_coulomb_friction_add_up() {
        let mut drive = drive();
        let tanh_one = 0.761_594_155_955_764_9;
        let torque = drive.torque(&Vector2::new(3.0, -0.5));
        assert!((torque - Vector2::new(6e-3, -0.03 * tanh_one)).amax() < 1e-17);
        drive.coulomb.x = 1.0;
        assert_eq!(drive.torque(&Vector2::new(3.0, 0.0)).x, 1.006);
        assert_eq!(drive.torque(&Vector2::new(-1e-9, 0.0)).x, -1.0 - 2e-12);
        assert_eq!(drive.torque(&Vector2::zeros()), Vector2::zeros());
    }

    #[test]
    fn friction_is_finite_at_every_rate() {
        let mut drive = drive();
        drive.coulomb_rate.y = f64::MIN_POSITIVE;
        for rate in [f64::MAX, f64::MIN, f64::MIN_POSITIVE, 0.0, -0.0] {
            let torque = drive.torque(&Vector2::repeat(rate));
            assert!(torque.iter().all(|t| t.is_finite()), "{rate}: {torque}");
            assert!(torque.y * rate >= 0.0, "{rate}: {torque}");
        }
    }
}
