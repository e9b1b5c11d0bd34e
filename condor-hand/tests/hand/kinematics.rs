//! Where tips are and how they move: against the results of another program, against the closed
//! form's own chain, and against finite differences.

use crate::support::{self, FINGERS, geometry, joints, reference, vector};
use condor_hand::Pose;
use condor_hand::kinematics::{
    Carrier, Chain, ChainBody, ChainJoint, ChainMotion, Following, Jacobian, Kinematics,
    PlanarFinger,
};
use condor_hand::math::sin_cos;
use nalgebra::{Matrix3, SMatrix, SVector, Vector3, Vector4};
use proptest::prelude::*;
use serde::Deserialize;

#[derive(Deserialize)]
struct Cases {
    cases: Vec<Case>,
}

#[derive(Deserialize)]
struct Case {
    q: Vec<f64>,
    finger: [Tip; FINGERS],
}

#[derive(Deserialize)]
#[allow(non_snake_case, reason = "the names in the file")]
struct Tip {
    p: [f64; 3],
    R: [[f64; 3]; 3],
    J: [[f64; 4]; 6],
}

fn assert_same<const R: usize, const C: usize>(
    ours: &SMatrix<f64, R, C>,
    theirs: &SMatrix<f64, R, C>,
    tolerance: f64,
) {
    let difference = (ours - theirs).amax();
    assert!(
        difference <= tolerance,
        "off by {difference:e}:\n{ours}{theirs}"
    );
}

fn assert_same_tip<const N: usize>(
    ours: &(Pose, Jacobian<N>),
    theirs: &(Pose, Jacobian<N>),
    tolerance: f64,
) {
    assert_same(&ours.0.position, &theirs.0.position, tolerance);
    assert_same(&ours.0.rotation, &theirs.0.rotation, tolerance);
    assert_same(&ours.1, &theirs.1, tolerance);
}

#[test]
fn tips_and_jacobians_are_those_of_pinocchio() {
    let geometry = geometry();
    let Cases { cases } = reference("kinematics.json");
    assert_eq!(cases.len(), 200);
    for case in &cases {
        for (index, theirs) in case.finger.iter().enumerate() {
            let q = joints(&case.q, index);
            let tip = Pose {
                rotation: support::matrix(theirs.R),
                position: vector(theirs.p),
            };
            let jacobian = SMatrix::from_fn(|row, column| theirs.J[row][column]);
            let finger: PlanarFinger = geometry.finger(index);
            let chain: Chain<4> = geometry.chain(index);
            assert_same_tip(&finger.kinematics(&q), &(tip, jacobian), 1e-12);
            assert_same_tip(&chain.kinematics(&q), &(tip, jacobian), 1e-12);
        }
    }
}

#[test]
fn a_straight_finger_ends_at_the_sum_of_its_links() {
    let finger: PlanarFinger = PlanarFinger::new(
        Pose::identity(),
        *geometry().finger(0).lengths(),
        *geometry().finger(0).bodies(),
    )
    .unwrap();
    let (tip, _) = finger.kinematics(&Vector4::zeros());
    assert_same(&tip.position, &Vector3::new(0.1098, 0.0, 0.0), 1e-15);
    assert_same(&tip.rotation, &Matrix3::identity(), 0.0);
}

// A posture worked out by hand, to six digits.
#[test]
fn a_bent_finger_is_where_the_equations_put_it() {
    let geometry = geometry();
    let q = Vector4::new(0.2, 0.9, 1.0, 0.8);
    let index: PlanarFinger = geometry.finger(0);
    let thumb: PlanarFinger = geometry.finger(3);
    let (tip, jacobian) = index.kinematics(&q);
    let digits = 5e-7;
    assert_same(
        &tip.position,
        &vector([0.048_819, 0.027_774, -0.075_367]),
        digits,
    );
    let opposed = vector([0.048_819, 0.012_726, -0.049_633]);
    assert_same(&thumb.tip(&q).position, &opposed, digits);
    #[rustfmt::skip]
    let linear = SMatrix::<f64, 3, 4>::new(
        -0.000_774, -0.073_865, -0.040_700, -0.010_095,
         0.003_819, -0.014_973, -0.008_250, -0.002_046,
         0.0,        0.005_603,  0.032_457,  0.021_788,
    );
    assert_same(&jacobian.fixed_rows::<3>(0).into_owned(), &linear, digits);
    let still = Vector4::new(0.0, 0.205_128, -0.569_673, 0.795_861);
    assert_same(&index.self_motion(&q).unwrap(), &still, digits);
}

/// The derivative of the tip by central differences: exact to about the cube root of the rounding,
/// squared.
fn differences<const N: usize>(mechanism: &impl Kinematics<N>, q: &SVector<f64, N>) -> Jacobian<N> {
    let h = 1e-5;
    let mut columns = Jacobian::<N>::zeros();
    for joint in 0..N {
        let (mut above, mut below) = (*q, *q);
        above[joint] += h;
        below[joint] -= h;
        let (above, below) = (mechanism.tip(&above), mechanism.tip(&below));
        let linear = (above.position - below.position) / (2.0 * h);
        let spin =
            (above.rotation - below.rotation) / (2.0 * h) * mechanism.tip(q).rotation.transpose();
        let mut column = columns.column_mut(joint);
        column.fixed_rows_mut::<3>(0).copy_from(&linear);
        let angular = Vector3::new(spin[(2, 1)], spin[(0, 2)], spin[(1, 0)]);
        column.fixed_rows_mut::<3>(3).copy_from(&angular);
    }
    columns
}

fn rotation(axis: Vector3<f64>, angle: f64) -> Matrix3<f64> {
    nalgebra::Rotation3::from_axis_angle(&nalgebra::Unit::new_normalize(axis), angle).into_inner()
}

fn placed(x: f64, y: f64, z: f64, axis: Vector3<f64>, angle: f64) -> Pose {
    Pose {
        rotation: rotation(axis, angle),
        position: Vector3::new(x, y, z),
    }
}

/// A thumb with two skew axes at its root, a twist, and one place without a joint.
fn thumb() -> Chain<5> {
    let revolute = |placement, axis: Vector3<f64>| {
        ChainJoint::new(placement, ChainMotion::Revolute(axis.normalize()))
    };
    Chain::new(
        placed(0.02, 0.035, -0.01, Vector3::new(1.0, 2.0, -0.5), 0.9),
        [
            revolute(Pose::identity(), Vector3::z()),
            revolute(
                placed(0.011, 0.004, -0.003, Vector3::x(), 0.4),
                Vector3::new(0.1, 1.0, 0.2),
            ),
            ChainJoint::new(
                placed(0.02, 0.0, 0.001, Vector3::z(), -0.2),
                ChainMotion::Fixed,
            ),
            revolute(placed(0.026, 0.001, 0.0, Vector3::x(), 0.3), Vector3::y()),
            revolute(placed(0.032, 0.0, 0.002, Vector3::y(), 0.1), -Vector3::y()),
        ],
        [ChainBody::massless(); 5],
        Vector3::new(0.027, 0.001, -0.004),
    )
    .unwrap()
}

/// An arm on a rail: one joint that slides, and six that turn.
fn arm() -> Chain<7> {
    let axes = [
        Vector3::new(0.6, 0.0, 0.8),
        Vector3::z(),
        Vector3::y(),
        Vector3::z(),
        -Vector3::y(),
        Vector3::x(),
        Vector3::new(0.0, 0.6, 0.8),
    ];
    let offsets = [0.0, 0.34, 0.2, 0.21, 0.19, 0.13, 0.08];
    let mut joint = 0;
    Chain::new(
        placed(-0.4, 0.1, 0.75, Vector3::new(0.3, -1.0, 0.2), 2.1),
        axes.map(|axis| {
            let along = offsets[joint];
            let placement = placed(0.01, -0.02, along, axis + Vector3::x(), 0.2 * along);
            joint += 1;
            ChainJoint::new(
                placement,
                if joint == 1 {
                    ChainMotion::Prismatic(axis)
                } else {
                    ChainMotion::Revolute(axis)
                },
            )
        }),
        [ChainBody::massless(); 7],
        Vector3::new(0.02, 0.03, 0.1),
    )
    .unwrap()
}

#[test]
fn a_finger_is_its_own_chain() {
    let geometry = geometry();
    for index in 0..FINGERS {
        let finger: PlanarFinger = geometry.finger(index);
        assert_eq!(finger.chain(), geometry.chain(index));
    }
}

#[test]
fn a_straight_finger_and_a_tip_on_the_first_axis_have_no_single_self_motion() {
    let finger: PlanarFinger = geometry().finger(0);
    let straight = Vector4::new(0.3, 0.4, 0.0, 0.0);
    assert_eq!(finger.self_motion(&straight), None);
    assert_eq!(finger.chain().self_motion(&straight), None);
    let curled = Vector4::new(0.1, 2.0, 1.0, 0.8);
    let tip = finger.tip(&curled).position - finger.base().position;
    let [first, rest @ ..] = *finger.lengths();
    let far = first + tip.xy().norm();
    let lengths = [far, rest[0], rest[1], rest[2]];
    let finger = PlanarFinger::new(*finger.base(), lengths, *finger.bodies()).unwrap();
    assert_eq!(finger.self_motion(&curled), None);
    assert_eq!(finger.chain().self_motion(&curled), None);
}

// Five joints of which one is fixed are four, and seven are more than one direction; a slide along
// another is one.
#[test]
fn self_motion_counts_the_joints_that_move() {
    let q = SVector::from([0.1, 0.5, 0.3, 0.4, -0.7]);
    let still = thumb().self_motion(&q).unwrap();
    assert!(still[2].abs() < f64::MIN_POSITIVE);
    let (_, jacobian) = thumb().kinematics(&q);
    assert!((jacobian.fixed_rows::<3>(0) * still).amax() < 1e-15);
    assert!((still.norm() - 1.0).abs() < 1e-15);
    assert_eq!(arm().self_motion(&SVector::repeat(0.3)), None);

    let slide = |axis| ChainJoint::new(Pose::identity(), ChainMotion::Prismatic(axis));
    let rails = Chain::<2>::new(
        Pose::identity(),
        [slide(Vector3::x()), slide(-Vector3::x())],
        [ChainBody::massless(); 2],
        Vector3::zeros(),
    )
    .unwrap();
    let still = rails.self_motion(&SVector::zeros()).unwrap();
    assert!((still.x - still.y).abs() < 1e-15 && (still.norm() - 1.0).abs() < 1e-15);
    let crossed = Chain::new(
        *rails.base(),
        [slide(Vector3::x()), slide(Vector3::y())],
        *rails.bodies(),
        *rails.tip_point(),
    )
    .unwrap();
    assert_eq!(crossed.self_motion(&SVector::zeros()), None);
}

fn finger() -> impl Strategy<Value = PlanarFinger> {
    let turn = prop::array::uniform3(-1.0..1.0_f64)
        .prop_filter("an axis", |axis| Vector3::from(*axis).norm() > 0.1);
    let position = prop::array::uniform3(-0.2..0.2_f64);
    let lengths = prop::array::uniform4(0.002..0.1_f64);
    (turn, -4.0..4.0_f64, position, lengths).prop_map(|(axis, angle, [x, y, z], lengths)| {
        PlanarFinger::new(
            placed(x, y, z, Vector3::from(axis), angle),
            lengths,
            *geometry().finger(0).bodies(),
        )
        .unwrap()
    })
}

fn angles<const N: usize>() -> impl Strategy<Value = SVector<f64, N>> {
    [(); N].map(|()| -4.0..4.0_f64).prop_map(SVector::from)
}

fn anything() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => prop::num::f64::ANY,
        2 => -10.0..10.0_f64,
        1 => prop::sample::select(vec![
            0.0, -0.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, f64::MIN,
            f64::MIN_POSITIVE, 1e16, 1e22,
        ]),
    ]
}

proptest! {
    #![proptest_config(support::runs())]

    #[test]
    fn the_closed_form_is_the_chain(finger in finger(), q in angles::<4>()) {
        let chain = finger.chain();
        assert_same_tip(&finger.kinematics(&q), &chain.kinematics(&q), 1e-14);
        prop_assert_eq!(finger.tip(&q), finger.kinematics(&q).0);
        prop_assert_eq!(chain.tip(&q), chain.kinematics(&q).0);
    }

    #[test]
    fn the_closed_form_is_the_chain_at_any_finite_angle(
        finger in finger(),
        q in prop::array::uniform4(prop::num::f64::NORMAL),
    ) {
        let q = SVector::from(q);
        assert_same_tip(&finger.kinematics(&q), &finger.chain().kinematics(&q), 1e-14);
    }

    #[test]
    fn a_jacobian_is_the_derivative_of_the_tip(
        finger in finger(),
        q in angles::<4>(),
        of_thumb in angles::<5>(),
        of_arm in angles::<7>(),
    ) {
        assert_same(&finger.kinematics(&q).1, &differences(&finger, &q), 1e-9);
        let thumb = thumb();
        assert_same(&thumb.kinematics(&of_thumb).1, &differences(&thumb, &of_thumb), 1e-9);
        let arm = arm();
        assert_same(&arm.kinematics(&of_arm).1, &differences(&arm, &of_arm), 2e-9);
    }

    #[test]
    fn self_motion_does_not_move_the_tip(finger in finger(), q in angles::<4>()) {
        let (_, jacobian) = finger.kinematics(&q);
        let ours = finger.self_motion(&q);
        let theirs = finger.chain().self_motion(&q);
        for still in [ours, theirs].into_iter().flatten() {
            prop_assert!((jacobian.fixed_rows::<3>(0) * still).amax() < 1e-9);
            prop_assert!((still.norm() - 1.0).abs() < 1e-14);
        }
        // Beside the singularities there is one, the same in both; the minors change sign with
        // the side of the first axis.
        let turning = finger.base().rotation.transpose() * jacobian.fixed_view::<3, 1>(0, 0);
        let (sine, cosine) = sin_cos(q.x);
        let radius = turning.y * cosine - turning.x * sine;
        let bent = jacobian.fixed_rows::<3>(0).fixed_columns::<3>(1).into_owned();
        let area = (bent.transpose() * bent).trace();
        let normal = [0, 1, 2].map(|a| bent.column(a).cross(&bent.column((a + 1) % 3)).norm());
        if radius.abs() > 1e-4 && normal.iter().sum::<f64>() > 1e-4 * area {
            let (ours, theirs) = (ours.unwrap(), theirs.unwrap());
            assert_same(&ours, &(theirs * radius.signum()), 1e-9);
        }
    }

    #[test]
    fn no_number_makes_kinematics_panic(
        lengths in prop::array::uniform4(anything()),
        q in prop::array::uniform4(anything()),
        tip in prop::array::uniform3(anything()),
    ) {
        let usual = geometry().finger(3);
        let (base, bodies) = (*usual.base(), *usual.bodies());
        let Ok(finger) = PlanarFinger::new(base, lengths.map(f64::abs), bodies) else {
            return Ok(());
        };
        let chain = finger.chain();
        let (joints, bodies) = (*chain.joints(), *chain.bodies());
        let chain = Chain::new(base, joints, bodies, vector(tip)).unwrap_or(chain);
        let q = SVector::from(q);
        let _ = finger.kinematics(&q);
        let _ = chain.kinematics(&q);
        for still in [finger.self_motion(&q), chain.self_motion(&q)].into_iter().flatten() {
            prop_assert!(still.iter().all(|rate| rate.is_finite()));
        }
    }
}

/// Why a mechanism of one part that is changed is refused.
fn refusal(change: impl FnOnce(&mut Pose, &mut [ChainJoint; 5], &mut [ChainBody; 5])) -> String {
    let thumb = thumb();
    let (mut base, mut joints, tip) = (*thumb.base(), *thumb.joints(), *thumb.tip_point());
    let mut bodies = [ChainBody {
        mass: 0.01,
        center: Vector3::zeros(),
        inertia: Matrix3::from_diagonal(&Vector3::new(1e-6, 2e-6, 3e-6)),
    }; 5];
    assert!(Chain::new(base, joints, bodies, tip).is_ok());
    change(&mut base, &mut joints, &mut bodies);
    Chain::new(base, joints, bodies, tip)
        .unwrap_err()
        .to_string()
}

#[test]
fn a_mechanism_that_cannot_be_is_refused_by_name() {
    let axis = refusal(|_, joints, _| joints[1].motion = ChainMotion::Revolute(Vector3::y() * 2.0));
    assert_eq!(axis, "joint 1: the length of the axis is 2; it must be 1");
    let axis = refusal(|_, joints, _| joints[4].motion = ChainMotion::Prismatic(Vector3::zeros()));
    assert!(
        axis.starts_with("joint 4: the length of the axis is 0;"),
        "{axis}"
    );
    let rotation = refusal(|_, joints, _| joints[2].placement.rotation *= 2.0);
    assert!(
        rotation.starts_with("the placement of joint 2: the error of the rotation"),
        "{rotation}"
    );
    let mirrored = refusal(|base, _, _| base.rotation = -base.rotation);
    assert!(
        mirrored.starts_with("the base: the error of the rotation"),
        "{mirrored}"
    );
    let mass = refusal(|_, _, bodies| bodies[3].mass = -1.0);
    assert_eq!(mass, "link 3: the mass, kg, is -1; it must be at least 0");
    let later = refusal(|_, joints, _| joints[2].on = Carrier::Joint(2));
    assert_eq!(
        later,
        "joint 2: the number of the joint that carries it is 2; it must be below 2"
    );
    let following = |joint, ratio| {
        let offset = 0.0;
        Some(Following {
            joint,
            ratio,
            offset,
        })
    };
    let itself = refusal(|_, joints, _| joints[3].follows = following(3, 1.0));
    assert_eq!(
        itself,
        "joint 3: the number of joints between it and one that moves by itself is 1; it must be 0"
    );
    let follower = refusal(|_, joints, _| {
        joints[1].follows = following(0, 1.0);
        joints[3].follows = following(1, 1.0);
    });
    assert!(
        follower.starts_with("joint 3: the number of joints between"),
        "{follower}"
    );
    let nobody = refusal(|_, joints, _| joints[3].follows = following(5, 1.0));
    assert_eq!(
        nobody,
        "joint 3: the number of the joint that it follows is 5; it must be below 5"
    );
    let ratio = refusal(|_, joints, _| joints[3].follows = following(0, f64::INFINITY));
    assert!(
        ratio.starts_with("joint 3: the ratio to the joint that it follows is "),
        "{ratio}"
    );
    let place = refusal(|_, joints, _| joints[0].placement.position.x = f64::NAN);
    assert!(
        place.starts_with("the placement of joint 0: a coordinate, m, is "),
        "{place}"
    );
    let turned = placed(0.0, 0.0, 0.0, Vector3::new(1.0, 2.0, 3.0), 0.7).rotation;
    for moments in [
        [1.0, 2.0, 3.1],
        [-1.0, 2.0, 3.0],
        [1.0, 0.0, 0.0],
        [f64::NAN, 1.0, 1.0],
    ] {
        let own = Matrix3::from_diagonal(&Vector3::from(moments));
        for inertia in [own, turned * own * turned.transpose()] {
            let error = refusal(|_, _, bodies| bodies[0].inertia = inertia * 1e-6);
            assert!(
                error.starts_with("link 0: ") && error.contains(" of inertia"),
                "{error}"
            );
        }
    }
    let skew = refusal(|_, _, bodies| bodies[0].inertia.m12 = 1e-7);
    assert_eq!(
        skew,
        "link 0: the product of inertia of x and y, kg m², is 0.0000001; it must be 0"
    );
    for thin in [[0.0, 1.0, 1.0], [1.0, 2.0, 3.0], [0.0; 3]] {
        let own = Matrix3::from_diagonal(&Vector3::from(thin)) * 1e-9;
        let inertia = turned * own * turned.transpose();
        let body = ChainBody {
            inertia,
            ..ChainBody::massless()
        };
        let (base, joints) = (*thumb().base(), *thumb().joints());
        assert!(
            Chain::new(base, joints, [body; 5], Vector3::zeros()).is_ok(),
            "{thin:?}"
        );
    }
}

#[test]
fn a_planar_finger_that_cannot_be_is_refused_by_name() {
    let finger: PlanarFinger = geometry().finger(0);
    let (base, bodies) = (*finger.base(), *finger.bodies());
    let [l0, l1, l2, l3] = *finger.lengths();
    let error = PlanarFinger::new(base, [l0, -l1, l2, l3], bodies)
        .unwrap_err()
        .to_string();
    assert!(
        error.starts_with("link 1: the length, m, is -0.0"),
        "{error}"
    );
    let mut heavy = bodies;
    heavy[2].inertia = Vector3::new(1.0, 1.0, 3.0);
    let error = PlanarFinger::new(base, [l0, l1, l2, l3], heavy)
        .unwrap_err()
        .to_string();
    assert!(
        error.starts_with("link 2: the moment of inertia about z")
            && error.ends_with("is 3; it must be at most 2"),
        "{error}"
    );
    let turned = Pose {
        rotation: base.rotation * 2.0,
        ..base
    };
    assert!(PlanarFinger::new(turned, [l0, l1, l2, l3], bodies).is_err());
}
