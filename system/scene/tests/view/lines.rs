use condor_hand::kinematics::Kinematics;
use condor_host::robot::{Robot, RobotLine};
use condor_scene::HandView;
use nalgebra::{SVector, Vector3};
use proptest::prelude::*;

use crate::utah_mit;

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
    let tendon = line(&lines, "ring.middle.extensor");
    assert_eq!(
        tendon.tension.as_deref(),
        Some("ring.middle.extensor.tension")
    );
    assert_eq!(line(&lines, "thumb").tension, None);
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
        ["flexor", "extensor"].map(|side| length(line(&lines, &format!("{name}.{side}"))))
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
