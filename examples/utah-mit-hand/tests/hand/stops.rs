//! How joints leave their stops, at which most of them lie when nobody holds them.

use condor_robot::{JOINTS, RobotDescription, objects};

use crate::typist::{Typist, hand, run, run_with};

/// Whether all joints are out of the zones of their stops.
fn are_free(typist: &Typist<'_>, hand: &RobotDescription) -> bool {
    let truth = typist.truth();
    hand.fingers.iter().zip(&truth.position).all(|(entry, is)| {
        let mut joints = entry.joints.iter().zip(is);
        joints.all(|(joint, is)| {
            let (low, high) = joint.rest_range();
            low <= *is && *is <= high
        })
    })
}

/// The largest error of tracking of any joint, as the summary has it, degrees.
fn largest_error(typist: &Typist<'_>, hand: &RobotDescription) -> f64 {
    let mut largest = 0.0_f64;
    for (number, finger) in hand.fingers.iter().enumerate() {
        let processor = finger.processor().unwrap();
        let region = typist.region(condor_mbox::Processor(processor));
        let cell = objects::tracking(&region).unwrap().unwrap();
        let tracking = cell
            .subscriber(&region)
            .unwrap()
            .read()
            .unwrap()
            .value
            .whole;
        for joint in 0..JOINTS {
            assert!(tracking.rms_rad(number, joint).is_some());
            let peak = tracking.peak_rad(number, joint).unwrap();
            largest = largest.max(peak.to_degrees());
        }
    }
    largest
}

#[test]
fn what_comes_out_of_its_stops_is_no_error_of_tracking() {
    let hand = hand();
    run(|typist| {
        typist.begin();
        assert!(!are_free(typist, &hand));
        typist.does("enable");
        typist.wait(1.0);
        assert!(are_free(typist, &hand));
        let moved = typist.runs("open");
        let summary = largest_error(typist, &hand);
        println!("{moved} deg in the motion, {summary} deg in the summary");
        // What the boards round is in the one and not in the other.
        assert!(summary < 2.5, "{summary} deg");
    });
}

#[test]
fn a_joint_that_is_sent_to_its_limit_rests_where_its_stop_begins() {
    let hand = hand();
    let (_, high) = hand.fingers[0].joints[3].rest_range();
    run(|typist| {
        typist.begin();
        typist.does("enable");
        typist.wait(1.0);
        let limit = hand.fingers[0].joints[3].limits.high;
        typist.does(&format!("to index.distal {limit} 1"));
        typist.wait(2.0);
        for _ in 0..100 {
            let off = (typist.truth().position[0][3] - high).to_degrees();
            assert!(off.abs() < 0.1, "{off} degrees");
            typist.wait(0.0125);
        }
    });
}

#[test]
fn slow_joints_come_out_of_their_stops_within_their_limits() {
    let mut hand = hand();
    for finger in &mut hand.fingers {
        for joint in &mut finger.joints {
            joint.limits.velocity = 1.0;
            joint.limits.acceleration = 1.0;
        }
    }
    let slow = hand.clone();
    run_with(&hand, |typist| {
        typist.begin();
        typist.does("enable");
        let before = typist.wanted.len();
        typist.wait(30.0);
        let status = typist.says("status");
        assert!(are_free(typist, &slow), "{status}");
        let fastest = typist.wanted[before..].windows(2).map(|pair| {
            let joints = pair[0].as_flattened().iter().zip(pair[1].as_flattened());
            let steps = joints.map(|(from, to)| (to - from).abs() * 50.0);
            steps.fold(0.0, f64::max)
        });
        let fastest = fastest.fold(0.0, f64::max);
        assert!(fastest > 0.0 && fastest <= 1.0, "{fastest} rad/s");
    });
}
