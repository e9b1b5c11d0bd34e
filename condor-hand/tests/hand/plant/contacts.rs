//! What tips and an object do to each other.

use condor_hand::grasp::Wrench;
use condor_hand::plant::{
    HandParameters, JointParameters, ObjectParameters, SimFinger, SimHand, SimObject,
};
use condor_hand::transmission::Linear;
use nalgebra::{Matrix3, Vector3};

use super::mechanisms::{Slider, exact, finger, free_joint, hand_parameters, surface};

/// Two tendons for each of three joints.
type SliderFinger = SimFinger<Slider, Linear<3, 6>, 3, 6>;
type SliderHand<const F: usize> = SimHand<Slider, Linear<3, 6>, F, 3, 6>;

const NOTHING: [f64; 6] = [0.0; 6];

const RADIUS: f64 = 0.03;

fn slider(base: Vector3<f64>, joint: JointParameters) -> SliderFinger {
    finger(Slider { mass: 0.05, base }, joint, exact(0.01))
}

fn ball(center: Vector3<f64>) -> SimObject {
    SimObject::new(ObjectParameters::ball(0.1, RADIUS), center).unwrap()
}

fn force(x: f64, y: f64, z: f64) -> Wrench {
    Wrench {
        force: Vector3::new(x, y, z),
        moment: Vector3::zeros(),
    }
}

/// A hand with no finger.
fn empty(parameters: HandParameters) -> SliderHand<0> {
    SimHand::new([], parameters).unwrap()
}

fn run<const F: usize>(hand: &mut SliderHand<F>, steps: usize) {
    for _ in 0..steps {
        hand.step(&[NOTHING; F]).unwrap();
    }
}

/// A ball that is too large and too heavy to be anything but a plane at z = 0.
fn floor() -> SimObject {
    let radius = 1e6;
    let parameters = ObjectParameters {
        mass: 1e12,
        inertia: Matrix3::from_diagonal_element(1e24),
        radius,
    };
    SimObject::new(parameters, Vector3::new(0.0, 0.0, -radius)).unwrap()
}

#[test]
fn an_object_that_is_put_in_place_of_another_is_touched_anew() {
    let mut hand = held::<3>(80.0, 1.0);
    run(&mut hand, 10);
    assert!(hand.object_contacts().iter().all(|tip| tip.is_touching));
    hand.put_object(Some(ball(Vector3::new(0.0, 0.0, 1.0))));
    assert!(hand.object_contacts().iter().all(|tip| !tip.is_touching));
    run(&mut hand, 10);
    assert_eq!(hand.object().unwrap().velocity().norm(), 0.0);
    hand.put_object(None);
    run(&mut hand, 10);
    assert_eq!(hand.object(), None);
}

#[test]
fn a_tip_on_a_floor_stays_within_the_cone_of_friction() {
    let mut parameters = hand_parameters(Vector3::zeros(), 0.5);
    parameters.tip_radius = 0.005;
    let tip = slider(Vector3::new(0.0, 0.0, 0.005), free_joint());
    let mut hand = SimHand::new([tip], parameters)
        .unwrap()
        .with_object(floor());
    for (push, slides) in [(0.9, false), (1.1, true)] {
        hand.push_tip(0, force(push, 0.0, -2.0)).unwrap();
        run(&mut hand, 400);
        let [contact] = hand.object_contacts();
        assert_eq!(contact.is_sliding, slides, "{push} N");
        let across = contact.force.xy().norm();
        assert!(across <= 0.5 * contact.force.z + 1e-12);
        let moved = hand.fingers()[0].q().x;
        assert_eq!(moved > 1e-3, slides, "{moved} m");
    }
    // The anchor came along: what has slid stops, and is not pulled back.
    let before = hand.fingers()[0].q().x;
    hand.push_tip(0, force(0.0, 0.0, -2.0)).unwrap();
    run(&mut hand, 200);
    assert!(!hand.object_contacts()[0].is_sliding);
    assert!(hand.fingers()[0].q().x > before);
    hand.push_tip(0, force(0.0, 0.0, 1.0)).unwrap();
    run(&mut hand, 400);
    assert!(!hand.object_contacts()[0].is_touching);
    assert_eq!(hand.object_contacts()[0].force, Vector3::zeros());
    assert!(hand.push_tip(1, Wrench::zero()).is_err());
    assert!(hand.push_tip(0, force(f64::NAN, 0.0, 0.0)).is_err());
}

#[test]
fn a_blow_passes_momentum_on_and_makes_none() {
    // Off centre, so that the ball turns as well.
    let offset = 0.01;
    let mut parameters = hand_parameters(Vector3::zeros(), 0.5);
    parameters.tip_radius = 0.01;
    let tip = slider(Vector3::new(-0.06, offset, 0.0), free_joint());
    let mut hand = SimHand::new([tip], parameters)
        .unwrap()
        .with_object(ball(Vector3::zeros()));
    hand.push_tip(0, force(1.0, 0.0, 0.0)).unwrap();
    run(&mut hand, 10);
    hand.push_tip(0, Wrench::zero()).unwrap();
    let given = 0.05 * hand.fingers()[0].qd();
    assert!((given.x - 0.025).abs() < 1e-12, "{given}");
    run(&mut hand, 100);
    let object = hand.object().unwrap();
    assert!(object.velocity().x > 0.1, "{}", object.velocity());
    assert!(object.angular_momentum().z.abs() > 1e-6);
    let tip = &hand.fingers()[0];
    let total = 0.05 * tip.qd() + 0.1 * object.velocity();
    assert!((total - given).norm() < 1e-15, "{total}");
    let energy = 0.025 * tip.qd().norm_squared()
        + 0.05 * object.velocity().norm_squared()
        + 0.5 * object.angular_momentum().dot(&object.angular_velocity());
    assert!(energy < 0.025 * 0.25, "{energy} J");
}

#[test]
fn a_free_body_keeps_its_angular_momentum_and_turns_about_all_axes() {
    let parameters = ObjectParameters {
        mass: 0.1,
        inertia: Matrix3::new(2e-5, 1e-6, 0.0, 1e-6, 3e-5, 0.0, 0.0, 0.0, 4e-5),
        radius: RADIUS,
    };
    let object = SimObject::new(parameters, Vector3::zeros()).unwrap();
    let spin = Vector3::new(0.1, 10.0, 0.2);
    let mut hand = empty(hand_parameters(Vector3::zeros(), 0.5))
        .with_object(object.moving(Vector3::new(1.0, 2.0, 3.0), spin).unwrap());
    let before = *hand.object().unwrap();
    let energy =
        |object: &SimObject| 0.5 * object.angular_momentum().dot(&object.angular_velocity());
    let mut flipped = false;
    for _ in 0..1000 {
        run(&mut hand, 1);
        let object = hand.object().unwrap();
        assert_eq!(object.angular_momentum(), before.angular_momentum());
        flipped |= object.pose().rotation.m22 < -0.5;
        assert!((energy(object) / energy(&before) - 1.0).abs() < 5e-3);
        assert!((object.orientation().norm_squared() - 1.0).abs() < 1e-14);
    }
    assert!(flipped);
    let position = hand.object().unwrap().pose().position;
    assert!(
        (position - Vector3::new(2.5, 5.0, 7.5)).norm() < 1e-9,
        "{position}"
    );
}

fn count(n: usize) -> f64 {
    f64::from(u32::try_from(n).unwrap())
}

/// Tips around a ball, each on springs along x, y, z that press it to the ball with `squeeze`.
fn held<const F: usize>(stiffness: f64, squeeze: f64) -> SliderHand<F> {
    let fingers = std::array::from_fn(|number| {
        let angle = std::f64::consts::TAU * count(number) / count(F);
        let out = Vector3::new(libm::cos(angle), libm::sin(angle), 0.0);
        let base = out * (RADIUS - squeeze / stiffness);
        let mut joint = free_joint();
        (joint.stiffness, joint.friction.viscous) = (stiffness, 5.0);
        let mut finger = slider(base, joint);
        finger.reset(out * (squeeze / stiffness), NOTHING).unwrap();
        finger
    });
    let mut parameters = hand_parameters(Vector3::zeros(), 0.8);
    parameters.tip_object = surface(0.8);
    SimHand::new(fingers, parameters)
        .unwrap()
        .with_object(ball(Vector3::zeros()))
}

fn apparent_stiffness<const F: usize>() {
    let (stiffness, squeeze) = (80.0, 1.0);
    let mut hand = held::<F>(stiffness, squeeze);
    run(&mut hand, 300);
    let rest = hand.object().unwrap().pose();
    assert!(rest.position.norm() < 1e-6, "{}", rest.position);
    for axis in 0..3 {
        let mut push = Vector3::zeros();
        push[axis] = 0.1;
        hand.push_object(Wrench {
            force: push,
            moment: Vector3::zeros(),
        })
        .unwrap();
        run(&mut hand, 300);
        let moved = hand.object().unwrap().pose().position - rest.position;
        let apparent = 0.1 / moved[axis];
        let ratio = apparent / (count(F) * stiffness);
        assert!((ratio - 1.0).abs() < 5e-3, "{F} tips, axis {axis}: {ratio}");
        assert!(hand.object_contacts().iter().all(|tip| !tip.is_sliding));
        // Held on, it stays where it is.
        run(&mut hand, 400);
        let later = hand.object().unwrap().pose().position - rest.position;
        assert!((later - moved).norm() < 1e-9, "{later} after {moved}");
        hand.push_object(Wrench::zero()).unwrap();
        run(&mut hand, 300);
        let back = hand.object().unwrap().pose();
        assert!(
            (back.position - rest.position).norm() < 1e-8,
            "{}",
            back.position
        );
        assert!((back.rotation - rest.rotation).norm() < 1e-7);
    }
}

#[test]
fn a_ball_held_by_three_tips_feels_the_stiffness_of_all_and_does_not_creep() {
    apparent_stiffness::<3>();
}

#[test]
fn a_ball_held_by_four_tips_feels_the_stiffness_of_all_and_does_not_creep() {
    apparent_stiffness::<4>();
}

#[test]
fn a_held_ball_turns_against_the_springs_of_the_tips() {
    let (stiffness, squeeze) = (80.0, 1.0);
    let mut hand = held::<3>(stiffness, squeeze);
    run(&mut hand, 300);
    let moment = Vector3::new(0.0, 0.0, 1e-3);
    hand.push_object(Wrench {
        force: Vector3::zeros(),
        moment,
    })
    .unwrap();
    run(&mut hand, 600);
    let pose = hand.object().unwrap().pose();
    let angle = libm::atan2(pose.rotation.m21, pose.rotation.m11);
    // Each spring pulls its tip, at the radius r, to a point at r - squeeze / k on the same ray:
    // with the moment k r (r - squeeze / k) sin a.
    let expected = 1e-3 / (3.0 * RADIUS * (stiffness * RADIUS - squeeze));
    assert!(
        (angle / expected - 1.0).abs() < 1e-2,
        "{angle} rad, not {expected} rad"
    );
}

#[test]
fn a_ball_let_go_falls() {
    let mut hand = held::<3>(80.0, 1.0);
    run(&mut hand, 100);
    // More than three contacts of 1 N can hold at a friction of 0.8.
    hand.push_object(force(0.0, 0.0, -6.0)).unwrap();
    run(&mut hand, 200);
    assert!(hand.object().unwrap().pose().position.z < -0.05);
    assert!(hand.object_contacts().iter().all(|tip| !tip.is_touching));
}

#[test]
fn the_same_run_gives_the_same_bits() {
    let end = || {
        let mut hand = held::<4>(80.0, 1.0);
        hand.push_object(force(0.3, 0.2, -0.1)).unwrap();
        for step in 0..400 {
            let pull = f64::from(step % 7);
            hand.step(&[[pull, 1.0, pull, 1.0, pull, 1.0]; 4]).unwrap();
        }
        let object = *hand.object().unwrap();
        (object, hand.fingers().each_ref().map(|finger| *finger.q()))
    };
    assert_eq!(end(), end());
}
