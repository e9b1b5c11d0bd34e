//! Two arms of seven joints, as their makers' descriptions have them, and postures of these.

#![allow(
    clippy::approx_constant,
    reason = "the makers' descriptions have angles of few digits"
)]

use std::f64::consts::PI;

use condor_hand::kinematics::{Chain, ChainBody, ChainJoint, ChainMotion, JointLimits};
use condor_hand::math::{sin_cos, sqrt};
use condor_hand::{Pose, rotation_about};
use nalgebra::{SVector, Vector3};

pub(crate) type Joints = SVector<f64, 7>;

/// An arm with the limits of its joints.
pub(crate) struct Arm {
    pub(crate) name: &'static str,
    pub(crate) chain: Chain<7>,
    pub(crate) limits: JointLimits<7>,
}

/// The arms LBR iiwa 14 R820 of KUKA and Panda of Franka, in the order of `tests/reference/arms.json`.
pub(crate) fn arms() -> [Arm; 2] {
    [iiwa(), panda()]
}

/// The numbers of `iiwa_description/urdf/iiwa14.urdf`; the tip is the flange.
pub(crate) fn iiwa() -> Arm {
    let (y, z) = (Vector3::y(), Vector3::z());
    let joints = [
        ([0.0, 0.0, 0.1475], z),
        ([0.0, -0.01, 0.2125], y),
        ([0.0, 0.01, 0.228], z),
        ([0.0, 0.0105, 0.192], -y),
        ([0.0, -0.0105, 0.2075], z),
        ([0.0, -0.0707, 0.1925], y),
        ([0.0, 0.0707, 0.091], z),
    ]
    .map(|([x, y, z], axis)| (Pose::at(x, y, z), axis));
    let (wide, narrow) = (2.967_059_728_39, 2.094_395_102_39);
    let upper = Joints::from([wide, narrow, wide, narrow, wide, narrow, 3.054_326_190_99]);
    arm("iiwa14", &joints, 0.035, (-upper, upper))
}

/// The numbers of `panda_description/urdf/panda.urdf`; the tip is the flange.
pub(crate) fn panda() -> Arm {
    let quarter = 1.570_796_326_79;
    let joints = [
        ([0.0, 0.0, 0.333], 0.0),
        ([0.0, 0.0, 0.0], -quarter),
        ([0.0, -0.316, 0.0], quarter),
        ([0.0825, 0.0, 0.0], quarter),
        ([-0.0825, 0.384, 0.0], -quarter),
        ([0.0, 0.0, 0.0], quarter),
        ([0.088, 0.0, 0.0], quarter),
    ]
    .map(|([x, y, z], roll)| {
        let placement = Pose {
            rotation: rotation_about(&Vector3::x(), roll),
            ..Pose::at(x, y, z)
        };
        (placement, Vector3::z())
    });
    let lower = [
        -2.9671, -1.8326, -2.9671, -3.1416, -2.9671, -0.0873, -2.9671,
    ];
    let upper = [2.9671, 1.8326, 2.9671, 0.0873, 2.9671, 3.8223, 2.9671];
    arm("panda", &joints, 0.107, (lower.into(), upper.into()))
}

fn arm(
    name: &'static str,
    joints: &[(Pose, Vector3<f64>); 7],
    flange: f64,
    (lower, upper): (Joints, Joints),
) -> Arm {
    let joints =
        joints.map(|(placement, axis)| ChainJoint::new(placement, ChainMotion::Revolute(axis)));
    let bodies = [ChainBody::massless(); 7];
    Arm {
        name,
        chain: Chain::new(Pose::identity(), joints, bodies, Vector3::z() * flange).unwrap(),
        limits: JointLimits::new(lower, upper).unwrap(),
    }
}

/// Numbers that look random, the same in every run: `SplitMix64` (Steele, Lea and Flood 2014).
pub(crate) struct Numbers(pub(crate) u64);

impl Numbers {
    /// A number from 0 to 1.
    pub(crate) fn share(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        let high = (mixed ^ (mixed >> 31)) >> 32;
        f64::from(high as u32) / f64::from(u32::MAX)
    }

    /// A posture within limits.
    pub(crate) fn posture<const N: usize>(&mut self, limits: &JointLimits<N>) -> SVector<f64, N> {
        let range = limits.upper() - limits.lower();
        limits.clamp(&(limits.lower() + range.map(|range| range * self.share())))
    }

    /// A direction, of length one.
    pub(crate) fn direction(&mut self) -> Vector3<f64> {
        let (height, turn) = (2.0 * self.share() - 1.0, 2.0 * PI * self.share());
        let (radius, (sine, cosine)) = (sqrt(1.0 - height * height), sin_cos(turn));
        Vector3::new(radius * cosine, radius * sine, height)
    }
}
