//! The law of stiffness on the hand of the reference data.

use std::array::from_fn;

use condor_hand::grasp::{
    ContactFriction, FingerState, GraspError, GraspStiffness, GraspTuning, Normals, Posture,
    SpatialGain, Squeeze, TorqueLimits, TuningSurface, Twist, Wrench,
};
use condor_hand::kinematics::PlanarFinger;
use nalgebra::{Rotation3, SVector, Vector3, vector};

use super::wrenches::{difference, size, tip_motions, wrench_of};
use crate::support::{geometry, joints};

pub(crate) fn hand() -> [PlanarFinger; 4] {
    let geometry = geometry();
    from_fn(|finger| geometry.finger(finger))
}

/// The fingers at rest, without weight.
pub(crate) fn states(hand: &[PlanarFinger; 4], q: &[f64; 16]) -> [FingerState<4>; 4] {
    let zero = SVector::zeros();
    from_fn(|finger| FingerState::new(&hand[finger], &joints(q, finger), &zero, &zero))
}

const Q: [f64; 16] = [
    0.1, 0.9, 0.8, 0.5, 0.0, 0.8, 0.9, 0.5, -0.1, 0.9, 0.7, 0.6, 0.05, 0.9, 0.8, 0.6,
];
const CENTER: Vector3<f64> = Vector3::new(0.07, 0.005, -0.06);

fn tuning() -> GraspTuning<4, 4> {
    GraspTuning {
        stiffness: SpatialGain::diagonal([200.0, 250.0, 150.0, 0.1, 0.12, 0.09]).unwrap(),
        damping: SpatialGain::diagonal([2.0, 2.0, 2.0, 1e-3, 2e-3, 1e-3]).unwrap(),
        center: CENTER,
        feed_forward: Wrench::zero(),
        squeeze: Squeeze::equal(1.5).unwrap(),
        surface: TuningSurface::Ball(CENTER),
        friction: ContactFriction::point(0.8).unwrap(),
        posture: Posture {
            stiffness: 0.05,
            damping: 1e-3,
        },
        limits: [TorqueLimits::none(); 4],
    }
}

/// The fingers as if the object had turned, and then moved, without change of their Jacobians.
fn moved(
    states: &[FingerState<4>; 4],
    motion: impl Fn(&Vector3<f64>) -> Vector3<f64>,
) -> [FingerState<4>; 4] {
    states.map(|mut state| {
        state.tip = motion(&state.tip);
        state
    })
}

#[test]
fn a_held_object_feels_the_squeeze_alone() {
    let states = states(&hand(), &Q);
    let grasp = GraspStiffness::engage(&states, tuning()).unwrap();
    let output = grasp.update(&states).unwrap();
    assert!(size(&output.wrench.force, &output.wrench.moment) < 1e-12);
    let tips = states.map(|state| state.tip);
    let left = wrench_of(&tips, &output.forces, &CENTER);
    assert!(size(&left.force, &left.moment) < 1e-12);
    assert!(output.forces.iter().all(|force| force.norm() > 0.5));
    assert_eq!(output.squeeze_share, 1.0);
    assert_eq!((output.squeeze_limit, output.overload), (None, None));
}

#[test]
fn torques_bear_forces_and_weight_and_posture() {
    let mut states = states(&hand(), &Q);
    let grasp = GraspStiffness::engage(&states, tuning()).unwrap();
    for (finger, state) in states.iter_mut().enumerate() {
        state.gravity_torque = SVector::repeat(0.001 * (finger + 1) as f64);
        state.q.add_scalar_mut(0.02);
        state.qd = vector![0.1, -0.2, 0.3, 0.5];
        // The tip and its Jacobian stay: this is a drift along the self-motion, enlarged.
    }
    let output = grasp.update(&states).unwrap();
    for (finger, state) in states.iter().enumerate() {
        let linear = state.jacobian.fixed_rows::<3>(0);
        let posture =
            output.torques[finger] - linear.tr_mul(&output.forces[finger]) - state.gravity_torque;
        let along = state.self_motion.unwrap();
        let wanted = SVector::<f64, 4>::repeat(-0.02) * 0.05 - state.qd * 1e-3;
        assert!((posture - along * along.dot(&wanted)).norm() < 1e-15);
        assert!(posture.norm() > 1e-5);
        // The force that this torque makes at a tip that does not move: `(J Jᵀ)⁻¹ J tau`.
        let square = (linear * linear.transpose()).try_inverse().unwrap();
        assert!((square * (linear * posture)).norm() < 1e-12);
    }
}

#[test]
fn a_small_motion_is_answered_by_its_stiffness_and_a_velocity_by_its_damping() {
    let mut states = states(&hand(), &Q);
    let mut tuning = tuning();
    // It bears a weight, which acts at the middle.
    tuning.feed_forward.force.z = 1.0;
    let mut grasp = GraspStiffness::engage(&states, tuning).unwrap();
    let away = Twist {
        linear: vector![0.002, -0.001, 0.003],
        angular: vector![0.05, -0.08, 0.04],
    };
    let speed = Twist {
        linear: vector![0.02, 0.01, -0.03],
        angular: vector![0.5, 0.8, -0.4],
    };
    let tips = states.map(|state| state.tip);
    // About where the middle of the object is.
    let middle = CENTER - away.linear;
    let speeds = tip_motions(&tips, &speed, &middle);
    for (state, speed) in states.iter_mut().zip(speeds) {
        state.velocity = speed;
    }
    let desired = tip_motions(&tips, &away, &CENTER);
    let desired: [_; 4] = from_fn(|finger| tips[finger] + desired[finger]);
    grasp.set_desired(&desired).unwrap();
    let output = grasp.update(&states).unwrap();
    let force = vector![0.4 - 0.04, -0.25 - 0.02, 0.45 + 0.06 + 1.0];
    let moment = vector![0.005 - 5e-4, -0.0096 - 1.6e-3, 0.0036 + 4e-4];
    assert!((output.wrench.force - force).amax() < 1e-12);
    assert!((output.wrench.moment - moment).amax() < 1e-12);
    let made = wrench_of(&tips, &output.forces, &middle);
    assert!(size(&(made.force - force), &(made.moment - moment)) < 1e-13);
}

#[test]
fn a_large_rotation_is_answered_by_its_whole_angle() {
    let states = states(&hand(), &Q);
    for angle in [0.2001, 0.5, 1.5, 3.0] {
        let axis = vector![0.6, -0.3, 0.8].normalize();
        let shift = vector![0.004, 0.002, -0.001];
        let turn = Rotation3::from_scaled_axis(axis * angle);
        let mut grasp = GraspStiffness::engage(&states, tuning()).unwrap();
        let desired = states.map(|state| CENTER + shift + turn * (state.tip - CENTER));
        grasp.set_desired(&desired).unwrap();
        let output = grasp.update(&states).unwrap();
        assert!(
            (output.deviation.angular - axis * angle).norm() < 1e-13,
            "{angle}"
        );
        assert!((output.deviation.linear - shift).norm() < 1e-14, "{angle}");
        let moment = axis.component_mul(&vector![0.1, 0.12, 0.09]) * angle;
        assert!((output.wrench.moment - moment).norm() < 1e-13);
    }
}

#[test]
fn the_moment_has_no_step_where_the_exact_pose_takes_over() {
    let states = states(&hand(), &Q);
    let grasp = GraspStiffness::engage(&states, tuning()).unwrap();
    let axis = vector![0.6, -0.3, 0.8].normalize();
    let mut before: Option<f64> = None;
    for step in 0..3000 {
        let angle = f64::from(step) * 1e-4;
        let turn = Rotation3::from_scaled_axis(axis * -angle);
        let present = moved(&states, |tip| CENTER + turn * (tip - CENTER));
        let output = grasp.update(&present).unwrap();
        let along = output.deviation.angular.dot(&axis);
        if let Some(before) = before {
            let slope = (along - before) / 1e-4;
            assert!((0.8..1.2).contains(&slope), "{angle}: {slope}");
        }
        before = Some(along);
    }
}

#[test]
fn the_ball_moves_with_the_object() {
    let states = states(&hand(), &Q);
    let mut grasp = GraspStiffness::engage(&states, tuning()).unwrap();
    let margins = grasp.update(&states).unwrap().margins;
    // The whole hand is carried elsewhere and its object with it: only the spring force differs.
    let mut soft = tuning();
    soft.stiffness = SpatialGain::zero();
    grasp.set_tuning(soft).unwrap();
    let turn = Rotation3::from_scaled_axis(vector![0.3, 0.4, -0.2]);
    let shift = vector![0.01, -0.02, 0.005];
    let carried = moved(&states, |tip| CENTER + shift + turn * (tip - CENTER));
    let ball = grasp.update(&carried).unwrap().margins;
    let normals = states.map(|state| CENTER - state.tip);
    soft.surface = TuningSurface::Normals(Normals::new(normals).unwrap());
    grasp.set_tuning(soft).unwrap();
    let given = grasp.update(&carried).unwrap().margins;
    for finger in 0..4 {
        assert!((ball[finger] - margins[finger]).abs() < 1e-12);
        assert!((given[finger] - margins[finger]).abs() < 1e-12);
    }
}

#[test]
fn the_squeeze_gives_way_to_a_torque_limit_and_the_wrench_does_not() {
    let states = states(&hand(), &Q);
    let mut tuning = tuning();
    tuning.feed_forward.force = vector![0.0, 0.0, 1.0];
    let mut grasp = GraspStiffness::engage(&states, tuning).unwrap();
    let free = grasp.update(&states).unwrap();
    tuning.squeeze = Squeeze::none();
    grasp.set_tuning(tuning).unwrap();
    let bare = grasp.update(&states).unwrap();

    // Half of what the squeeze adds at the joint where it adds most.
    let (mut finger, mut joint, mut most) = (0, 0, 0.0);
    for i in 0..4 {
        for j in 0..4 {
            let (load, full) = (bare.torques[i][j], free.torques[i][j]);
            if (full - load).abs() > most && full.abs() > load.abs() {
                (finger, joint, most) = (i, j, (full - load).abs());
            }
        }
    }
    let (load, full) = (bare.torques[finger][joint], free.torques[finger][joint]);
    let limit = f64::midpoint(load, full);
    tuning.squeeze = Squeeze::equal(1.5).unwrap();
    if full > load {
        tuning.limits[finger].high[joint] = limit;
    } else {
        tuning.limits[finger].low[joint] = limit;
    }
    grasp.set_tuning(tuning).unwrap();
    let limited = grasp.update(&states).unwrap();
    assert!((limited.squeeze_share - 0.5).abs() < 1e-12);
    assert!((limited.torques[finger][joint] - limit).abs() < 1e-15);
    let told = limited.squeeze_limit.unwrap();
    assert_eq!(
        (told.finger, told.joint, told.torque, told.limit),
        (finger, joint, full, limit)
    );
    assert_eq!(limited.overload, None);
    assert_eq!(limited.wrench, free.wrench);
    assert!(difference(&limited.wrench_forces, &free.wrench_forces) == 0.0);

    // A limit that the wrench alone exceeds leaves no squeeze, and is named.
    let limit = 0.5 * load;
    if full > load {
        tuning.limits[finger].high[joint] = limit.max(0.0);
    } else {
        tuning.limits[finger].low[joint] = limit.min(0.0);
    }
    grasp.set_tuning(tuning).unwrap();
    let overloaded = grasp.update(&states).unwrap();
    if load * (full - load) > 0.0 {
        assert_eq!(overloaded.squeeze_share, 0.0);
        assert_eq!(overloaded.torques, bare.torques);
        let told = overloaded.overload.unwrap();
        assert_eq!(
            (told.finger, told.joint, told.torque, told.limit),
            (finger, joint, load, limit)
        );
    } else {
        panic!("choose another posture: the wrench loads no joint as the squeeze does");
    }
}

#[test]
fn what_is_wrong_is_told_with_its_values_and_changes_nothing() {
    let states = states(&hand(), &Q);
    let mut grasp = GraspStiffness::engage(&states, tuning()).unwrap();
    let mut wrong = tuning();
    wrong.posture.damping = -1.0;
    let told = grasp.set_tuning(wrong).unwrap_err().to_string();
    assert_eq!(
        told,
        "the damping of the posture, N m s/rad, is -1; it must be at least 0"
    );
    wrong = tuning();
    wrong.limits[1].low[2] = 0.5;
    let told = grasp.set_tuning(wrong).unwrap_err().to_string();
    assert_eq!(
        told,
        "joint 2 of finger 1: the lower limit of the torque, N m, is 0.5; it must be at most 0"
    );
    wrong = tuning();
    wrong.center.x = f64::NAN;
    assert!(matches!(
        grasp.set_tuning(wrong),
        Err(GraspError::Number(_))
    ));
    wrong = tuning();
    wrong.surface = TuningSurface::Ball(vector![0.0, f64::INFINITY, 0.0]);
    assert!(matches!(
        grasp.set_tuning(wrong),
        Err(GraspError::Number(_))
    ));
    assert_eq!(*grasp.tuning(), tuning());

    let line: [_; 4] = from_fn(|finger| vector![finger as f64, 0.0, 0.0]);
    assert!(matches!(
        grasp.set_desired(&line),
        Err(GraspError::Number(_))
    ));
    assert_eq!(*grasp.desired(), states.map(|state| state.tip));

    let pair: [_; 2] = [states[0], states[3]];
    let few = GraspTuning {
        stiffness: SpatialGain::zero(),
        damping: SpatialGain::zero(),
        center: CENTER,
        feed_forward: Wrench::zero(),
        squeeze: Squeeze::none(),
        surface: TuningSurface::Ball(CENTER),
        friction: ContactFriction::point(1.0).unwrap(),
        posture: tuning().posture,
        limits: [TorqueLimits::none(); 2],
    };
    let told = GraspStiffness::engage(&pair, few).unwrap_err();
    assert_eq!(
        told.to_string(),
        "the number of contacts is 2; it must be at least 3"
    );
}
