//! The four tips and their Jacobians.

use std::hint::black_box;

use condor_hand::Pose;
use condor_hand::kinematics::{Jacobian, Kinematics};
use nalgebra::{DMatrix, Matrix3, SVector, Vector3};

use super::race::Race;
use super::subject::{FINGERS, JOINTS, Joints, STATES, Subject, agree, flat};
use crate::Result;

/// The tips of all fingers with their Jacobians.
pub(super) type Tips = [(Pose, Jacobian<f64, JOINTS>); FINGERS];

/// The same results, as one list: positions, rotations and Jacobians, column by column.
pub(super) fn list(tips: &Tips) -> Vec<f64> {
    let mut list = Vec::new();
    for (pose, jacobian) in tips {
        list.extend(pose.position.iter());
        list.extend(pose.rotation.iter());
        list.extend(jacobian.iter());
    }
    list
}

/// The tips of fingers in one form or another.
pub(super) fn tips<K: Kinematics<f64, JOINTS>>(
    fingers: &[K; FINGERS],
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
/// One of them does not read the hand, or has other tips.
pub(super) fn enter(race: &mut Race, subject: &'static Subject) -> Result<()> {
    let k = K::new(subject)?;
    let mut dynibo = Dynibo::new(subject)?;
    for state in &subject.states {
        let mut ours = no_tips();
        tips(&subject.planar, &state.q, &mut ours);
        let ours = list(&ours);
        let mut chain = no_tips();
        tips(&subject.chains, &state.q, &mut chain);
        agree("the tips of the chains", &ours, &list(&chain), 1e-12)?;
        agree("the tips of k", &ours, &k.list(&flat(&state.q)), 1e-12)?;
        let theirs = dynibo.list(&dynibo.ordered(&state.q))?;
        agree("the tips of dynibo", &ours, &theirs, 1e-12)?;
    }
    let planar = || {
        let mut all = no_tips();
        move |call| {
            tips(&subject.planar, &black_box(subject).state(call).q, &mut all);
            black_box(&mut all);
        }
    };
    let mut of_chains = no_tips();
    let states: [_; STATES] = subject.states.map(|state| flat(&state.q));
    let ordered: [_; STATES] = subject.states.map(|state| dynibo.ordered(&state.q));
    race.enter(TIPS, "PlanarFinger", planar());
    race.enter(TIPS, "the same once more", planar());
    race.enter(TIPS, "Chain", move |call| {
        let q = &black_box(subject).state(call).q;
        tips(&subject.chains, q, &mut of_chains);
        black_box(&mut of_chains);
    });
    race.enter(TIPS, "k", move |call| {
        for finger in 0..FINGERS {
            black_box(k.tip(finger, &states[call % STATES]));
        }
    });
    race.enter_failing(TIPS, "dynibo", move |call| {
        dynibo.tips(&ordered[call % STATES])?;
        black_box(&mut dynibo.jacobians);
        Ok(())
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

    /// A Jacobian makes the transformations of its chain, that of the tip too.
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

/// The hand in dynibo, which has Jacobians of all joints.
pub(super) struct Dynibo {
    pub(super) robot: dynibo::Robot,
    tips: Vec<dynibo::LinkId>,
    poses: Vec<dynibo::Frame>,
    jacobians: Vec<DMatrix<f64>>,
    /// Which of our joints each of its joints is.
    order: [usize; FINGERS * JOINTS],
}

impl Dynibo {
    /// The hand from a file, which is what dynibo reads.
    pub(super) fn new(subject: &Subject) -> Result<Self> {
        let directory = tempfile::tempdir()?;
        let path = directory.path().join("hand.urdf");
        std::fs::write(&path, subject.urdf())?;
        let robot = dynibo::Robot::from_urdf(&path)?;
        let joints = robot.joint_count();
        let tips = (0..FINGERS)
            .map(|finger| robot.link_id(&format!("{finger}.tip")))
            .collect::<dynibo::Result<Vec<_>>>()?;
        let mut order = [0; FINGERS * JOINTS];
        for (index, ours) in order.iter_mut().enumerate() {
            let name = robot.joint_name(index)?;
            let place = name
                .strip_prefix("joint ")
                .and_then(|name| name.split_once('.'));
            let (finger, joint) = place.ok_or_else(|| format!("dynibo has a joint {name}"))?;
            *ours = JOINTS * finger.parse::<usize>()? + joint.parse::<usize>()?;
        }
        Ok(Self {
            robot,
            tips,
            order,
            poses: vec![dynibo::Frame::identity(); FINGERS],
            jacobians: vec![DMatrix::zeros(6, joints); FINGERS],
        })
    }

    /// A number for each joint in its order.
    pub(super) fn ordered(&self, joints: &Joints) -> [f64; FINGERS * JOINTS] {
        let flat = flat(joints);
        self.order.map(|ours| flat[ours])
    }

    /// A number for each joint in our order.
    pub(super) fn in_our_order(&self, theirs: &[f64; FINGERS * JOINTS]) -> [f64; FINGERS * JOINTS] {
        let mut ours = [0.0; FINGERS * JOINTS];
        for (&index, &value) in self.order.iter().zip(theirs) {
            ours[index] = value;
        }
        ours
    }

    fn tips(&mut self, q: &[f64]) -> Result<()> {
        for (finger, &tip) in self.tips.iter().enumerate() {
            self.poses[finger] = self.robot.forward_kinematics(q, tip)?;
            let jacobian = self.jacobians[finger].as_mut_slice();
            self.robot.jacobian(q, tip, jacobian)?;
        }
        Ok(())
    }

    /// With the rows in our order: dynibo has rotations first.
    fn list(&mut self, q: &[f64]) -> Result<Vec<f64>> {
        self.tips(q)?;
        let mut list = Vec::new();
        for (finger, (pose, jacobian)) in self.poses.iter().zip(&self.jacobians).enumerate() {
            let position: Vector3<f64> = pose.translation.vector;
            let rotation: Matrix3<f64> = pose.rotation.to_rotation_matrix().into_inner();
            list.extend(position.iter());
            list.extend(rotation.iter());
            for joint in 0..JOINTS {
                let ours = JOINTS * finger + joint;
                let place = self.order.iter().position(|&index| index == ours);
                let column = jacobian.column(place.ok_or("dynibo lacks a joint")?);
                list.extend(column.rows(3, 3).iter());
                list.extend(column.rows(0, 3).iter());
            }
        }
        Ok(list)
    }
}
