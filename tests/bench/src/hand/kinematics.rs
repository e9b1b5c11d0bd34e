//! The four tips and their Jacobians.

use std::hint::black_box;

use condor_hand::Pose;
use condor_hand::kinematics::{Jacobian, Kinematics as _, PlanarFinger};
use nalgebra::SVector;

use super::subject::{FINGERS, JOINTS, OURS, STATES, Subject, agree, flat};
use crate::Result;
use crate::race::Race;

/// The tips of all fingers with their Jacobians.
pub(super) type Tips = [(Pose, Jacobian<f64, JOINTS>); FINGERS];

/// Returns the results as one list: positions, rotations and Jacobians, column by column.
pub(super) fn list(tips: &Tips) -> Vec<f64> {
    let mut list = Vec::new();
    for (pose, jacobian) in tips {
        list.extend(pose.position.iter());
        list.extend(pose.rotation.iter());
        list.extend(jacobian.iter());
    }
    list
}

/// Computes the tips of fingers.
pub(super) fn tips(
    fingers: &[PlanarFinger; FINGERS],
    q: &[SVector<f64, JOINTS>; FINGERS],
    tips: &mut Tips,
) {
    for ((tip, finger), q) in tips.iter_mut().zip(fingers).zip(q) {
        *tip = finger.kinematics(q);
    }
}

pub(super) fn no_tips() -> Tips {
    [(Pose::identity(), Jacobian::zeros()); FINGERS]
}

/// This task.
pub(super) const TIPS: &str = "4 tips and their Jacobians";

/// Checks that all have the same tips, and lets them take part.
///
/// # Errors
/// Returns an error if one of them does not read the hand, or has other tips.
pub(super) fn enter(race: &mut Race<'_>, subject: &'static Subject) -> Result<()> {
    let k = K::new(subject)?;
    for state in &subject.states {
        let mut ours = no_tips();
        tips(&subject.planar, &state.q, &mut ours);
        let theirs = k.list(&flat(&state.q));
        agree("the tips of k", &list(&ours), &theirs, 1e-12)?;
    }
    let states: [_; STATES] = subject.states.map(|state| flat(&state.q));
    let mut all = no_tips();
    race.enter(TIPS, OURS, move |call| {
        tips(&subject.planar, &black_box(subject).state(call).q, &mut all);
        black_box(&mut all);
    });
    race.enter(TIPS, "k", move |call| {
        for finger in 0..FINGERS {
            black_box(k.tip(finger, &states[call % STATES]));
        }
    });
    Ok(())
}

/// The hand in the crate k, a serial chain for each finger.
struct K {
    fingers: Vec<k::SerialChain<f64>>,
    ends: Vec<k::Node<f64>>,
}

impl K {
    fn new(subject: &Subject) -> Result<Self> {
        let robot =
            urdf_rs::read_from_string(&subject.urdf()).map_err(|error| error.to_string())?;
        let hand = k::Chain::<f64>::from(robot);
        let mut ends = Vec::new();
        for finger in 0..FINGERS {
            let end = hand.find(&format!("joint {finger}.tip"));
            ends.push(end.ok_or("k has no tip")?.clone());
        }
        let fingers = ends.iter().map(k::SerialChain::from_end).collect();
        Ok(Self { fingers, ends })
    }

    /// Computes the tip and the Jacobian of a finger. The Jacobian makes the transformations of its chain,
    /// and so that of the tip.
    fn tip(
        &self,
        finger: usize,
        q: &[f64],
    ) -> (Option<k::Isometry3<f64>>, k::nalgebra::DMatrix<f64>) {
        let chain = &self.fingers[finger];
        chain.set_joint_positions_unchecked(&q[JOINTS * finger..JOINTS * (finger + 1)]);
        let jacobian = k::jacobian(chain);
        (self.ends[finger].world_transform(), jacobian)
    }

    fn list(&self, q: &[f64]) -> Vec<f64> {
        let mut list = Vec::new();
        for finger in 0..FINGERS {
            let (pose, jacobian) = self.tip(finger, q);
            let Some(pose) = pose else { continue };
            list.extend(pose.translation.vector.iter());
            list.extend(pose.rotation.to_rotation_matrix().matrix().iter());
            list.extend(jacobian.iter());
        }
        list
    }
}
