use condor_hand::dynamics::Dynamics;
use condor_hand::grasp::{
    ContactFriction, Contacts, FingerState, GraspStiffness, GraspTuning, Normals, Posture,
    SpatialGain, Squeeze, TorqueLimits, TuningSurface, Wrench,
};
use condor_hand::kinematics::PlanarFinger;
use nalgebra::{SVector, Vector3};

use crate::Shipped;
use crate::corpus::{Between, HOSTILE};
use crate::digest::Digest;
use crate::mechanism::planar;

/// Tips about an object between thumb and fingers.
pub(crate) const POSTURES: [[f64; 4]; 4] = [
    [0.1, 0.9, 0.8, 0.5],
    [0.0, 0.8, 0.9, 0.5],
    [-0.1, 0.9, 0.7, 0.6],
    [0.05, 0.9, 0.8, 0.6],
];

/// About the middle of those tips, m.
const CENTER: [f64; 3] = [0.07, 0.005, -0.06];

/// Runs the law of a held object that is moved, pushed, overloaded and lost.
pub(crate) fn grasps(digest: &mut Digest, hand: &Shipped) -> Option<()> {
    let fingers = [
        planar(hand, 0)?,
        planar(hand, 1)?,
        planar(hand, 2)?,
        planar(hand, 3)?,
    ];
    let gravity = Vector3::from(hand.gravity);
    let mut between = Between::seeded(9);
    let engaged = states(&fingers, &gravity, 0.0, &mut between);
    let mut tuning = tuning()?;
    let mut grasp = GraspStiffness::engage(&engaged, tuning).ok()?;
    for step in 0..60_u32 {
        // Displaced by ever more, until the displacement is not rigid any more.
        let size = 0.002 * f64::from(step / 2);
        if step == 20 {
            tuning.limits = [TorqueLimits::symmetric(&SVector::repeat(0.15)); 4];
            tuning.friction = ContactFriction::point(0.5).ok()?;
            grasp.set_tuning(tuning).ok()?;
        }
        let mut states = states(&fingers, &gravity, size, &mut between);
        if step % 8 == 7 {
            let hostile = HOSTILE.into_iter().cycle().nth(step as usize / 8)?;
            let [first, ..] = &mut states;
            first.tip.x = hostile;
        }
        let output = grasp.update(&states).ok();
        let Some(output) = digest.answer(output) else {
            continue;
        };
        output
            .torques
            .iter()
            .for_each(|torque| digest.numbers(torque));
        for twist in [output.deviation, output.velocity] {
            digest.numbers(&twist.linear);
            digest.numbers(&twist.angular);
        }
        digest.numbers(&output.wrench.force);
        digest.numbers(&output.wrench.moment);
        output.forces.iter().for_each(|force| digest.numbers(force));
        digest.numbers(&output.margins);
        digest.number(output.squeeze_share);
        if let Some(excess) = digest.answer(output.squeeze_limit) {
            digest.numbers(&[excess.torque, excess.limit]);
        }
        if let Some(excess) = digest.answer(output.overload) {
            digest.numbers(&[excess.torque, excess.limit]);
        }
        squeezes(digest, &tuning, &states, &output.wrench_forces);
    }
    Some(())
}

/// Computes the forces with which the fingers must press.
fn squeezes(
    digest: &mut Digest,
    tuning: &GraspTuning<4, 4>,
    states: &[FingerState<4>; 4],
    forces: &[Vector3<f64>; 4],
) -> Option<()> {
    let contacts = Contacts::new(states.map(|state| state.tip)).ok();
    let contacts = digest.answer(contacts)?;
    let normals = Normals::of_ball(&contacts, &tuning.center).ok();
    let normals = digest.answer(normals)?;
    let directions = contacts.internal_forces(&tuning.squeeze).ok();
    let directions = digest.answer(directions)?;
    for force in &directions {
        digest.numbers(force);
    }
    let margins = tuning.friction.margins(&normals, forces).ok();
    let margins = digest.answer(margins)?;
    digest.numbers(&margins);
    Some(())
}

fn tuning() -> Option<GraspTuning<4, 4>> {
    let center = Vector3::from(CENTER);
    Some(GraspTuning {
        stiffness: SpatialGain::diagonal([200.0, 250.0, 150.0, 0.1, 0.12, 0.09]).ok()?,
        damping: SpatialGain::diagonal([2.0, 2.0, 2.0, 1e-3, 2e-3, 1e-3]).ok()?,
        center,
        feed_forward: Wrench {
            force: Vector3::new(0.0, 0.0, 0.5),
            moment: Vector3::zeros(),
        },
        squeeze: Squeeze::equal(1.5).ok()?,
        surface: TuningSurface::Ball(center),
        friction: ContactFriction::point(0.8).ok()?,
        posture: Posture {
            stiffness: 0.05,
            damping: 1e-3,
        },
        limits: [TorqueLimits::none(); 4],
    })
}

/// Returns the states that the fingers measure, at most `size` rad from the posture of the grasp.
fn states(
    fingers: &[PlanarFinger; 4],
    gravity: &Vector3<f64>,
    size: f64,
    between: &mut Between,
) -> [FingerState<4>; 4] {
    let mut postures = POSTURES.into_iter();
    fingers.each_ref().map(|finger| {
        let q = postures.next().unwrap_or_default();
        let q = SVector::from(q) + between.vector(-size, size);
        let rates = between.vector(-size, size);
        FingerState::new(finger, &q, &rates, &finger.gravity_torque(&q, gravity))
    })
}
