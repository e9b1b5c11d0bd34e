//! Lines and arcs of the tips of two arms: the set-points that run along them, at the servos' rate.

use crate::support;
use crate::support::arms::{Arm, Joints, Numbers, arms, iiwa, panda};
use condor_hand::kinematics::{JointLimits, Kinematics, PoseSearch, Side};
use condor_hand::math::{max, min};
use condor_hand::trajectory::{
    Bounds, CartesianPath, Generator, Interpolator, JointPath, JointPathError, MotionError,
    Observations, Pace, PathDeviation, ProfileLimits, SetPoint,
};
use condor_hand::{Pose, rotation_about, rotation_vector};
use nalgebra::Vector3;
use proptest::prelude::*;

const ALLOWED: PathDeviation = PathDeviation {
    position: 1e-4,
    rotation: 1e-3,
};
/// The limits of all joints, rad/s and rad/s².
const VELOCITY: f64 = 1.5;
const ACCELERATION: f64 = 4.0;
/// The master's tick, s, and the periods of the servos in it.
const TICK: f64 = 0.01;
const SUBSTEPS: u16 = 10;

/// A posture with a bent elbow and the hand down, and others about it.
fn posture(numbers: &mut Numbers, arm: &Arm) -> Joints {
    let home = match arm.name {
        "panda" => [0.0, -0.6, 0.0, -2.2, 0.0, 1.7, 0.8],
        _ => [0.0, 0.5, 0.0, -1.3, 0.0, 0.9, 0.0],
    };
    Joints::from(home.map(|position| position + 0.8 * numbers.share() - 0.4))
}

/// A pose a third of a metre away, turned by up to half a rad.
fn away(numbers: &mut Numbers, start: &Pose) -> Pose {
    Pose {
        position: start.position + numbers.direction() * 0.3,
        rotation: rotation_about(&numbers.direction(), 0.5 * numbers.share()) * start.rotation,
    }
}

/// Runs the joints along a path, and calls `see` with the set-points of every period of the servos.
fn run(arm: &Arm, joints: &JointPath<7>, mut see: impl FnMut(&[SetPoint; 7])) {
    let limits = std::array::from_fn(|joint| ProfileLimits {
        low: arm.limits.lower()[joint],
        high: arm.limits.upper()[joint],
        velocity: VELOCITY,
        acceleration: ACCELERATION,
        jerk: 1e4,
    });
    let (_, start) = joints.postures().next().unwrap();
    let start: [f64; 7] = (*start).into();
    let mut generator = Generator::<7, 1>::new(limits, start, TICK).unwrap();
    let bounds = [Bounds {
        velocity: VELOCITY,
        acceleration: ACCELERATION,
        jerk: None,
    }; 7];
    let mut servos = Interpolator::<7>::new(SUBSTEPS, TICK, start, bounds).unwrap();
    // As fast as the limits permit, but not to an end within a tick.
    let ticks = (joints.least_duration(&limits).unwrap() / TICK).ceil();
    let primitive = joints
        .primitive(0..7, Pace::Duration(ticks * TICK))
        .unwrap();
    generator.enqueue(primitive).unwrap();
    let mut rests = 0;
    let (mut fastest, mut hardest) = (0.0, 0.0);
    while rests < 2 {
        let points = generator.tick(&Observations::none());
        servos.tick(&points).unwrap();
        for _ in 0..SUBSTEPS {
            let points = servos.step();
            for point in points {
                fastest = max(fastest, point.velocity.abs());
                hardest = max(hardest, point.acceleration.abs());
            }
            see(&points);
        }
        rests += u32::from(generator.is_idle());
    }
    // The limits are kept, and one of them is used.
    assert!(fastest <= VELOCITY + 1e-6, "{fastest}");
    assert!(hardest <= ACCELERATION * 1.001, "{hardest}");
    assert!(fastest > 0.9 * VELOCITY || hardest > 0.9 * ACCELERATION);
}

/// Checks that joints run along a path within their limits; `off` tells how far a tip is from the path.
fn check(arm: &Arm, joints: &JointPath<7>, end: &Pose, off: impl Fn(&Pose) -> (f64, f64)) {
    let mut last = None;
    run(arm, joints, |points| {
        let q = Joints::from(points.map(|point| point.position));
        assert!((arm.limits.clamp(&q) - q).amax() <= 1e-6);
        let tip = arm.chain.tip(&q);
        let (position, rotation) = off(&tip);
        assert!(position <= ALLOWED.position, "{}: {position} m", arm.name);
        assert!(rotation <= ALLOWED.rotation, "{}: {rotation} rad", arm.name);
        last = Some(tip);
    });
    let tip = last.unwrap();
    assert!((tip.position - end.position).amax() <= 1e-8);
    assert!((tip.rotation - end.rotation).amax() <= 1e-8);
}

#[test]
fn tips_run_along_lines_within_the_limits_of_their_joints() {
    for arm in arms() {
        let search = PoseSearch::new(arm.limits);
        let mut numbers = Numbers(3);
        let (mut ran, mut greatest) = (0, PathDeviation::default());
        for _ in 0..100 {
            let start = posture(&mut numbers, &arm);
            let from = arm.chain.tip(&start);
            let to = away(&mut numbers, &from);
            let path = CartesianPath::line(&from, &to).unwrap();
            let found = JointPath::along(&path, &arm.chain, &search, &start, &ALLOWED);
            let Ok(joints) = found else { continue };
            ran += 1;
            greatest.position = max(greatest.position, joints.deviation().position);
            greatest.rotation = max(greatest.rotation, joints.deviation().rotation);
            let way = to.position - from.position;
            check(&arm, &joints, &to, |tip| {
                let gone = tip.position - from.position;
                let fraction = min(max(gone.dot(&way) / way.norm_squared(), 0.0), 1.0);
                let target = path.at(fraction);
                let turn = rotation_vector(&(target.rotation * tip.rotation.transpose()));
                ((gone - way * fraction).norm(), turn.norm())
            });
        }
        println!("{}: {ran} lines of 100, off by {greatest:?}", arm.name);
        assert!(ran >= 60, "{}: {ran} lines of 100", arm.name);
    }
}

#[test]
fn tips_run_along_arcs_through_their_via_points() {
    for arm in arms() {
        let search = PoseSearch::new(arm.limits);
        let start = posture(&mut Numbers(2), &arm);
        let from = arm.chain.tip(&start);
        // A quarter of a circle and more, upright, and a turn with it.
        let center = from.position - Vector3::z() * 0.1;
        let place = |angle: f64| center + Vector3::new(0.0, angle.sin(), angle.cos()) * 0.1;
        let to = Pose {
            position: place(2.0),
            rotation: rotation_about(&Vector3::x(), 0.4) * from.rotation,
        };
        let path = CartesianPath::arc(&from, &place(0.7), &to).unwrap();
        assert!((path.length() - 0.2).abs() <= 1e-12 && (path.angle() - 0.4).abs() <= 1e-12);
        let joints = JointPath::along(&path, &arm.chain, &search, &start, &ALLOWED).unwrap();
        let mut nearest = f64::INFINITY;
        check(&arm, &joints, &to, |tip| {
            let arm_of_circle = tip.position - center;
            let angle = arm_of_circle.y.atan2(arm_of_circle.z);
            let target = path.at(angle / 2.0);
            let turn = rotation_vector(&(target.rotation * tip.rotation.transpose()));
            ((target.position - tip.position).norm(), turn.norm())
        });
        run(&arm, &joints, |points| {
            let tip = arm.chain.tip(&points.map(|point| point.position).into());
            nearest = min(nearest, (tip.position - place(0.7)).norm());
        });
        assert!(nearest <= 1e-3, "{}: {nearest}", arm.name);
    }
}

#[test]
fn a_path_there_and_back_ends_in_the_posture_of_its_start() {
    let arm = iiwa();
    let start = posture(&mut Numbers(2), &arm);
    let search = PoseSearch {
        preferred: Some(start),
        ..PoseSearch::new(arm.limits)
    };
    let from = arm.chain.tip(&start);
    let mut to = from;
    to.position.y += 0.25;
    let there = CartesianPath::line(&from, &to).unwrap();
    let there = JointPath::along(&there, &arm.chain, &search, &start, &ALLOWED).unwrap();
    let (at, end) = there.postures().last().unwrap();
    assert!((at - 1.0).abs() < f64::EPSILON);
    let back = CartesianPath::line(&to, &from).unwrap();
    let back = JointPath::along(&back, &arm.chain, &search, end, &ALLOWED).unwrap();
    let (_, home) = back.postures().last().unwrap();
    assert!((home - start).amax() <= 1e-5);
}

/// The straight line by which the flange of an arm moves from a posture.
fn shifted(arm: &Arm, start: &Joints, by: Vector3<f64>) -> Result<JointPath<7>, JointPathError> {
    let from = arm.chain.tip(start);
    let to = Pose {
        position: from.position + by,
        ..from
    };
    let path = CartesianPath::line(&from, &to).unwrap();
    JointPath::along(
        &path,
        &arm.chain,
        &PoseSearch::new(arm.limits),
        start,
        &ALLOWED,
    )
}

#[test]
fn a_path_that_cannot_be_says_where_it_ends_and_why() {
    let arm = iiwa();
    let start = Joints::from([0.1, 0.5, 0.1, 0.9, 0.2, -0.4, 0.3]);
    let far = shifted(&arm, &start, Vector3::x() * 2.0).unwrap_err();
    let JointPathError::OutOfReach { fraction, off } = far else {
        panic!("{far}");
    };
    assert!(fraction > 0.05 && fraction < 0.5 && off.position > 1e-9);
    assert!(
        far.to_string()
            .contains("of the path the tip comes no nearer than"),
        "{far}"
    );

    // The elbow of the other arm opens no further than this.
    let arm = panda();
    let start = Joints::from([0.0, -0.8, 0.0, -2.9, 0.0, 2.3, 0.8]);
    let near = shifted(&arm, &start, Vector3::x() * -0.3).unwrap_err();
    assert!(matches!(near, JointPathError::Limit { .. }), "{near}");

    let from = arm.chain.tip(&start);
    let aside = CartesianPath::line(&Pose::at(0.0, 0.0, 0.5), &from).unwrap();
    let search = PoseSearch::new(arm.limits);
    let wrong = JointPath::along(&aside, &arm.chain, &search, &start, &ALLOWED).unwrap_err();
    let JointPathError::Deviation { fraction: 0.0, off } = wrong else {
        panic!("{wrong}");
    };
    assert!(off.position > 0.1);
    let exact = PathDeviation::default();
    let line = CartesianPath::line(&from, &away(&mut Numbers(1), &from)).unwrap();
    let coarse = JointPath::along(&line, &arm.chain, &search, &start, &exact).unwrap_err();
    assert!(
        matches!(coarse, JointPathError::Deviation { .. }),
        "{coarse}"
    );
    let beyond = start + Joints::repeat(3.0);
    let refused = JointPath::along(&line, &arm.chain, &search, &beyond, &ALLOWED).unwrap_err();
    assert!(
        refused
            .to_string()
            .starts_with("joint 0: the position at the start"),
        "{refused}"
    );
}

#[test]
fn a_joint_at_its_limit_is_named() {
    // Two joints in a plane: the tip goes out until the elbow is straight, or to its limit.
    let arm = iiwa();
    let mut upper = *arm.limits.upper();
    upper[3] = 1.0;
    let narrow = JointLimits::new(*arm.limits.lower(), upper).unwrap();
    let start = Joints::from([0.0, 0.5, 0.0, 0.9, 0.0, -0.4, 0.0]);
    let from = arm.chain.tip(&start);
    let shoulder = Vector3::new(0.0, 0.0, 0.36);
    let to = Pose {
        position: from.position + (shoulder - from.position) * 0.4,
        ..from
    };
    let path = CartesianPath::line(&from, &to).unwrap();
    let search = PoseSearch::new(narrow);
    let error = JointPath::along(&path, &arm.chain, &search, &start, &ALLOWED).unwrap_err();
    let JointPathError::Limit {
        fraction,
        joint: 3,
        side: Side::High,
        off,
    } = error
    else {
        panic!("{error}");
    };
    assert!(fraction > 0.02 && fraction < 0.9 && off.position > 0.0);
}

#[test]
fn a_motion_moves_the_joints_of_an_arm_among_others() {
    let arm = panda();
    let start = Joints::from([0.0, -0.8, 0.0, -2.2, 0.0, 1.5, 0.8]);
    let joints = shifted(&arm, &start, Vector3::y() * 0.1).unwrap();
    let primitive = joints.primitive::<9>(2..9, Pace::Duration(2.0)).unwrap();
    assert_eq!(primitive.mask, 0b1_1111_1100);
    assert_eq!(primitive.vias.len(), 16);
    let (at, posture) = joints.postures().nth(5).unwrap();
    assert_eq!(primitive.vias[4].at, at);
    assert_eq!(primitive.vias[4].positions[2..], posture.as_slice()[..]);
    assert_eq!(
        joints.primitive::<8>(2..9, Pace::Duration(2.0)),
        Err(MotionError::NoJoint {
            joint: 8,
            joints: 8
        })
    );
}

#[test]
fn points_on_a_line_make_no_arc() {
    let (start, end) = (Pose::at(0.1, 0.0, 0.0), Pose::at(0.3, 0.0, 0.0));
    for via in [0.2, 0.1, 0.3, 7.0] {
        let error = CartesianPath::arc(&start, &(Vector3::x() * via), &end).unwrap_err();
        assert!(
            error.what.starts_with("the height of the triangle"),
            "{error}"
        );
    }
    let nowhere = Vector3::new(0.0, f64::NAN, 0.0);
    let error = CartesianPath::arc(&start, &nowhere, &end).unwrap_err();
    assert!(error.to_string().starts_with("via point 0: "), "{error}");
    let mut turned = end;
    turned.rotation *= 2.0;
    assert!(CartesianPath::line(&start, &turned).is_err());
    // The way through the via point, also where it is the longer one.
    let (start, end) = (Pose::at(1.0, 0.0, 0.0), Pose::at(0.0, 1.0, 0.0));
    let arc = CartesianPath::arc(&start, &(-Vector3::x()), &end).unwrap();
    assert!((arc.length() - 1.5 * std::f64::consts::PI).abs() < 1e-12);
    assert!((arc.at(0.5).position - Vector3::new(-1.0, -1.0, 0.0) * 0.5_f64.sqrt()).amax() < 1e-12);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..support::runs() })]

    #[test]
    fn no_number_makes_a_path_panic(
        position in prop::array::uniform3(any::<f64>()),
        via in prop::array::uniform3(any::<f64>()),
        start in prop::array::uniform7(any::<f64>()),
        fraction in any::<f64>(),
    ) {
        let arm = panda();
        let home = posture(&mut Numbers(1), &arm);
        let from = arm.chain.tip(&home);
        let to = Pose { position: position.into(), ..from };
        let line = CartesianPath::line(&from, &to);
        let arc = CartesianPath::arc(&from, &via.into(), &to);
        for path in [line, arc].into_iter().flatten() {
            let _ = (path.at(fraction), path.length());
            let search = PoseSearch::new(arm.limits);
            for start in [home, start.into()] {
                let found = JointPath::along(&path, &arm.chain, &search, &start, &ALLOWED);
                prop_assert!(found.is_err());
            }
        }
    }
}
