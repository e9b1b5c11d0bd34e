//! The stiffness of a ball that the whole hand holds, measured along and about all axes.

use condor_hand::grasp::distributed::GraspSettings;
use condor_host::robot::Simulator;
use condor_scene::HandView;
use nalgebra::{Matrix6, Quaternion, UnitQuaternion, Vector3, Vector6};

use crate::typist::{Typist, grasps, hand, run};

/// The displacements by which forces and moments are chosen: m, rad. From 3 mm on joints come to their
/// stops, which are stiff, too; from 0.1 rad on two fingers touch each other.
const ALONG_M: f64 = 2.5e-3;
const ABOUT_RAD: f64 = 0.095;
/// Pushes along and about an axis, in parts of those: counts of the sensors differ from one to the other,
/// and what they round with them.
const PARTS: [f64; 2] = [0.75, 1.0];

/// Where the ball is, a mean of some instants.
#[derive(Clone, Copy, Debug)]
struct Place {
    position: Vector3<f64>,
    orientation: UnitQuaternion<f64>,
}

/// Waits until the ball rests, and for the mean of what the sensors let it do then.
fn rests(typist: &mut Typist<'_>) -> Place {
    const COUNT: u32 = 30;
    let hand = hand();
    typist.wait(1.2);
    let mut position = Vector3::zeros();
    let mut orientation = Quaternion::new(0.0, 0.0, 0.0, 0.0);
    let mut least = Vector3::repeat(f64::INFINITY);
    let mut greatest = -least;
    for _ in 0..COUNT {
        typist.wait(0.01);
        let truth = typist.truth();
        assert_eq!((truth.touching, truth.sliding), (0b1111, 0));
        for (finger, joints) in truth.position.iter().enumerate() {
            for (joint, position) in joints.iter().enumerate() {
                let (low, high) = hand.joint(finger, joint).unwrap().rest_range();
                let is_free = (low..=high).contains(position);
                assert!(is_free, "joint {joint} of finger {finger} is at its stop");
            }
        }
        for clearance in HandView::new(&hand).clearances(truth.position.as_flattened()) {
            assert!(clearance.distance_m > 0.0, "{clearance:?}");
        }
        let at = Vector3::from(truth.ball);
        (least, greatest) = (least.inf(&at), greatest.sup(&at));
        position += at / f64::from(COUNT);
        let [w, x, y, z] = truth.orientation;
        orientation += Quaternion::new(w, x, y, z) / f64::from(COUNT);
    }
    let moves = (greatest - least).amax();
    assert!(moves < 2e-4, "the ball does not rest: {moves} m");
    Place {
        position,
        orientation: UnitQuaternion::new_normalize(orientation),
    }
}

/// The displacement from one place to another: m, and rad about the axes of the palm.
fn displacement(from: &Place, to: &Place) -> Vector6<f64> {
    let along = to.position - from.position;
    let about = (to.orientation * from.orientation.inverse()).scaled_axis();
    Vector6::new(along.x, along.y, along.z, about.x, about.y, about.z)
}

/// The stiffness of the ball that is held, from pushes to both sides along and about each axis.
fn measured(typist: &mut Typist<'_>, ordered: &Matrix6<f64>) -> Matrix6<f64> {
    let mut compliance = Matrix6::zeros();
    for axis in 0..6 {
        let size = if axis < 3 { ALONG_M } else { ABOUT_RAD };
        let mut pushed = |push: f64| {
            let mut wrench = [0.0; 6];
            wrench[axis] = push;
            let numbers = wrench.map(|number| number.to_string()).join(" ");
            typist.does(&format!("push {numbers}"));
            rests(typist)
        };
        let (mut moved, mut wrenches) = (Vector6::zeros(), 0.0);
        for part in PARTS {
            let push = ordered[(axis, axis)] * size * part;
            let (to, back) = (pushed(push), pushed(-push));
            moved += displacement(&back, &to);
            wrenches += 2.0 * push;
        }
        compliance.set_column(axis, &(moved / wrenches));
    }
    compliance.try_inverse().unwrap()
}

/// How far each entry is from what was ordered, in parts of the geometric mean of the two diagonal
/// entries.
fn deviations(measured: &Matrix6<f64>, ordered: &Matrix6<f64>) -> Matrix6<f64> {
    Matrix6::from_fn(|row, column| {
        let size = (ordered[(row, row)] * ordered[(column, column)]).sqrt();
        (measured[(row, column)] - ordered[(row, column)]) / size
    })
}

fn ordered(name: &str) -> Matrix6<f64> {
    let path = grasps().join(format!("{name}.toml"));
    let text = std::fs::read_to_string(&path).unwrap();
    let settings = GraspSettings::from_toml(&text, name).unwrap();
    Matrix6::from(settings.stiffness)
}

/// Has the hand hold a ball at a place by a grasp.
fn hold(typist: &mut Typist<'_>, ball: &str, grasp: &str) {
    typist.reaches_for_a_ball();
    typist.does(ball);
    typist.wait(0.2);
    typist.does(grasp);
    typist.wait(2.0);
    typist.does("letgo 1");
    typist.wait(3.0);
    assert_eq!(typist.truth().touching, 0b1111);
}

#[test]
fn the_whole_stiffness_of_a_ball_is_the_one_in_the_file() {
    run(|typist| {
        let wanted = ordered("insert");
        hold(typist, "ball 0.02 0.05", "grasp insert");
        let stiffness = measured(typist, &wanted);
        let deviations = deviations(&stiffness, &wanted) * 100.0;
        println!("measured:{stiffness:.4}deviations, percent:{deviations:.2}");
        let worst = deviations.amax();
        assert!(worst < 2.0, "{worst} percent:{deviations:.2}");
    });
}

#[test]
fn a_ball_is_held_where_it_is_seen() {
    run(|typist| {
        typist.reaches_for_a_ball();
        let place = [0.118, -0.003, -0.0585];
        typist.does("ball 0.016 0.05 0.118 -0.003 -0.0585");
        let status = typist.says("status");
        let line = "object: a ball of 0.0160 m at 0.1180 -0.0030 -0.0585 m from the palm\n";
        assert!(status.contains(line), "{status}");
        typist.does("grasp firm");
        typist.wait(2.0);
        typist.does("letgo 1");
        typist.wait(3.0);
        let truth = typist.truth();
        assert_eq!((truth.touching, truth.sliding), (0b1111, 0));
        for (is, was) in truth.ball.iter().zip(place) {
            assert!((is - was).abs() < 1e-3, "{:?}", truth.ball);
        }
        typist.does("release");
        typist.says("ball none");
        typist.wait(0.5);
        assert_eq!(
            typist.says("grasp firm"),
            "error: no ball is in sight: `ball` adds a simulated one\n"
        );
    });
}
