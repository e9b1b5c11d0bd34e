//! Mechanisms so simple that their motion is known on paper.

use condor_hand::Pose;
use condor_hand::config::JointFriction;
use condor_hand::dynamics::Dynamics;
use condor_hand::kinematics::{Jacobian, Kinematics};
use condor_hand::plant::{
    DriveKind, FingerParameters, HandParameters, JointParameters, SimDrive, SimFinger, SimStop,
    SimSurface,
};
use condor_hand::transmission::{EffortLimits, Linear, Transmission};
use nalgebra::{Matrix1, Matrix3, SVector, Vector1, Vector3};

/// A point mass on a massless rod that turns about y, straight along x at zero.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pendulum {
    pub(crate) mass: f64,
    pub(crate) length: f64,
}

/// A point mass that slides along x, y and z from `base`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Slider {
    pub(crate) mass: f64,
    pub(crate) base: Vector3<f64>,
}

impl Pendulum {
    pub(crate) fn inertia(&self) -> f64 {
        self.mass * self.length * self.length
    }
}

impl Dynamics<1> for Pendulum {
    fn inverse_dynamics(
        &self,
        q: &Vector1<f64>,
        _: &Vector1<f64>,
        qdd: &Vector1<f64>,
        gravity: &Vector3<f64>,
    ) -> Vector1<f64> {
        self.gravity_torque(q, gravity) + qdd * self.inertia()
    }

    fn bias(&self, q: &Vector1<f64>, _: &Vector1<f64>, gravity: &Vector3<f64>) -> Vector1<f64> {
        self.gravity_torque(q, gravity)
    }

    fn gravity_torque(&self, q: &Vector1<f64>, gravity: &Vector3<f64>) -> Vector1<f64> {
        let (sine, cosine) = libm::sincos(q.x);
        Vector1::new(self.mass * self.length * (gravity.x * sine + gravity.z * cosine))
    }

    fn mass_matrix(&self, _: &Vector1<f64>) -> Matrix1<f64> {
        Matrix1::new(self.inertia())
    }

    fn forward_dynamics(
        &self,
        q: &Vector1<f64>,
        _: &Vector1<f64>,
        torque: &Vector1<f64>,
        gravity: &Vector3<f64>,
        armature: &Vector1<f64>,
    ) -> Option<Vector1<f64>> {
        let inertia = self.inertia() + armature.x;
        (inertia > 0.0).then(|| (torque - self.gravity_torque(q, gravity)) / inertia)
    }
}

impl Kinematics<3> for Slider {
    fn tip(&self, q: &Vector3<f64>) -> Pose {
        let at = self.base + q;
        Pose::at(at.x, at.y, at.z)
    }

    fn kinematics(&self, q: &Vector3<f64>) -> (Pose, Jacobian<3>) {
        let mut jacobian = Jacobian::<3>::zeros();
        jacobian.fixed_rows_mut::<3>(0).fill_with_identity();
        (self.tip(q), jacobian)
    }

    fn self_motion(&self, _: &Vector3<f64>) -> Option<Vector3<f64>> {
        None
    }
}

impl Dynamics<3> for Slider {
    fn inverse_dynamics(
        &self,
        _: &Vector3<f64>,
        _: &Vector3<f64>,
        qdd: &Vector3<f64>,
        gravity: &Vector3<f64>,
    ) -> Vector3<f64> {
        (qdd - gravity) * self.mass
    }

    fn bias(&self, _: &Vector3<f64>, _: &Vector3<f64>, gravity: &Vector3<f64>) -> Vector3<f64> {
        gravity * -self.mass
    }

    fn gravity_torque(&self, _: &Vector3<f64>, gravity: &Vector3<f64>) -> Vector3<f64> {
        gravity * -self.mass
    }

    fn mass_matrix(&self, _: &Vector3<f64>) -> Matrix3<f64> {
        Matrix3::from_diagonal_element(self.mass)
    }

    fn forward_dynamics(
        &self,
        _: &Vector3<f64>,
        _: &Vector3<f64>,
        torque: &Vector3<f64>,
        gravity: &Vector3<f64>,
        armature: &Vector3<f64>,
    ) -> Option<Vector3<f64>> {
        let force = torque + gravity * self.mass;
        let masses = armature.add_scalar(self.mass);
        (self.mass > 0.0).then(|| force.component_div(&masses))
    }
}

/// A joint that nothing holds.
pub(crate) fn free_joint() -> JointParameters {
    JointParameters {
        friction: JointFriction {
            coulomb_rate: 0.01,
            ..JointFriction::default()
        },
        stiffness: 0.0,
        rest: 0.0,
        range: (-1e6, 1e6),
        stop: SimStop {
            stiffness: 0.0,
            damping: 0.0,
        },
    }
}

pub(crate) fn exact(time_constant_s: f64) -> SimDrive {
    SimDrive {
        low: 0.0,
        high: 130.0,
        kind: DriveKind::Exact { time_constant_s },
    }
}

/// Two tendons for each joint, flexor and extensor in turn, that cross no other joint: arms of one size.
pub(crate) fn own_tendons<const N: usize, const A: usize>(arm: f64) -> Linear<N, A> {
    let arms = std::array::from_fn(|actuator| {
        let mut arms = [0.0; N];
        arms[actuator / 2] = if actuator % 2 == 0 { arm } else { -arm };
        arms
    });
    let limits = EffortLimits {
        low: 0.0,
        high: 130.0,
        bias: 0.0,
    };
    Linear::new(arms, [limits; A]).unwrap()
}

/// A finger at its zero, with tendons that have arms of 10 mm.
pub(crate) fn finger<M, const N: usize, const A: usize>(
    mechanism: M,
    joint: JointParameters,
    drive: SimDrive,
) -> SimFinger<M, Linear<N, A>, N, A>
where
    M: Dynamics<N>,
{
    moved_by(mechanism, own_tendons(0.01), joint, drive)
}

/// A finger at its zero, with joints of one kind and drives of one kind.
pub(crate) fn moved_by<M, T, const N: usize, const A: usize>(
    mechanism: M,
    transmission: T,
    joint: JointParameters,
    drive: SimDrive,
) -> SimFinger<M, T, N, A>
where
    M: Dynamics<N>,
    T: Transmission<N, A>,
{
    let parameters = FingerParameters {
        joints: [joint; N].into(),
        drives: [drive; A].into(),
    };
    SimFinger::new(mechanism, transmission, parameters, SVector::zeros()).unwrap()
}

pub(crate) fn surface(friction: f64) -> SimSurface {
    SimSurface {
        stiffness: 1e5,
        damping: 50.0,
        shear_stiffness: 1e5,
        shear_damping: 50.0,
        friction,
    }
}

/// 2.5 ms in 25 updates, points for tips.
pub(crate) fn hand_parameters(gravity: Vector3<f64>, friction: f64) -> HandParameters {
    HandParameters {
        period_s: 2.5e-3,
        updates: 25,
        gravity,
        tip_radius: 0.0,
        tip_object: surface(friction),
    }
}
