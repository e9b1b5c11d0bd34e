use condor_hand::kinematics::Kinematics;
use condor_host::robot::{Robot, RobotLine};
use condor_scene::HandView;
use nalgebra::{SVector, Vector3};
use proptest::prelude::*;

use crate::{utah_mit, with_motors};

fn line<'l>(lines: &'l [RobotLine], name: &str) -> &'l RobotLine {
    let found = lines.iter().find(|line| line.name == name);
    found.unwrap_or_else(|| panic!("no line {name}"))
}

fn length(line: &RobotLine) -> f64 {
    let points = line.points.iter().map(|point| Vector3::from(*point));
    let steps = points.clone().zip(points.skip(1));
    steps.map(|(from, to)| (to - from).norm()).sum()
}

#[test]
fn there_is_a_line_for_the_palm_each_finger_and_each_tendon() {
    let lines = HandView::new(&utah_mit()).lines(&[]);
    assert_eq!(lines.len(), 1 + 4 + 32);
    assert_eq!(line(&lines, "palm").points.len(), 6);
    let tendon = line(&lines, "ring.middle-extensor");
    assert_eq!(
        tendon.effort.as_deref(),
        Some("ring.middle-extensor.effort")
    );
    assert_eq!(line(&lines, "thumb").effort, None);
}

/// The order of the actuators does not matter, and an actuator that can push has no line.
#[test]
fn tendons_are_actuators_that_only_pull_in_any_order() {
    let names = |hand| {
        let lines = HandView::new(&hand).lines(&[]).into_iter();
        let names = lines.filter(|line| line.effort.is_some());
        names.map(|line| line.name).collect::<Vec<_>>()
    };
    let names_with_motors = names(with_motors());
    assert_eq!(names_with_motors.len(), 24);
    assert!(names_with_motors.iter().all(|it| !it.starts_with("index.")));
    let mut hand = utah_mit();
    hand.fingers[0].actuators.reverse();
    hand.fingers[0].actuators[7].limits.low = -4.0;
    let all = names(hand.clone());
    assert_eq!(all.len(), 31);
    assert_eq!(
        all[..2],
        ["index.distal-extensor", "index.distal-flexor"].map(str::to_owned)
    );
    assert!(!all.contains(&"index.abduction-flexor".to_owned()));
    let lines = HandView::new(&hand).lines(&[0.3; 16]);
    let others = HandView::new(&utah_mit()).lines(&[0.3; 16]);
    for name in &all {
        assert_eq!(line(&lines, name), line(&others, name));
    }
}

proptest! {
    #[test]
    fn fingers_end_at_their_tips(positions in proptest::collection::vec(-3.0..3.0_f64, 16)) {
        let hand = utah_mit();
        let lines = HandView::new(&hand).lines(&positions);
        for (finger, own) in hand.fingers.iter().zip(positions.chunks(4)) {
            let tip = finger.chain().tip(&SVector::<f64, 4>::from_column_slice(own));
            let end = Vector3::from(*line(&lines, &finger.name).points.last().unwrap());
            prop_assert!((end - tip.position).norm() < 1e-12);
        }
    }
}

/// A tendon pulls a joint to the side on which it becomes shorter.
#[test]
fn flexors_become_shorter_where_extensors_become_longer() {
    let view = HandView::new(&utah_mit());
    let lengths = |positions: &[f64], name: &str| {
        let lines = view.lines(positions);
        ["flexor", "extensor"].map(|side| length(line(&lines, &format!("{name}-{side}"))))
    };
    let straight = [0.1; 16];
    for (joint, name) in view.joints().iter().map(|joint| &joint.name).enumerate() {
        let mut bent = straight;
        bent[joint] += 0.2;
        let [flexor, extensor] = lengths(&straight, name);
        let [flexor_bent, extensor_bent] = lengths(&bent, name);
        assert!(flexor_bent < flexor && extensor_bent > extensor, "{name}");
    }
    // The tendons of the distal joint cross the proximal one, and no other's cross the distal one.
    let mut bent = straight;
    bent[1] += 0.2;
    assert!(lengths(&bent, "index.distal")[0] < lengths(&straight, "index.distal")[0]);
    let mut bent = straight;
    bent[3] += 0.2;
    let bits = |positions: &[f64]| lengths(positions, "index.middle").map(f64::to_bits);
    assert_eq!(bits(&bent), bits(&straight));
}
