//! The shipped hand's controllers around the simulated hand, as `examples/closed_loop` around any.

#[path = "../../examples/closed_loop/rig.rs"]
mod rig;
#[path = "../../examples/closed_loop/trials.rs"]
mod trials;

use condor_hand::math::{max, min};
use condor_hand::servo::{JointTarget, ServoMode};
use condor_hand::trajectory::SetPoint;

use crate::support::largest_step;
use rig::{FINGERS, JOINTS, Rig, Simulated, posture, shipped};
use trials::{GOALS, Tuning, strokes, tuned};

/// A tick of 400 Hz.
const TICKS_PER_S: u32 = 400;

fn rig() -> Rig<Simulated> {
    let configuration = shipped().unwrap();
    let plant = Simulated::new(&configuration).unwrap();
    Rig::new(&configuration, plant).unwrap()
}

fn run<P: rig::Plant>(rig: &mut Rig<P>, seconds: f64) {
    for _ in 0..rig.ticks_in(seconds) {
        rig.tick().unwrap();
    }
}

fn give(rig: &mut Rig<Simulated>, finger: usize, joint: usize, target: JointTarget) {
    rig.fingers[finger].set_target(joint, target).unwrap();
}

#[test]
fn the_shipped_gains_keep_their_goals() {
    let configuration = shipped().unwrap();
    let plant = Simulated::new(&configuration).unwrap();
    let errors = strokes(&configuration, plant).unwrap();
    assert!(errors.keep(&GOALS), "{errors:?}");
    // What the links are known to weigh and to rub is fed forward.
    assert!(errors.peak_deg < 0.2, "{errors:?}");
}

/// The bounds of stability with the effort servos that bring actuators of 20 Hz to 40 Hz, and what
/// is judged there: beyond them joints or commands move at rest.
#[test]
fn joints_of_20_hz_need_a_velocity_filter_of_100_hz() {
    let configuration = shipped().unwrap();
    let at_rest = |bandwidth_hz, velocity_cutoff_hz, kp| {
        let tuning = Tuning {
            bandwidth_hz,
            velocity_cutoff_hz,
            kp,
        };
        let configuration = tuned(&configuration, &tuning);
        let plant = Simulated::new(&configuration).unwrap();
        // A fault is no rest.
        strokes(&configuration, plant).is_ok_and(|errors| errors.is_at_rest(&GOALS))
    };
    assert!(at_rest(20.0, 100.0, 1.0));
    assert!(!at_rest(20.0, 60.0, 1.0));
    assert!(at_rest(12.0, 60.0, 0.0));
    assert!(!at_rest(16.0, 60.0, 0.0));
}

#[test]
fn a_step_of_torque_arrives_in_the_actuators_and_leaves_the_other_joints_alone() {
    let mut rig = rig();
    run(&mut rig, 0.5);
    let linear = shipped().unwrap().fingers[1].transmission().unwrap();
    let joint = 1;
    rig.fingers[1].set_mode(joint, ServoMode::Torque).unwrap();
    run(&mut rig, 0.3);
    let before = rig.state[1];
    let held = linear.torque(&before.effort)[joint];
    let step = 0.05;
    give(&mut rig, 1, joint, JointTarget::Torque(held + step));
    let mut rise = None;
    for tick in 0..40_u32 {
        rig.tick().unwrap();
        let torque = linear.torque(&rig.state[1].effort)[joint];
        if rise.is_none() && torque > held + 0.9 * step {
            rise = Some(tick);
        }
    }
    // From 20 Hz to 40 Hz, as kp = 1 makes it: 2.3 time constants of 4 ms.
    let rise_s = f64::from(rise.expect("the torque never arrives")) / f64::from(TICKS_PER_S);
    assert!((0.004..=0.015).contains(&rise_s), "{rise_s} s");
    let torque = linear.torque(&rig.state[1].effort)[joint];
    assert!((torque - held - step).abs() < 0.002, "{torque} N m");
    assert!(rig.state[1].position[joint] > before.position[joint] + 0.1);
    for other in [0, 2, 3] {
        let moved = rig.state[1].position[other] - before.position[other];
        assert!(
            moved.abs() < 2_f64.to_radians(),
            "joint {other}: {moved} rad"
        );
    }
}

#[test]
fn efforts_that_are_asked_for_are_there() {
    let mut rig = rig();
    run(&mut rig, 0.5);
    // Flexors and extensors in turn.
    let asked = [31.0, 30.0, 31.0, 30.0, 31.0, 30.0, 31.0, 30.0];
    for (actuator, &effort) in asked.iter().enumerate() {
        rig.fingers[3].set_effort(actuator, effort).unwrap();
    }
    run(&mut rig, 0.2);
    let measured = &rig.state[3].effort;
    assert!(largest_step(measured, &asked) < 0.1, "{measured:?}");
}

#[test]
fn a_joint_in_motion_changes_its_mode_without_a_step_and_comes_back() {
    let mut rig = rig();
    run(&mut rig, 0.5);
    let (finger, joint) = (0, 1);
    let to = posture()[joint] + 0.5;
    let stroke = condor_hand::trajectory::Polynomial::quintic(
        &SetPoint::rest(posture()[joint]),
        &SetPoint::rest(to),
        0.4,
    )
    .unwrap();
    let mut efforts = rig.state[finger].effort;
    for tick in 0..400_u32 {
        let now = f64::from(tick) / f64::from(TICKS_PER_S);
        if tick % rig.substeps() == 0 {
            let then = min(now + rig.master_period_s(), 0.4);
            let mut points = [posture().map(SetPoint::rest); FINGERS];
            points[finger][joint] = stroke.at(then);
            rig.follow(&points).unwrap();
        }
        match tick {
            // At full speed, and a tenth of a second later.
            80 => rig.fingers[finger]
                .set_mode(joint, ServoMode::Torque)
                .unwrap(),
            120 => rig.fingers[finger]
                .set_mode(joint, ServoMode::Position)
                .unwrap(),
            _ => {}
        }
        let ticks = rig.tick().unwrap();
        let now = ticks[finger].output.effort;
        if matches!(tick, 80 | 120) {
            assert!(largest_step(&efforts, &now) < 1e-9, "tick {tick}");
        }
        efforts = now;
    }
    // It has joined the motion again.
    let error = rig.state[finger].position[joint] - to;
    assert!(error.abs() < 0.05_f64.to_radians(), "{error} rad");
}

/// Ticks until a joint is at rest, and those in which it is watched.
const REST_TICKS: u32 = 800;
const WATCHED_TICKS: u32 = 200;

/// Where the joints of a finger are at rest, and how far they still move, rad.
fn at_rest(rig: &mut Rig<Simulated>, finger: usize) -> [(f64, f64); JOINTS] {
    for _ in 0..REST_TICKS {
        rig.tick().unwrap();
    }
    let mut seen = [(f64::MAX, f64::MIN); JOINTS];
    for _ in 0..WATCHED_TICKS {
        rig.tick().unwrap();
        for ((low, high), &is) in seen.iter_mut().zip(&rig.state[finger].position) {
            (*low, *high) = (min(*low, is), max(*high, is));
        }
    }
    seen.map(|(low, high)| (f64::midpoint(low, high), high - low))
}

#[test]
fn a_joint_that_is_sent_to_its_limit_rests_where_its_stop_begins() {
    let hand = shipped().unwrap();
    for joint in 0..JOINTS {
        let entry = &hand.fingers[0].joints[joint];
        let (low, high) = entry.rest_range();
        for (limit, rests) in [(entry.limits.low, low), (entry.limits.high, high)] {
            let mut rig = rig();
            run(&mut rig, 0.2);
            give(
                &mut rig,
                0,
                joint,
                JointTarget::Position(SetPoint::rest(limit)),
            );
            let (is, moves) = at_rest(&mut rig, 0)[joint];
            let (off, moves) = ((is - rests).to_degrees().abs(), moves.to_degrees());
            assert!(
                off < 0.05 && moves < 0.01,
                "joint {joint}: {off} and {moves} degrees"
            );
        }
    }
}

#[test]
fn a_joint_that_a_motion_leads_into_its_stop_stands_still_there() {
    let hand = shipped().unwrap();
    for (number, upwards) in [(0, false), (1, true), (2, false), (3, true)] {
        let mut rig = rig();
        run(&mut rig, 0.2);
        let mut points = [posture().map(SetPoint::rest); FINGERS];
        let ends: [f64; JOINTS] = std::array::from_fn(|joint| {
            let limits = &hand.fingers[number].joints[joint].limits;
            if upwards { limits.high } else { limits.low }
        });
        points[number] = ends.map(SetPoint::rest);
        for _ in 0..125 {
            rig.follow(&points).unwrap();
            run(&mut rig, 0.02);
        }
        let mut seen = [(f64::MAX, f64::MIN); JOINTS];
        for _ in 0..25 {
            rig.follow(&points).unwrap();
            for _ in 0..8 {
                rig.tick().unwrap();
                for ((low, high), &is) in seen.iter_mut().zip(&rig.state[number].position) {
                    (*low, *high) = (min(*low, is), max(*high, is));
                }
            }
        }
        for (joint, ((low, high), end)) in seen.into_iter().zip(ends).enumerate() {
            let moves = (high - low).to_degrees();
            let depth = (high - end).to_degrees().abs();
            assert!(
                moves < 0.01,
                "joint {joint} of finger {number}: {moves} degrees"
            );
            assert!(
                depth < 3.0,
                "joint {joint} of finger {number}: {depth} degrees short"
            );
        }
    }
}

#[test]
fn a_joint_that_a_torque_pushes_into_its_stop_does_not_swing() {
    let mut rig = rig();
    run(&mut rig, 0.2);
    let joint = 3;
    give(&mut rig, 0, joint, JointTarget::Torque(0.006));
    let (is, moves) = at_rest(&mut rig, 0)[joint];
    let limits = &shipped().unwrap().fingers[0].joints[joint].limits;
    assert!(
        is > limits.high - 0.06 && is < limits.high + 0.05,
        "{is} rad"
    );
    assert!(moves.to_degrees() < 0.05, "{} degrees", moves.to_degrees());
}
