//! Fingers of the reference hand that hold a ball by simple springs at their tips.

use condor_hand::dynamics::Dynamics;
use condor_hand::grasp::Wrench;
use condor_hand::kinematics::{Kinematics, PlanarFinger};
use condor_hand::plant::{FingerParameters, ObjectParameters, SimFinger, SimHand, SimObject};
use condor_hand::transmission::Linear;
use nalgebra::{SVector, Vector3, Vector4};

use super::mechanisms::{exact, free_joint, hand_parameters};
use crate::support::{Geometry, geometry, vector};

const TIPS: usize = 3;

/// The outer two fingers and the thumb.
const NUMBERS: [usize; TIPS] = [0, 2, 3];

const STIFFNESS: f64 = 150.0;
const DAMPING: f64 = 4.0;

/// How far each spring pulls to the middle of the tips, of the way there: forces that balance.
const SQUEEZE: f64 = 0.3;

fn start() -> Vector4<f64> {
    Vector4::new(0.0, 0.6, 0.9, 0.6)
}

type PlanarPlant = SimFinger<PlanarFinger, Linear<4, 8>, 4, 8>;

fn plant(geometry: &Geometry, number: usize) -> PlanarPlant {
    let mut joint = free_joint();
    (joint.friction.armature, joint.friction.viscous) = (1.6e-5, 2e-3);
    let parameters = FingerParameters {
        joints: [joint; 4].into(),
        drives: [exact(0.008); 8].into(),
    };
    let tendons = geometry.symmetric_tendons();
    SimFinger::new(geometry.finger(number), tendons, parameters, start()).unwrap()
}

/// The centre of the circle through three points.
fn circumcentre([a, b, c]: [Vector3<f64>; 3]) -> Vector3<f64> {
    let (ab, ac) = (b - a, c - a);
    let normal = ab.cross(&ac);
    let to = normal.cross(&ab) * ac.norm_squared() + ac.cross(&normal) * ab.norm_squared();
    a + to / (2.0 * normal.norm_squared())
}

/// Tensions about 15 N that give the torques, from the tip to the palm.
fn tensions(finger: &PlanarPlant, torque: &Vector4<f64>) -> [f64; 8] {
    let linear = finger.linear();
    let mut tensions = [15.0; 8];
    for joint in (0..4).rev() {
        let (flexor, extensor) = (2 * joint, 2 * joint + 1);
        let across = linear.torque(&tensions)[joint];
        let half = 0.5 * (torque[joint] - across) / linear.arms()[flexor][joint];
        tensions[flexor] += half;
        tensions[extensor] -= half;
    }
    tensions
}

/// A spring and a damper at the tip, gravity made up for, the posture held along the self-motion.
fn command(finger: &PlanarPlant, wanted: &Vector3<f64>, gravity: &Vector3<f64>) -> [f64; 8] {
    let (q, qd) = (finger.q(), finger.qd());
    let mechanism = finger.mechanism();
    let (pose, jacobian) = mechanism.kinematics(q);
    let linear = jacobian.fixed_rows::<3>(0);
    let force = (wanted - pose.position) * STIFFNESS - linear * qd * DAMPING;
    let mut torque: SVector<f64, 4> = linear.tr_mul(&force) + mechanism.gravity_torque(q, gravity);
    if let Some(free) = mechanism.self_motion(q) {
        torque += free * free.dot(&((start() - q) * 0.05 - qd * 2e-3));
    }
    tensions(finger, &torque)
}

#[test]
fn a_ball_in_three_fingers_feels_their_stiffness_and_stays() {
    let geometry = geometry();
    let gravity = vector(geometry.gravity);
    let fingers = NUMBERS.map(|number| plant(&geometry, number));
    let tips = NUMBERS.map(|number| {
        let finger: PlanarFinger = geometry.finger(number);
        finger.tip(&start()).position
    });
    let center = circumcentre(tips);
    let radius = (tips[0] - center).norm();
    let ball = SimObject::new(ObjectParameters::ball(0.05, radius + 1e-5), center).unwrap();
    let mut hand = SimHand::new(fingers, hand_parameters(gravity, 0.8))
        .unwrap()
        .with_object(ball);
    let middle = tips.iter().sum::<Vector3<f64>>() / 3.0;
    let wanted = tips.map(|tip| tip + (middle - tip) * SQUEEZE);
    let commands: [[f64; 8]; TIPS] =
        std::array::from_fn(|tip| command(&hand.fingers()[tip], &wanted[tip], &gravity));
    for (finger, commands) in hand.fingers_mut().iter_mut().zip(commands) {
        finger.reset(start(), commands).unwrap();
    }
    // Three equal springs make none turn that is pushed at their middle.
    let middle = middle - center;
    let mut run = |force: Vector3<f64>, seconds: f64| {
        let moment = middle.cross(&force);
        hand.push_object(Wrench { force, moment }).unwrap();
        let end = hand.time_s() + seconds;
        while hand.time_s() < end {
            let commands =
                std::array::from_fn(|tip| command(&hand.fingers()[tip], &wanted[tip], &gravity));
            hand.step(&commands).unwrap();
        }
        let contacts = hand.object_contacts();
        assert!(contacts.iter().all(|contact| contact.is_touching));
        assert!(contacts.iter().all(|contact| !contact.is_sliding));
        hand.object().unwrap().pose().transform(&middle)
    };
    // Its weight is held all the time.
    run(Vector3::zeros(), 0.5);
    for axis in 0..3 {
        let mut push = Vector3::zeros();
        push[axis] = 0.1;
        let plus = run(push, 0.4);
        let minus = run(-push, 0.4);
        let apparent = 0.2 / (plus - minus)[axis];
        let ratio = apparent / (3.0 * STIFFNESS);
        assert!((ratio - 1.0).abs() < 0.01, "axis {axis}: {ratio}");
        let later = run(-push, 0.4);
        assert!((later - minus).norm() < 1e-6, "{later} after {minus}");
    }
}
