//! Numbers that no sensor should give: errors or finite answers, never NaN and never a panic.

use condor_hand::grasp::{
    ContactFriction, Contacts, GraspError, GraspOutput, GraspStiffness, GraspTuning, Normals,
    Posture, SpatialGain, Squeeze, TorqueLimits, TuningSurface, Wrench,
};
use nalgebra::{Matrix6, SVector, Vector3};
use proptest::prelude::*;

use super::law::{hand, states};

/// Numbers of all sizes, the worst among them.
fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -0.1..0.1,
        1 => Just(0.0),
        1 => any::<f64>(),
        1 => prop::sample::select(vec![
            f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, f64::MIN_POSITIVE, 5e-324, -0.0,
            1e-160, 1e160, 1.0, -1.0, 1e-9,
        ]),
    ]
}

fn vector() -> impl Strategy<Value = Vector3<f64>> {
    prop::array::uniform3(number()).prop_map(Vector3::from)
}

fn finite<'a>(vectors: impl IntoIterator<Item = &'a Vector3<f64>>) -> bool {
    vectors
        .into_iter()
        .all(|vector| vector.iter().all(|number| number.is_finite()))
}

fn check<const M: usize>(
    points: [Vector3<f64>; M],
    others: [Vector3<f64>; M],
    wrench: &Wrench,
    about: &Vector3<f64>,
    numbers: &[f64; 6],
) {
    let Ok(contacts) = Contacts::new(points) else {
        return;
    };
    if let Ok(held) = contacts.forces(wrench, about) {
        assert!(
            finite(&held.forces) && finite([&held.lost_moment]),
            "{held:?}"
        );
    }
    if let Ok(motion) = contacts.object_motion(&others, about) {
        assert!(finite([&motion.linear, &motion.angular]), "{motion:?}");
    }
    if let Ok(motion) = contacts.rigid_motion(&others, about) {
        assert!(finite([&motion.linear, &motion.angular]), "{motion:?}");
    }
    let mut squeeze = Squeeze::none();
    for (index, &force) in numbers.iter().enumerate() {
        squeeze = squeeze
            .with_edge(index / 2, index % M, force)
            .unwrap_or(squeeze);
    }
    if let Ok(internal) = contacts.internal_forces(&squeeze) {
        assert!(finite(&internal), "{internal:?}");
    }
    let [_, sliding, ..] = *numbers;
    let (Ok(friction), Ok(normals)) = (
        ContactFriction::point(sliding).or_else(|_| ContactFriction::point(0.5)),
        Normals::of_ball(&contacts, about).or_else(|_| Normals::new(points)),
    ) else {
        return;
    };
    assert!(finite(normals.inward()));
    if let Ok(margins) = friction.margins(&normals, &others) {
        assert!(margins.iter().all(|margin| !margin.is_nan()));
    }
}

fn sound(output: &GraspOutput<4, 4>) -> bool {
    let twists = [&output.deviation, &output.velocity];
    output
        .torques
        .iter()
        .flatten()
        .all(|torque| torque.is_finite())
        && finite(&output.forces)
        && finite(&output.wrench_forces)
        && finite([&output.wrench.force, &output.wrench.moment])
        && finite(
            twists
                .into_iter()
                .flat_map(|twist| [&twist.linear, &twist.angular]),
        )
        && output.margins.iter().all(|margin| margin.is_finite())
        && (0.0..=1.0).contains(&output.squeeze_share)
}

const Q: [f64; 16] = [
    0.1, 0.9, 0.8, 0.5, 0.0, 0.8, 0.9, 0.5, -0.1, 0.9, 0.7, 0.6, 0.05, 0.9, 0.8, 0.6,
];

#[test]
fn a_moment_that_rounds_to_infinity_is_too_large() {
    let points = [
        Vector3::zeros(),
        Vector3::new(0.0, 0.0, 7.305_536_173_729_305e75),
    ];
    let wrench = Wrench {
        force: Vector3::zeros(),
        moment: Vector3::new(f64::MAX, 0.0, 0.0),
    };
    let held = Contacts::new(points)
        .unwrap()
        .forces(&wrench, &Vector3::zeros());
    assert!(matches!(held, Err(GraspError::Number(_))), "{held:?}");
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 1000,
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    #[test]
    fn contacts_of_any_numbers(
        points in prop::array::uniform4(vector()), others in prop::array::uniform4(vector()),
        force in vector(), moment in vector(), about in vector(),
        numbers in prop::array::uniform6(number()),
    ) {
        let wrench = Wrench { force, moment };
        let ([a, b, c, _], [d, e, f, _]) = (points, others);
        check([a], [d], &wrench, &about, &numbers);
        check([a, b], [d, e], &wrench, &about, &numbers);
        check([a, b, c], [d, e, f], &wrench, &about, &numbers);
        check(points, others, &wrench, &about, &numbers);
    }

    #[test]
    fn gains_of_any_numbers(numbers in prop::collection::vec(number(), 21)) {
        let mut matrix = Matrix6::zeros();
        let mut numbers = numbers.into_iter();
        for row in 0..6 {
            for column in 0..=row {
                let number = numbers.next().unwrap();
                (matrix[(row, column)], matrix[(column, row)]) = (number, number);
            }
        }
        if let Ok(gain) = SpatialGain::new(&matrix) {
            prop_assert!(gain.matrix().iter().all(|entry| entry.is_finite()));
            prop_assert!(gain.matrix().diagonal().min() >= 0.0);
        }
    }

    #[test]
    fn the_law_of_any_numbers(
        at in 0_usize..4, field in 0_usize..8, entry in 0_usize..4, bad in number(),
        gains in prop::array::uniform6(number()), limit in number(), other in number(),
    ) {
        let clean = states(&hand(), &Q);
        let mut dirty = clean;
        let state = &mut dirty[at];
        let target = match field {
            0 => &mut state.tip[entry % 3],
            1 => &mut state.jacobian[(entry, 3 - entry)],
            2 => &mut state.velocity[entry % 3],
            3 => &mut state.gravity_torque[entry],
            4 => &mut state.self_motion.as_mut().unwrap()[entry],
            5 => &mut state.q[entry],
            6 => &mut state.qd[entry],
            _ => &mut state.jacobian[(5, entry)],
        };
        *target = bad;
        let center = Vector3::new(0.07, 0.005, -0.06);
        let mut limits = [TorqueLimits::none(); 4];
        limits[at] = TorqueLimits::symmetric(&SVector::repeat(limit));
        let tuning = GraspTuning {
            stiffness: SpatialGain::diagonal(gains).unwrap_or(SpatialGain::zero()),
            damping: SpatialGain::diagonal([1.0; 6]).unwrap(),
            center,
            feed_forward: Wrench { force: Vector3::repeat(other), moment: Vector3::zeros() },
            squeeze: Squeeze::equal(limit).unwrap_or(Squeeze::none()),
            surface: TuningSurface::Ball(center),
            friction: ContactFriction::point(0.5).unwrap(),
            posture: Posture { stiffness: 0.1, damping: 0.01 },
            limits,
        };
        let engaged = GraspStiffness::engage(&clean, tuning);
        if let Ok(output) = engaged.and_then(|grasp| grasp.update(&dirty)) {
            prop_assert!(sound(&output), "{output:?}");
            prop_assert!(bad.is_finite());
        }
        if !bad.is_finite() {
            prop_assert!(GraspStiffness::engage(&dirty, tuning).is_err());
        }
    }
}
