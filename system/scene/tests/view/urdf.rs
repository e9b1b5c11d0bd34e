use std::f64::consts::{FRAC_PI_2, PI};

use condor_hand::config::Rotation;
use condor_hand::kinematics::Kinematics;
use condor_host::robot::Robot;
use condor_scene::HandView;
use nalgebra::{Isometry3, SVector, Translation3, Unit, UnitQuaternion, Vector3};
use proptest::prelude::*;
use roxmltree::{Document, Node};

use crate::{UtahMit, gripper, utah_mit, with_motors};

fn child<'n>(node: Node<'n, 'n>, name: &str) -> Node<'n, 'n> {
    let found = node.children().find(|it| it.has_tag_name(name));
    found.unwrap_or_else(|| panic!("no <{name}> in {node:?}"))
}

fn three(text: &str) -> [f64; 3] {
    let numbers: Vec<f64> = text.split(' ').map(|word| word.parse().unwrap()).collect();
    numbers.try_into().unwrap()
}

/// Where a link is in the palm, as the text alone says it.
fn placed(robot: Node<'_, '_>, link: &str, position: &dyn Fn(&str) -> f64) -> Isometry3<f64> {
    if link == "palm" {
        return Isometry3::identity();
    }
    let is_it = |joint: &Node<'_, '_>| {
        joint.has_tag_name("joint") && child(*joint, "child").attribute("link") == Some(link)
    };
    let joint = robot.children().find(is_it).unwrap();
    let parent = child(joint, "parent").attribute("link").unwrap();
    let origin = child(joint, "origin");
    let [roll, pitch, yaw] = three(origin.attribute("rpy").unwrap());
    let origin = Isometry3::from_parts(
        Translation3::from(three(origin.attribute("xyz").unwrap())),
        UnitQuaternion::from_euler_angles(roll, pitch, yaw),
    );
    let q = position(joint.attribute("name").unwrap());
    let axis = || Vector3::from(three(child(joint, "axis").attribute("xyz").unwrap()));
    let motion = match joint.attribute("type") {
        Some("revolute") => {
            let rotation = UnitQuaternion::from_axis_angle(&Unit::new_normalize(axis()), q);
            Isometry3::from_parts(Translation3::identity(), rotation)
        }
        Some("prismatic") => Translation3::from(axis() * q).into(),
        kind => {
            assert_eq!(kind, Some("fixed"));
            Isometry3::identity()
        }
    };
    placed(robot, parent, position) * origin * motion
}

fn check(hand: &UtahMit, positions: &[f64]) {
    let view = HandView::new(hand);
    let text = view.urdf().unwrap();
    let document = Document::parse(&text).unwrap();
    let robot = document.root_element();
    let position = |name: &str| {
        let place = view.joints().iter().position(|joint| joint.name == name);
        place.map_or(0.0, |place| positions[place])
    };
    for (finger, own) in hand.fingers.iter().zip(positions.chunks(4)) {
        let q = SVector::<f64, 4>::from_column_slice(own);
        let tip = finger.chain().tip(&q);
        let placed = placed(robot, &format!("{}.tip", finger.name), &position);
        let difference = placed.translation.vector - tip.position;
        assert!(difference.amax() < 1e-9, "{}: {difference}", finger.name);
        let rotation = placed.rotation.to_rotation_matrix();
        assert!((rotation.matrix() - tip.rotation).amax() < 1e-9);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn the_tips_are_where_the_kinematics_say(
        positions in proptest::collection::vec(-3.0..3.0_f64, 16),
    ) {
        check(&utah_mit(), &positions);
        check(&gripper(), &positions);
    }
}

/// Checks a hand whose base and first mounts are turned by these angles.
fn check_turned(base: [f64; 3], mount: [f64; 3], positions: &[f64]) {
    let mut hand = gripper();
    for finger in &mut hand.fingers {
        finger.base.rotation = Rotation::Rpy(base);
        finger.joints[0].mount.as_mut().unwrap().rotation = Rotation::Rpy(mount);
    }
    check(&hand, positions);
}

proptest! {
    #[test]
    fn every_rotation_is_written_exactly(
        base in [-PI..PI, -FRAC_PI_2..FRAC_PI_2, -PI..PI],
        mount in [-PI..PI, -FRAC_PI_2..FRAC_PI_2, -PI..PI],
        // How far the pitch of both together is from a right angle, and to which side it is.
        exponent in -18..0_i32,
        up in any::<bool>(),
    ) {
        check_turned(base, mount, &[0.1; 16]);
        let pitch = FRAC_PI_2 - 10_f64.powi(exponent);
        let pitch = if up { pitch } else { -pitch };
        check_turned([0.0, pitch - mount[1], 0.0], [mount[0], mount[1], 0.0], &[0.1; 16]);
    }
}

#[test]
fn a_pitch_of_a_right_angle_is_written_exactly() {
    for base in [10.0_f64, 43.0, 0.0, -180.0] {
        for roll in [45.0_f64, 60.0, 115.0, -90.0] {
            let pitch = (90.0 - base).to_radians();
            check_turned(
                [0.0, base.to_radians(), 0.0],
                [roll.to_radians(), pitch, 0.0],
                &[0.1; 16],
            );
        }
    }
    let base = [0.0, 0.174_532_925_199_432_95, 0.0];
    let mount = [1.047_197_551_196_597_6, 1.396_263_401_595_463_6, 0.0];
    check_turned(base, mount, &[0.1; 16]);
}

#[test]
fn links_are_the_frames_and_joints_have_limits() {
    let view = HandView::new(&utah_mit());
    let text = view.urdf().unwrap();
    let document = Document::parse(&text).unwrap();
    let robot = document.root_element();
    assert_eq!(robot.attribute("name"), Some("utah-mit"));
    let named = |tag: &'static str| {
        let found = robot.children().filter(move |node| node.has_tag_name(tag));
        found.map(|node| node.attribute("name").unwrap().to_owned())
    };
    let mut frames = vec!["palm".to_owned()];
    frames.extend(view.frames(&[]).into_iter().map(|frame| frame.name));
    assert_eq!(named("link").collect::<Vec<_>>(), frames);
    // No joint has the name of a link: tools look both up in one list.
    let joints = frames
        .iter()
        .skip(1)
        .map(|frame| match frame.strip_suffix("_link") {
            Some(joint) => joint.to_owned(),
            None => format!("{frame}_joint"),
        });
    let joints: Vec<_> = joints.collect();
    assert_eq!(named("joint").collect::<Vec<_>>(), joints);
    assert!(joints.iter().all(|joint| !frames.contains(joint)));
    for joint in view.joints() {
        let find = |name: &str| {
            let mut nodes = robot.children();
            nodes
                .find(|node| node.attribute("name") == Some(name))
                .unwrap()
        };
        let link = find(&format!("{}_link", joint.name));
        let limit = child(find(&joint.name), "limit");
        let number = |name| -> f64 { limit.attribute(name).unwrap().parse().unwrap() };
        let limits = [number("lower"), number("upper")];
        assert_eq!(limits.map(f64::to_bits), joint.limits.map(f64::to_bits));
        assert!(number("effort") > 0.0 && number("velocity") > 0.0);
        let shape = child(child(link, "visual"), "geometry");
        assert!(three(child(shape, "box").attribute("size").unwrap())[0] > 0.0);
        let mass = child(child(link, "inertial"), "mass");
        assert!(mass.attribute("value").unwrap().parse::<f64>().unwrap() > 0.0);
    }
}

#[test]
fn a_name_cannot_break_the_text() {
    let mut hand = utah_mit();
    hand.name = "a<\"&".try_into().unwrap();
    let text = HandView::new(&hand).urdf().unwrap();
    let document = Document::parse(&text).unwrap();
    assert_eq!(document.root_element().attribute("name"), Some("a<\"&"));
}

/// The largest torque is that of all actuators together, to the stronger side.
#[test]
fn all_actuators_of_a_joint_give_its_largest_torque() {
    let efforts = |hand: &UtahMit| {
        let text = HandView::new(hand).urdf().unwrap();
        let document = Document::parse(&text).unwrap();
        let joints = document.root_element().children();
        let limits = joints.filter_map(|it| it.children().find(|it| it.has_tag_name("limit")));
        let efforts = limits.map(|it| it.attribute("effort").unwrap().parse().unwrap());
        efforts.take(4).collect::<Vec<f64>>()
    };
    let check = |efforts: &[f64], expected: [f64; 4]| {
        let mut both = efforts.iter().zip(&expected);
        let is_near = both.all(|(effort, expected)| (effort - expected).abs() < 1e-12);
        assert!(is_near, "{efforts:?} {expected:?}");
    };
    // The flexors pull with 130 N against 4 N.
    let arms = [0.0127, 0.0127 + 0.0095 + 0.008, 0.0095 + 0.008, 0.008];
    check(&efforts(&utah_mit()), arms.map(|arm| arm * (130.0 - 4.0)));
    // The motors push with 0.125 N m, and two of them at the last joint.
    let arms = [20.0, 30.0, 20.0, 25.0];
    check(&efforts(&with_motors()), arms.map(|arm| arm * 0.125));
    // Without arms that are possible nothing moves a joint, and neither does it without actuators.
    let mut hand = with_motors();
    hand.fingers[0].actuators[3].arms.clear();
    check(&efforts(&hand), [2.5, 3.75, 0.0, 3.125]);
    let arms = &mut hand.fingers[0].actuators[0].arms;
    let joint = "abduction".try_into().unwrap();
    arms.insert(joint, f64::NAN).unwrap();
    check(&efforts(&hand), [0.0; 4]);
}
