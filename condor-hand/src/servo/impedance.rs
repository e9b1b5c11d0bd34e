//! A joint as a spring and a damper, and how stiff it may be.

use nalgebra::{SVector, Vector3};

use super::{FingerSettings, JointTarget, PositionLaw};
use crate::dynamics::Dynamics;
use crate::math::min;

/// A spring and a damper at a joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Impedance {
    /// The position at which the spring has no torque, rad.
    pub(super) position: f64,
    /// N m/rad.
    pub(super) stiffness: f64,
    /// N m s/rad.
    pub(super) damping: f64,
}

impl Impedance {
    /// One without any torque.
    pub(super) fn none() -> Self {
        Self {
            position: 0.0,
            stiffness: 0.0,
            damping: 0.0,
        }
    }

    /// The impedance that a target asks for, if it asks for one.
    pub(super) fn of(target: &JointTarget) -> Option<Self> {
        match *target {
            JointTarget::Impedance {
                position,
                stiffness,
                damping,
            } => Some(Self {
                position,
                stiffness,
                damping,
            }),
            _ => None,
        }
    }

    /// The torque of the spring and the damper, N m.
    #[inline(always)]
    pub(super) fn torque(&self, position: f64, rate: f64) -> f64 {
        self.stiffness * (self.position - position) - self.damping * rate
    }

    /// Goes a part of the way to another one.
    pub(super) fn approach(&mut self, to: &Self, part: f64) {
        self.position += part * (to.position - self.position);
        self.stiffness += part * (to.stiffness - self.stiffness);
        self.damping += part * (to.damping - self.damping);
    }
}

/// The greatest stiffness (N m/rad) and damping (N m s/rad) of a joint of this inertia, kg m²: those by
/// which its law holds a position. What that law asks for, the loop bears.
pub(super) fn greatest(law: &PositionLaw, inertia: f64) -> (f64, f64) {
    match *law {
        PositionLaw::Pd { kp, kv, .. } => (kp, kv),
        PositionLaw::ComputedTorque {
            bandwidth_hz,
            damping_ratio,
        } => {
            let w = core::f64::consts::TAU * bandwidth_hz;
            (inertia * w * w, 2.0 * damping_ratio * w * inertia)
        }
    }
}

/// The least inertia of each joint while all others are free, kg m²: of the three postures with all
/// joints at their lower limits, halfway, and at their upper limits. Zero if one has no inertia.
///
/// With `K = J w²` at every joint and such inertias J, the trace of `K M⁻¹` is at most `N w²`. So no
/// natural frequency of the finger is above √N w, whatever the joints do to each other.
pub(super) fn least_inertias<M: Dynamics<N>, const N: usize, const A: usize>(
    mechanism: &M,
    settings: &FingerSettings<N, A>,
) -> [f64; N] {
    let (still, weightless) = (SVector::zeros(), Vector3::zeros());
    let mut least = [None; N];
    for part in [0.0, 0.5, 1.0] {
        let mut q = SVector::<f64, N>::zeros();
        for (q, joint) in q.iter_mut().zip(&settings.joints) {
            *q = joint.stop.low + part * (joint.stop.high - joint.stop.low);
        }
        for (joint, least) in least.iter_mut().enumerate() {
            let mut torque = SVector::<f64, N>::zeros();
            if let Some(torque) = torque.get_mut(joint) {
                *torque = 1.0;
            }
            let armature = &settings.drive.armature;
            let accelerations =
                mechanism.forward_dynamics(&q, &still, &torque, &weightless, armature);
            let own = accelerations.and_then(|all| all.get(joint).copied());
            let inertia = own.map_or(0.0, |own| 1.0 / own);
            *least = Some(least.map_or(inertia, |least| min(least, inertia)));
        }
    }
    least.map(|inertia| inertia.unwrap_or(0.0))
}
