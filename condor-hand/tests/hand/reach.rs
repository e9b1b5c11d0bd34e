//! Postures for poses: on two arms of seven joints, on a finger, and where there are none.

#![allow(
    clippy::float_cmp,
    clippy::disallowed_methods,
    reason = "limits are met to the last bit; what is expected may differ in its last bits on another host"
)]

use crate::support::arms::{Arm, Joints, Numbers, arms, iiwa, panda};
use crate::support::{geometry, matrix, reference, runs, vector};
use condor_hand::kinematics::{
    Chain, ChainBody, ChainJoint, ChainMotion, JointLimits, Kinematics, PoseSearch, Reach,
};
use condor_hand::{Pose, rotation_about, rotation_vector};
use nalgebra::{Matrix3, SVector, Vector3};
use proptest::prelude::*;
use serde::Deserialize;

/// Poses of the flanges, computed by Pinocchio 4.1.0 from the makers' descriptions (`buildModelFromUrdf`,
/// `framesForwardKinematics`).
#[derive(Deserialize)]
struct Poses {
    iiwa14: [Flange; 5],
    panda: [Flange; 5],
}

#[derive(Deserialize)]
#[allow(non_snake_case, reason = "the names in the file")]
struct Flange {
    q: [f64; 7],
    p: [f64; 3],
    R: [[f64; 3]; 3],
}

#[test]
fn the_flanges_of_two_arms_are_where_pinocchio_has_them() {
    let Poses { iiwa14, panda } = reference("arms.json");
    for (arm, flanges) in arms().iter().zip([iiwa14, panda]) {
        for flange in flanges {
            let tip = arm.chain.tip(&flange.q.into());
            assert!((tip.position - vector(flange.p)).amax() <= 1e-10);
            assert!((tip.rotation - matrix(flange.R)).amax() <= 1e-10);
        }
    }
}

/// The most that any of many searches needed.
#[derive(Debug, Default)]
struct Most {
    missed: u32,
    restarted: u32,
    restarts: u32,
    steps: u32,
    sum_of_steps: u64,
    position: f64,
    rotation: f64,
}

/// Searches for the poses of `count` postures, from the middle of the limits or from other postures.
fn sweep(arm: &Arm, count: u32, is_from_middle: bool) -> Most {
    let search = PoseSearch::new(arm.limits);
    let mut numbers = Numbers(u64::from(count));
    let mut most = Most::default();
    for _ in 0..count {
        let target = arm.chain.tip(&numbers.posture(&arm.limits));
        let start = if is_from_middle {
            arm.limits.middle()
        } else {
            numbers.posture(&arm.limits)
        };
        let found = search.run(&arm.chain, &target, &start).unwrap();
        check(&search, &arm.chain, &target, &found);
        most.sum_of_steps += u64::from(found.steps);
        most.missed += u32::from(!found.is_reached);
        if found.is_reached {
            most.restarted += u32::from(found.restarts > 0);
            most.restarts = most.restarts.max(found.restarts);
            most.steps = most.steps.max(found.steps);
            most.position = most.position.max(found.position);
            most.rotation = most.rotation.max(found.rotation);
        }
    }
    most
}

/// Checks what a result says of itself.
fn check<const N: usize>(
    search: &PoseSearch<N>,
    mechanism: &impl Kinematics<N>,
    target: &Pose,
    found: &Reach<N>,
) {
    assert_eq!(search.limits.clamp(&found.posture), found.posture);
    let tip = mechanism.tip(&found.posture);
    assert!(((target.position - tip.position).norm() - found.position).abs() <= 1e-12);
    let turn = rotation_vector(&(target.rotation * tip.rotation.transpose()));
    assert!((turn.norm() - found.rotation).abs() <= 1e-12);
    let is_near = found.position <= search.position && found.rotation <= search.rotation;
    assert_eq!(found.is_reached, is_near);
    assert!(found.restarts <= search.restarts);
    assert!(found.steps <= (search.restarts + 1) * search.steps + 100);
}

#[test]
fn seven_joints_reach_every_pose_that_they_have() {
    for arm in arms() {
        for is_from_middle in [true, false] {
            let most = sweep(&arm, 1000, is_from_middle);
            assert_eq!(most.missed, 0, "{}: {most:?}", arm.name);
        }
    }
}

// `cargo test --release -p condor-hand --all-features -- --ignored --nocapture a_hundred_thousand`
#[test]
#[ignore = "takes a minute"]
fn a_hundred_thousand_poses_of_each_arm() {
    for arm in arms() {
        for is_from_middle in [true, false] {
            let count = 100_000;
            let most = sweep(&arm, count, is_from_middle);
            let from = if is_from_middle {
                "the middle"
            } else {
                "others"
            };
            let mean = most.sum_of_steps / u64::from(count);
            println!(
                "{} from {from}: {most:?}, {mean} steps in the mean",
                arm.name
            );
            assert!(most.missed <= count / 200, "{}: {most:?}", arm.name);
        }
    }
}

// A redundant arm that comes from a posture near by takes the preferred one, if that has the pose. From beside a singular
// posture it may arrive on another branch.
#[test]
fn the_posture_is_the_preferred_one_where_that_reaches_the_target() {
    for arm in arms() {
        let mut numbers = Numbers(7);
        let mut same = 0;
        for _ in 0..200 {
            let preferred = numbers.posture(&arm.limits);
            let nearby = Joints::from_fn(|_, _| 0.4 * numbers.share() - 0.2);
            let search = PoseSearch {
                preferred: Some(preferred),
                ..PoseSearch::new(arm.limits)
            };
            let target = arm.chain.tip(&preferred);
            let start = preferred + nearby;
            let found = search.run(&arm.chain, &target, &start).unwrap();
            check(&search, &arm.chain, &target, &found);
            assert!(found.is_reached);
            same += u32::from((found.posture - preferred).amax() <= 1e-5);
        }
        assert!(same >= 190, "{}: {same} of 200", arm.name);
    }
}

#[test]
fn small_moves_stay_on_the_branch_and_return() {
    for arm in arms() {
        let mut numbers = Numbers(8);
        let mut same = 0;
        for _ in 0..200 {
            let home = numbers.posture(&arm.limits);
            let search = PoseSearch {
                preferred: Some(home),
                restarts: 0,
                ..PoseSearch::new(arm.limits)
            };
            let mut target = arm.chain.tip(&home);
            target.position += numbers.direction() * 0.01;
            let away = search.run(&arm.chain, &target, &home).unwrap();
            let home_pose = arm.chain.tip(&home);
            let back = search.run(&arm.chain, &home_pose, &away.posture).unwrap();
            same += u32::from((back.posture - home).amax() <= 1e-5);
        }
        assert!(same >= 190, "{}: {same} of 200", arm.name);
    }
}

#[test]
fn a_target_out_of_reach_ends_within_the_bound_and_says_how_far_it_is() {
    for Arm { chain, limits, .. } in arms() {
        let search = PoseSearch {
            restarts: 8,
            ..PoseSearch::new(limits)
        };
        let mut numbers = Numbers(9);
        for _ in 0..20 {
            let shoulder = Vector3::z() * 0.35;
            let target = Pose {
                position: shoulder + numbers.direction() * 2.0,
                rotation: rotation_about(&numbers.direction(), 3.0 * numbers.share()),
            };
            let found = search.run(&chain, &target, &limits.middle()).unwrap();
            check(&search, &chain, &target, &found);
            assert!(!found.is_reached && found.restarts == 8);
            // Neither arm is longer than 1.3 m from its shoulder on.
            assert!(found.position > 0.7 && found.position < 2.0, "{found:?}");
        }
    }
}

#[test]
fn a_finger_in_closed_form_reaches_the_poses_that_it_has() {
    let geometry = geometry();
    let limits = JointLimits::new(geometry.qmin.into(), geometry.qmax.into()).unwrap();
    let search = PoseSearch::new(limits);
    let finger = geometry.finger(0);
    let mut numbers = Numbers(4);
    for _ in 0..200 {
        let target = finger.tip(&numbers.posture(&limits));
        let found = search.run(&finger, &target, &limits.middle()).unwrap();
        check(&search, &finger, &target, &found);
        assert!(found.is_reached, "{found:?}");
    }
}

#[test]
fn slides_without_a_turn_reach_a_position_and_report_the_rotation() {
    let slide = |axis| ChainJoint::new(Pose::identity(), ChainMotion::Prismatic(axis));
    let gantry = Chain::new(
        Pose::identity(),
        [Vector3::x(), Vector3::y(), Vector3::z()].map(slide),
        [ChainBody::massless(); 3],
        Vector3::zeros(),
    )
    .unwrap();
    let search = PoseSearch::new(JointLimits::new([0.0; 3].into(), [1.0; 3].into()).unwrap());
    let target = Pose::at(0.3, 0.9, 0.5);
    let found = search.run(&gantry, &target, &SVector::zeros()).unwrap();
    assert!(found.is_reached);
    let turned = Pose {
        rotation: rotation_about(&Vector3::x(), 0.5),
        ..target
    };
    let found = search.run(&gantry, &turned, &SVector::zeros()).unwrap();
    assert!(!found.is_reached && found.position <= 1e-6);
    assert!((found.rotation - 0.5).abs() <= 1e-12);
}

#[test]
fn numbers_that_cannot_be_are_refused_by_name() {
    let Arm { chain, limits, .. } = iiwa();
    let search = PoseSearch::new(limits);
    let target = chain.tip(&limits.middle());
    let refusal = |search: PoseSearch<7>, target: &Pose, present: &Joints| {
        search.run(&chain, target, present).unwrap_err().to_string()
    };
    let mut lost = target;
    lost.position.y = f64::NAN;
    let said = refusal(search, &lost, &limits.middle());
    assert!(said.starts_with("the tip: a coordinate, m, is "), "{said}");
    let mut stretched = target;
    stretched.rotation *= 1.001;
    let said = refusal(search, &stretched, &limits.middle());
    assert!(
        said.starts_with("the tip: the error of the rotation"),
        "{said}"
    );
    let mut unread = limits.middle();
    unread[3] = f64::INFINITY;
    let said = refusal(search, &target, &unread);
    assert!(said.starts_with("joint 3: the present position"), "{said}");
    let unwished = PoseSearch {
        preferred: Some(unread),
        ..search
    };
    let said = refusal(unwished, &target, &limits.middle());
    assert!(
        said.starts_with("joint 3: the preferred position"),
        "{said}"
    );
    let exact = PoseSearch {
        rotation: 0.0,
        ..search
    };
    let said = refusal(exact, &target, &limits.middle());
    assert!(
        said.starts_with("the accuracy of the rotation, rad, is 0"),
        "{said}"
    );
}

fn vectors(range: std::ops::RangeInclusive<f64>) -> impl Strategy<Value = Vector3<f64>> {
    [(); 3].map(|()| range.clone()).prop_map(Vector3::from)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..runs() })]

    #[test]
    fn any_pose_has_an_answer_within_the_limits(
        position in vectors(-2.0..=2.0),
        turn in vectors(-3.0..=3.0),
        start in prop::array::uniform7(-9.0..=9.0_f64),
    ) {
        let Arm { chain, limits, .. } = panda();
        let search = PoseSearch { restarts: 2, ..PoseSearch::new(limits) };
        let angle = turn.norm();
        let rotation = rotation_about(&(turn / angle), angle);
        let target = Pose { rotation, position };
        let found = search.run(&chain, &target, &start.into()).unwrap();
        check(&search, &chain, &target, &found);
    }

    #[test]
    fn no_number_makes_a_search_panic(
        position in prop::array::uniform3(any::<f64>()),
        entry in any::<f64>(),
        start in prop::array::uniform7(any::<f64>()),
        steps in 0..20_u32,
    ) {
        let Arm { chain, limits, .. } = panda();
        let search = PoseSearch { restarts: 2, steps, ..PoseSearch::new(limits) };
        let mut target = Pose { position: position.into(), ..Pose::identity() };
        let answer = search.run(&chain, &target, &start.into());
        if let Ok(found) = answer {
            prop_assert_eq!(limits.clamp(&found.posture), found.posture);
        }
        target.rotation.m12 = entry;
        if let Ok(found) = search.run(&chain, &target, &start.into()) {
            prop_assert_eq!(limits.clamp(&found.posture), found.posture);
        }
    }

    #[test]
    fn a_rotation_vector_is_the_inverse_of_a_rotation(turn in vectors(-1.8..=1.8), small in 0..16_i32) {
        let turn = turn * 10.0_f64.powi(-small);
        let angle = turn.norm();
        let back = rotation_vector(&rotation_about(&(turn / angle), angle));
        prop_assert!((back - turn).amax() <= 1e-15 + 1e-14 * angle, "{turn} {back}");
    }
}

#[test]
fn half_a_turn_and_none_have_their_vectors() {
    assert_eq!(rotation_vector(&Matrix3::identity()), Vector3::zeros());
    for axis in [Vector3::x(), Vector3::y(), Vector3::new(0.6, 0.0, -0.8)] {
        let half = std::f64::consts::PI;
        let vector = rotation_vector(&rotation_about(&axis, half));
        assert!(
            (vector - axis * half)
                .amax()
                .min((vector + axis * half).amax())
                <= 1e-14
        );
    }
}
