//! The table under the palm, and what the fingers feel of it.

use condor_hand::plant::{AxisParameters, SimHand, SimStop, SimTable};
use nalgebra::Vector3;

use super::mechanisms::{Slider, exact, finger, free_joint, hand_parameters};

const AXIS: AxisParameters = AxisParameters {
    mass: 10.0,
    viscous: 20.0,
    max_n: 50.0,
    range: (-0.1, 0.3),
    stop: SimStop {
        stiffness: 1e5,
        damping: 500.0,
    },
};

#[test]
fn an_axis_nears_the_speed_at_which_friction_takes_all_force() {
    let mut table = SimTable::new(
        [AxisParameters {
            range: (-100.0, 100.0),
            ..AXIS
        }; 3],
    )
    .unwrap();
    // Beyond the limit of force, within it, and no number.
    let forces = Vector3::new(400.0, -10.0, f64::NAN);
    for _ in 0..500 {
        table.advance(1e-3, &forces).unwrap();
    }
    let share = 1.0 - libm::exp(-1.0);
    assert!((table.velocity().x - 2.5 * share).abs() < 2e-3);
    assert!((table.velocity().y + 0.5 * share).abs() < 1e-3);
    assert_eq!(table.velocity().z, 0.0);
}

#[test]
fn an_axis_rests_on_its_stop() {
    let mut table = SimTable::new([AXIS; 3]).unwrap();
    for _ in 0..5000 {
        table
            .advance(1e-3, &Vector3::new(50.0, -50.0, 0.0))
            .unwrap();
    }
    let expected = Vector3::new(0.3 + 50.0 / 1e5, -0.1 - 50.0 / 1e5, 0.0);
    assert!((table.position() - expected).amax() < 1e-9, "{table:?}");
}

#[test]
fn a_palm_that_speeds_up_leaves_a_free_finger_behind() {
    let slider = Slider {
        mass: 0.1,
        base: Vector3::zeros(),
    };
    let finger = finger(slider, free_joint(), exact(0.01));
    let axis = AxisParameters {
        range: (-100.0, 100.0),
        ..AXIS
    };
    let mut hand = SimHand::new([finger], hand_parameters(Vector3::zeros(), 0.5))
        .unwrap()
        .with_table(SimTable::new([axis; 3]).unwrap());
    hand.drive_table(Vector3::new(30.0, -20.0, 10.0)).unwrap();
    for _ in 0..200 {
        hand.step(&[[0.0; 6]]).unwrap();
    }
    let table = hand.table().unwrap().position();
    assert!(table.norm() > 0.1, "{table:?}");
    // In the world it stayed where it was.
    assert!((hand.fingers()[0].q() + table).amax() < 1e-12);
    assert!((hand.time_s() - 0.5).abs() < 1e-12);
}
