//! Which postures bring a tip to a point, and what is said where none does.

use crate::support::{self, FINGERS, geometry};
use condor_hand::Real;
use condor_hand::kinematics::{InverseError, JointLimits, Kinematics, PlanarFinger, Redundancy};
use condor_hand::math::{exp, max, min, sin_cos};
use nalgebra::{Vector3, Vector4};
use proptest::prelude::*;

fn finger(index: usize) -> PlanarFinger {
    geometry().finger(index)
}

/// The finger with other lengths, if there can be such a finger.
fn long<T: Real>(finger: &PlanarFinger<T>, lengths: [T; 4]) -> PlanarFinger<T> {
    PlanarFinger::new(*finger.base(), lengths, *finger.bodies()).unwrap_or(*finger)
}

fn limits() -> JointLimits<f64, 4> {
    let geometry = geometry();
    JointLimits::new(geometry.qmin.into(), geometry.qmax.into()).unwrap()
}

/// A posture within the limits, from numbers in 0..=1.
fn posture(shares: [f64; 4]) -> Vector4<f64> {
    let limits = limits();
    let range = limits.upper() - limits.lower();
    limits.lower() + range.component_mul(&Vector4::from(shares))
}

fn shares() -> impl Strategy<Value = [f64; 4]> {
    prop::array::uniform4(0.0..=1.0_f64)
}

fn distance(finger: &PlanarFinger, q: &Vector4<f64>, target: &Vector3<f64>) -> f64 {
    (finger.tip(q).position - target).norm()
}

#[test]
fn the_four_branches_of_a_position_and_a_pitch() {
    let finger = finger(0);
    let target = finger.tip(&Vector4::new(0.2, 0.9, 1.0, 0.8)).position;
    let branches = finger
        .pitch_branches(&target, 2.7, &Vector4::zeros())
        .unwrap();
    let expected = [
        [0.2, 0.9, 1.0, 0.8],
        [0.2, 1.754, -1.0, 1.946],
        [-2.9416, 0.9834, 1.078, 0.6386],
        [-2.9416, 1.9016, -1.078, 1.8763],
    ];
    assert_eq!(branches.len(), 4);
    for (ours, expected) in branches.iter().zip(expected) {
        assert!((ours - Vector4::from(expected)).amax() < 6e-5, "{ours}");
        assert!(distance(&finger, ours, &target) < 1e-15);
    }
}

#[test]
fn a_coupled_posture_is_found_again() {
    for (ratio, q) in [(1.0, [0.1, 0.5, 0.7, 0.7]), (0.6, [0.1, 0.5, 0.7, 0.42])] {
        let (finger, q) = (finger(1), Vector4::from(q));
        let target = finger.tip(&q).position;
        let rule = Redundancy::Coupled(ratio);
        let ours = finger
            .inverse(&target, rule, &Vector4::zeros(), &limits())
            .unwrap();
        assert!((ours - q).amax() < 1e-13, "{ours}");
    }
}

#[test]
fn the_first_joint_stays_where_the_tip_is_on_its_axis() {
    let mut finger = finger(0);
    let q = Vector4::new(0.0, 0.9, 1.0, 0.8);
    let tip = finger.tip(&q).position - finger.base().position;
    let [first, rest @ ..] = *finger.lengths();
    finger = long(&finger, [first - tip.x, rest[0], rest[1], rest[2]]);
    assert!(finger.lengths()[0] > 0.0);
    let target = finger.tip(&q).position;
    let present = Vector4::new(0.3, 0.5, 0.5, 0.5);
    let ours = finger
        .inverse(&target, Redundancy::Pitch(2.7), &present, &limits())
        .unwrap();
    assert!(
        (ours - Vector4::new(0.3, 0.9, 1.0, 0.8)).amax() < 1e-12,
        "{ours}"
    );
}

#[test]
fn how_far_a_target_is_out_of_reach() {
    let finger = finger(1);
    let by = |target: [f64; 3], rule| {
        let target = finger.base().position + Vector3::from(target);
        match finger.inverse(&target, rule, &Vector4::zeros(), &limits()) {
            Err(InverseError::Unreachable { by }) => by,
            other => panic!("{other:?}"),
        }
    };
    // The straight finger is 0.1098 m long.
    for rule in [
        Redundancy::Pitch(0.0),
        Redundancy::Coupled(1.0),
        Redundancy::Coupled(0.7),
        Redundancy::Roomiest,
    ] {
        assert!((by([0.1198, 0.0, 0.0], rule) - 0.01).abs() < 1e-12);
    }
    // At the first axis a coupled finger would have to curl more than it can.
    let knuckle = finger.base().position + Vector3::x() * 0.0095;
    for (ratio, most) in [(1.0, 3.1), (0.7, core::f64::consts::PI / 1.7)] {
        let least = (0..=10_000)
            .map(|step| most * f64::from(step) * 1e-4)
            .map(|q2| distance(&finger, &Vector4::new(0.0, 0.0, q2, ratio * q2), &knuckle))
            .fold(1.0, min);
        let by = by([0.0; 3], Redundancy::Coupled(ratio));
        assert!((by - (least - 0.0095)).abs() < 1e-8, "{by} {least}");
    }
    let reach = finger.reach();
    assert!((reach.greatest - 0.1003).abs() < 1e-15 && reach.least.abs() < 1e-15);
}

#[test]
fn the_least_violation_is_named() {
    let finger = finger(1);
    let q = Vector4::new(0.1, 0.5, 1.8, 0.6);
    let target = finger.tip(&q).position;
    let error = finger
        .inverse(&target, Redundancy::Pitch(2.9), &q, &limits())
        .unwrap_err();
    let over = 1.8 - limits().upper()[2];
    assert!(
        matches!(error, InverseError::OutsideLimits { joint: 2, angle, by }
            if (angle - 1.8).abs() < 1e-12 && (by - over).abs() < 1e-12),
        "{error}"
    );
}

#[test]
fn what_cannot_be_computed_is_refused() {
    let finger = finger(1);
    let (present, target) = (Vector4::zeros(), Vector3::new(0.1, 0.0, -0.05));
    for ratio in [0.0, -1.0, 2.001, f64::NAN] {
        let rule = Redundancy::Coupled(ratio);
        let error = finger
            .inverse(&target, rule, &present, &limits())
            .unwrap_err();
        assert!(matches!(error, InverseError::Number(_)), "{error}");
    }
    let short =
        PlanarFinger::new(*finger.base(), [0.01, 0.0, 0.03, 0.02], *finger.bodies()).unwrap();
    let error = short
        .inverse(&target, Redundancy::Roomiest, &present, &limits())
        .unwrap_err();
    assert!(matches!(error, InverseError::Number(_)), "{error}");
    let error = finger
        .inverse(&target, Redundancy::Pitch(f64::NAN), &present, &limits())
        .unwrap_err();
    assert!(matches!(error, InverseError::Number(_)), "{error}");
    assert!(JointLimits::new(Vector4::repeat(1.0), Vector4::repeat(1.0)).is_err());
    let open = Vector4::repeat(f64::INFINITY);
    assert!(JointLimits::new(-open, open).is_err());
}

// No pitch on a fine grid has more room.
#[test]
fn the_roomiest_posture_has_the_most_room() {
    let (finger, limits) = (finger(1), limits());
    for shares in [
        [0.5, 0.3, 0.6, 0.2],
        [0.2, 0.9, 0.1, 0.9],
        [0.7, 0.1, 0.2, 0.8],
    ] {
        let q = posture(shares);
        let target = finger.tip(&q).position;
        let ours = finger
            .inverse(&target, Redundancy::Roomiest, &q, &limits)
            .unwrap();
        let room = |q: &Vector4<f64>| limits.margin(&Vector4::new(0.0, q.y, q.z, q.w));
        assert!(distance(&finger, &ours, &target) < 1e-14);
        let best = (-7000..7000)
            .filter_map(|step| {
                let rule = Redundancy::Pitch(f64::from(step) * 1e-3);
                finger.inverse(&target, rule, &q, &limits).ok()
            })
            .map(|q| room(&q))
            .fold(f64::MIN, max);
        assert!(room(&ours) >= best - 1e-8, "{} {best}", room(&ours));
        assert!(room(&ours) <= best + 2e-3, "{} {best}", room(&ours));
    }
}

// Any two signs of the last joints, each of which another family of postures has.
#[test]
fn the_roomiest_posture_is_found_on_any_side() {
    let finger = finger(2);
    for (third, fourth) in [(0.8, 0.6), (0.8, -0.6), (-0.8, 0.6), (-0.8, -0.6)] {
        let q = Vector4::new(0.1, 0.4, third, fourth);
        let limits = JointLimits::new(q.add_scalar(-0.3), q.add_scalar(0.2)).unwrap();
        let target = finger.tip(&q).position;
        let rule = Redundancy::Roomiest;
        let ours = finger
            .inverse(&target, rule, &Vector4::zeros(), &limits)
            .unwrap();
        assert!(distance(&finger, &ours, &target) < 1e-14);
        assert!(limits.margin(&ours) >= 0.2 - 1e-8 && limits.contains(&ours));
    }
}

#[test]
fn the_nearest_of_several_branches_is_taken() {
    let finger = finger(0);
    let target = finger.tip(&Vector4::new(0.2, 0.9, 1.0, 0.8)).position;
    let wide = JointLimits::new(Vector4::repeat(-3.2), Vector4::repeat(3.2)).unwrap();
    let branches = finger
        .pitch_branches(&target, 2.7, &Vector4::zeros())
        .unwrap();
    for branch in &branches {
        let near = branch.add_scalar(0.05);
        let ours = finger
            .inverse(&target, Redundancy::Pitch(2.7), &near, &wide)
            .unwrap();
        assert!((ours - branch).amax() < 1e-12, "{ours}{branch}");
    }
}

#[test]
fn angles_beyond_half_a_turn_are_found_where_limits_want_them() {
    let finger = finger(2);
    let q = Vector4::new(0.1, 3.6, 0.7, 0.5);
    let limits = JointLimits::new(q.add_scalar(-0.3), q.add_scalar(0.2)).unwrap();
    let target = finger.tip(&q).position;
    let rule = Redundancy::Pitch(PlanarFinger::pitch(&q));
    let ours = finger
        .inverse(&target, rule, &Vector4::zeros(), &limits)
        .unwrap();
    assert!((ours - q).amax() < 1e-12, "{ours}");
}

// What rounding puts outside a limit is put back onto it.
#[test]
fn a_finger_gets_to_its_limits() {
    let limits = limits();
    for index in 0..FINGERS {
        let finger = finger(index);
        for corner in 0..16_u8 {
            let share = |joint: u8| f64::from(corner >> joint & 1);
            let q = posture([share(0), share(1), share(2), share(3)]);
            let target = finger.tip(&q).position;
            let rule = Redundancy::Pitch(PlanarFinger::pitch(&q));
            let ours = finger
                .inverse(&target, rule, &Vector4::zeros(), &limits)
                .unwrap();
            assert!((ours - q).amax() < 1e-13 && limits.contains(&ours));
        }
    }
}

fn anything() -> impl Strategy<Value = f64> {
    prop_oneof![
        3 => prop::num::f64::ANY,
        4 => -0.3..0.3_f64,
        1 => prop::sample::select(vec![
            0.0, -0.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, f64::MIN,
            f64::MIN_POSITIVE, 1e-9, 1e9, 1e16, 1e154, 1e160,
        ]),
    ]
}

proptest! {
    #![proptest_config(support::runs())]

    #[test]
    fn the_posture_of_a_position_and_a_pitch_is_unique_within_the_limits(
        shares in shares(),
        index in 0..FINGERS,
        present in shares(),
    ) {
        let (finger, q, limits) = (finger(index), posture(shares), limits());
        let target = finger.tip(&q).position;
        let pitch = PlanarFinger::pitch(&q);
        let branches = finger.pitch_branches(&target, pitch, &posture(present)).unwrap();
        for branch in &branches {
            prop_assert!(distance(&finger, branch, &target) < 1e-14);
            let (sine, cosine) = sin_cos(PlanarFinger::pitch(branch) - pitch);
            prop_assert!(sine.abs() < 1e-14 && cosine > 0.0);
        }
        let within = branches.iter().filter(|branch| limits.margin(branch) > -1e-9).count();
        prop_assert_eq!(within, 1);
        let rule = Redundancy::Pitch(pitch);
        let ours = finger.inverse(&target, rule, &posture(present), &limits).unwrap();
        prop_assert!((ours - q).amax() < 1e-12);
        prop_assert!(limits.contains(&ours));
    }

    #[test]
    fn a_coupled_finger_finds_its_posture(
        shares in shares(),
        ratio in prop_oneof![1 => Just(1.0), 1 => 0.999..1.001_f64, 4 => 0.01..=2.0_f64],
        index in 0..FINGERS,
        sizes in prop::array::uniform3(-4.0..0.0_f64),
        usual in any::<bool>(),
    ) {
        let (mut finger, mut q) = (finger(index), posture(shares));
        if !usual {
            let [l1, l2, l3] = sizes.map(|size| 0.1 * exp(size));
            finger = long(&finger, [0.01, l1, l2, l3]);
        }
        // Where the distance of the tip falls for certain.
        q.z = min(q.z, 0.999 * core::f64::consts::PI / (1.0 + ratio));
        q.w = ratio * q.z;
        let target = finger.tip(&q).position;
        let branches = finger.coupled_branches(&target, ratio, &q).unwrap();
        for branch in &branches {
            prop_assert!(distance(&finger, branch, &target) < 1e-14);
            prop_assert!((branch.w - ratio * branch.z).abs() < 1e-15);
        }
        let nearest = branches.iter().map(|branch| (branch - q).amax()).fold(1.0, min);
        prop_assert!(nearest < 1e-10, "{}", nearest);
    }

    #[test]
    fn the_roomiest_posture_reaches_and_has_room(shares in shares(), index in 0..FINGERS) {
        let (finger, q, limits) = (finger(index), posture(shares), limits());
        let target = finger.tip(&q).position;
        let ours = finger.inverse(&target, Redundancy::Roomiest, &q, &limits).unwrap();
        prop_assert!(distance(&finger, &ours, &target) < 1e-13);
        let room = |q: &Vector4<f64>| limits.margin(&Vector4::new(0.0, q.y, q.z, q.w));
        prop_assert!(limits.contains(&ours));
        prop_assert!(room(&ours) >= room(&q) - 1e-8, "{} {}", room(&ours), room(&q));
    }

    #[test]
    fn single_precision_reaches_to_a_micrometre(shares in shares(), index in 0..FINGERS) {
        let finger = geometry().finger::<f32>(index);
        let q = posture(shares).map(f32::of);
        let limits = limits();
        let limits = JointLimits::new(limits.lower().map(f32::of), limits.upper().map(f32::of));
        let limits = limits.unwrap();
        let q = limits.clamp(&q);
        let target = finger.tip(&q).position;
        for rule in [Redundancy::Pitch(PlanarFinger::pitch(&q)), Redundancy::Roomiest] {
            let ours = finger.inverse(&target, rule, &q, &limits).unwrap();
            prop_assert!((finger.tip(&ours).position - target).norm() < 1e-6);
        }
    }

    #[test]
    fn no_number_of_single_precision_makes_an_answer_that_is_none(
        target in prop::array::uniform3(anything()),
        lengths in prop::array::uniform4(anything()),
        usual in any::<bool>(),
        by in prop_oneof![anything(), 0.0..2.0_f64],
    ) {
        let mut finger = geometry().finger::<f32>(0);
        if !usual {
            finger = long(&finger, lengths.map(|length| f32::of(length.abs())));
        }
        let target = Vector3::from(target).map(f32::of);
        let limits = limits();
        let limits = JointLimits::new(limits.lower().map(f32::of), limits.upper().map(f32::of));
        let (limits, present, by) = (limits.unwrap(), Vector4::zeros(), f32::of(by));
        for rule in [Redundancy::Pitch(by), Redundancy::Coupled(by), Redundancy::Roomiest] {
            if let Ok(q) = finger.inverse(&target, rule, &present, &limits) {
                prop_assert!(limits.contains(&q));
                let size: f32 = finger.lengths().iter().sum();
                let error = (finger.tip(&q).position - target).norm();
                prop_assert!(error <= 1e-5 * (size + finger.base().position.norm()), "{error}");
            }
        }
    }

    #[test]
    fn no_number_makes_an_answer_that_is_none(
        target in prop::array::uniform3(anything()),
        lengths in prop::array::uniform4(anything()),
        usual in any::<bool>(),
        present in prop::array::uniform4(anything()),
        by in prop_oneof![anything(), 0.0..2.0_f64],
    ) {
        let mut finger = finger(0);
        if !usual {
            finger = long(&finger, lengths.map(f64::abs));
        }
        let (target, present) = (Vector3::from(target), Vector4::from(present));
        let limits = limits();
        for rule in [Redundancy::Pitch(by), Redundancy::Coupled(by), Redundancy::Roomiest] {
            match finger.inverse(&target, rule, &present, &limits) {
                Ok(q) => prop_assert!(limits.contains(&q)),
                Err(InverseError::Unreachable { by }) => {
                    prop_assert!(by.is_finite() && by > 0.0, "{rule:?} {by}");
                }
                Err(InverseError::OutsideLimits { angle, by, .. }) => {
                    prop_assert!(angle.is_finite() && by > 0.0, "{rule:?} {angle} {by}");
                }
                Err(_) => {}
            }
        }
        for branches in [
            finger.pitch_branches(&target, by, &present),
            finger.coupled_branches(&target, by, &present),
        ].into_iter().flatten() {
            prop_assert!(!branches.is_empty());
            for q in &branches {
                prop_assert!(q.iter().all(|angle| angle.is_finite()), "{q}");
                let size: f64 = finger.lengths().iter().sum();
                prop_assert!(distance(&finger, q, &target) <= 1e-11 * size + 1e-14 * finger.base().position.norm());
            }
        }
    }
}
