use condor_hand::Pose;
use condor_hand::kinematics::Kinematics;
use condor_host::robot::{Frame, Robot};
use condor_scene::HandView;
use nalgebra::{Matrix4, Quaternion, SVector, Translation3, UnitQuaternion};
use proptest::prelude::*;

use crate::{UtahMit, gripper, utah_mit};

fn matrix(frame: &Frame) -> Matrix4<f64> {
    let [x, y, z, w] = frame.rotation;
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
    Translation3::from(frame.translation).to_homogeneous() * rotation.to_homogeneous()
}

/// Returns a frame in the palm, by its parents.
fn in_palm(frames: &[Frame], name: &str) -> Matrix4<f64> {
    let Some(place) = frames.iter().position(|frame| frame.name == name) else {
        assert_eq!(name, "palm");
        return Matrix4::identity();
    };
    // Parents come first.
    in_palm(&frames[..place], &frames[place].parent) * matrix(&frames[place])
}

fn homogeneous(pose: &Pose) -> Matrix4<f64> {
    Translation3::from(pose.position).to_homogeneous() * pose.rotation.to_homogeneous()
}

fn check(hand: &UtahMit, positions: &[f64]) {
    let frames = HandView::new(hand).frames(positions);
    assert_eq!(frames.len(), 4 * 5);
    for (finger, own) in hand.fingers.iter().zip(positions.chunks(4)) {
        let q = SVector::<f64, 4>::from_column_slice(own);
        let tip = match finger.planar() {
            Some(planar) => planar.tip(&q),
            None => finger.chain().tip(&q),
        };
        let difference = in_palm(&frames, &format!("{}.tip", finger.name)) - homogeneous(&tip);
        assert!(difference.amax() < 1e-12, "{}: {difference}", finger.name);
    }
}

proptest! {
    #[test]
    fn the_tips_are_where_the_kinematics_say(
        positions in proptest::collection::vec(-3.0..3.0_f64, 16),
    ) {
        check(&utah_mit(), &positions);
        check(&gripper(), &positions);
    }
}

#[test]
fn what_is_no_number_counts_as_0() {
    let view = HandView::new(&utah_mit());
    let straight = view.frames(&[0.0; 16]);
    assert_eq!(view.frames(&[]), straight);
    assert_eq!(view.frames(&[f64::NAN, f64::INFINITY]), straight);
    assert_eq!(view.frames(&[0.0; 99]), straight);
}

#[test]
fn joints_have_the_names_of_the_servos_variables() {
    let view = HandView::new(&utah_mit());
    let joint = &view.joints()[7];
    assert_eq!(joint.name, "middle.distal");
    assert_eq!(joint.position, "middle.distal.position");
    assert_eq!(joint.velocity.as_deref(), Some("middle.distal.velocity"));
    assert_eq!(joint.effort.as_deref(), Some("middle.distal.torque"));
    assert!(joint.limits[0] > 0.08 && joint.limits[1] < 1.6);
}
