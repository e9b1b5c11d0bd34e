//! The dynamics of a finger, in closed form and as a chain, against other programs and against
//! physics.

use condor_hand::Pose;
use condor_hand::dynamics::Dynamics;
use condor_hand::kinematics::{PlanarFinger, Rod};
use nalgebra::{Matrix4, Rotation3, SMatrix, Vector3, Vector4};
use proptest::num;
use proptest::prelude::*;
use serde::Deserialize;

use crate::support::{FINGERS, geometry, joints, reference, vector};

#[derive(Deserialize)]
struct Cases {
    cases: Vec<Case>,
}

#[derive(Deserialize)]
struct Case {
    q: Vec<f64>,
    qd: Vec<f64>,
    qdd: Vec<f64>,
    gravity: [f64; 3],
    base_acc: [f64; 3],
    tau: Vec<f64>,
    nle: Vec<f64>,
    g: Vec<f64>,
    #[serde(rename = "M")]
    mass: [[[f64; 4]; 4]; FINGERS],
    tau_fd: Vec<f64>,
    qdd_fd: Vec<f64>,
}

/// Largest difference, relative to the largest entry.
fn apart<const R: usize, const C: usize>(x: &SMatrix<f64, R, C>, y: &SMatrix<f64, R, C>) -> f64 {
    (x - y).amax() / y.amax()
}

fn agrees_with_pinocchio(finger_of: impl Fn(usize) -> Box<dyn Dynamics<4>>) {
    let cases = reference::<Cases>("dynamics.json").cases;
    assert_eq!(cases.len(), 200);
    let still = Vector4::zeros();
    for (number, case) in cases.iter().enumerate() {
        let gravity = vector(case.gravity) - vector(case.base_acc);
        for finger in 0..FINGERS {
            let model = finger_of(finger);
            let of = |all: &[f64]| joints(all, finger);
            let (q, qd) = (of(&case.q), of(&case.qd));
            let mass = Matrix4::from_fn(|row, column| case.mass[finger][row][column]);
            let accelerations =
                model.forward_dynamics(&q, &qd, &of(&case.tau_fd), &gravity, &still);
            for (what, difference) in [
                (
                    "inverse dynamics",
                    apart(
                        &model.inverse_dynamics(&q, &qd, &of(&case.qdd), &gravity),
                        &of(&case.tau),
                    ),
                ),
                (
                    "bias",
                    apart(&model.bias(&q, &qd, &gravity), &of(&case.nle)),
                ),
                (
                    "gravity",
                    apart(&model.gravity_torque(&q, &gravity), &of(&case.g)),
                ),
                ("mass matrix", apart(&model.mass_matrix(&q), &mass)),
                (
                    "forward dynamics",
                    apart(&accelerations.unwrap(), &of(&case.qdd_fd)),
                ),
            ] {
                assert!(
                    difference < 1e-12,
                    "{what} of finger {finger} in case {number}: {difference}"
                );
            }
        }
    }
}

#[test]
fn the_closed_form_agrees_with_pinocchio() {
    agrees_with_pinocchio(|finger| Box::new(geometry().finger(finger)));
}

#[test]
fn the_chain_agrees_with_pinocchio() {
    agrees_with_pinocchio(|finger| Box::new(geometry().chain(finger)));
}

/// The four decimals and more that a calculation by hand would keep: 5e-10 N m, or kg m².
fn is(found: &Vector4<f64>, milli: [f64; 4]) {
    let difference = (found * 1e3 - Vector4::from(milli)).amax();
    assert!(difference < 1e-6, "{found} is not {milli:?} / 1000");
}

#[test]
fn torques_and_inertias_have_their_known_values() {
    let gravity = Vector3::new(0.0, 0.0, -9.81);
    let hand = geometry();
    let finger = hand.finger(0);
    let straight = Vector4::zeros();
    is(
        &finger.gravity_torque(&straight, &gravity),
        [0.0, -57.783_353, -17.523_112, -2.955_263],
    );
    let bent = Vector4::new(0.2, 0.9, 1.0, 0.8);
    let held = [0.0, -17.644_762, 7.381_404, 2.671_770];
    is(&finger.gravity_torque(&bent, &gravity), held);
    is(
        &hand.finger(3).gravity_torque(&bent, &gravity),
        held.map(|torque| -torque),
    );
    let ones = Vector4::repeat(1.0);
    is(
        &finger.inverse_dynamics(&bent, &ones, &ones, &gravity),
        [-0.205_985, -17.439_837, 7.613_892, 2.742_644],
    );
    let mass = finger.mass_matrix(&bent) * 1e3;
    for (column, micro) in [
        [88.130_178, 0.0, 0.0, 0.0],
        [0.0, 286.643_752, 94.308_687, 9.642_744],
        [0.0, 94.308_687, 62.604_021, 12.599_552],
        [0.0, 9.642_744, 12.599_552, 5.673_417],
    ]
    .into_iter()
    .enumerate()
    {
        is(&mass.column(column).into_owned(), micro);
    }
}

/// A finger with bodies anywhere on its links, and a base in any direction.
fn fingers() -> impl Strategy<Value = PlanarFinger> {
    let rods = [(); 4].map(|()| (0.005..0.2, -0.02..0.1, prop::array::uniform3(1e-6..5e-5)));
    let place = prop::array::uniform3(-3.0..3.0);
    (place.clone(), place, [(); 4].map(|()| 0.005..0.1), rods).prop_map(
        |(turn, position, lengths, rods)| {
            PlanarFinger::new(
                Pose {
                    rotation: Rotation3::new(Vector3::from(turn)).into_inner(),
                    position: Vector3::from(position),
                },
                lengths,
                rods.map(|(mass, center, inertia)| Rod {
                    mass,
                    center,
                    inertia: Vector3::new(
                        inertia[1] + inertia[2],
                        inertia[0] + inertia[2],
                        inertia[0] + inertia[1],
                    ),
                }),
            )
            .unwrap()
        },
    )
}

fn vectors(largest: f64) -> impl Strategy<Value = Vector4<f64>> {
    prop::array::uniform4(-largest..largest).prop_map(Vector4::from)
}

fn fields() -> impl Strategy<Value = Vector3<f64>> {
    prop::array::uniform3(-12.0..12.0).prop_map(Vector3::from)
}

/// Angles anywhere, also beyond where they have a meaning.
fn angles() -> impl Strategy<Value = Vector4<f64>> {
    prop::array::uniform4(num::f64::NORMAL | num::f64::ZERO | num::f64::SUBNORMAL)
        .prop_map(Vector4::from)
}

proptest! {
    #[test]
    fn the_closed_form_is_the_chain(
        finger in fingers(), q in vectors(4.0), qd in vectors(10.0), qdd in vectors(300.0),
        torque in vectors(1.0), gravity in fields(),
    ) {
        let general = finger.chain();
        let armature = Vector4::new(1e-5, 2e-5, 3e-5, 4e-5);
        let near = |what: &str, found: &Vector4<f64>, expected: &Vector4<f64>| {
            let difference = apart(found, expected);
            prop_assert!(difference < 1e-11, "{what}: {difference}");
            Ok(())
        };
        near(
            "inverse dynamics",
            &finger.inverse_dynamics(&q, &qd, &qdd, &gravity),
            &general.inverse_dynamics(&q, &qd, &qdd, &gravity),
        )?;
        near("bias", &finger.bias(&q, &qd, &gravity), &general.bias(&q, &qd, &gravity))?;
        near(
            "gravity",
            &finger.gravity_torque(&q, &gravity),
            &general.gravity_torque(&q, &gravity),
        )?;
        near(
            "forward dynamics",
            &finger.forward_dynamics(&q, &qd, &torque, &gravity, &armature).unwrap(),
            &general.forward_dynamics(&q, &qd, &torque, &gravity, &armature).unwrap(),
        )?;
        prop_assert!(apart(&finger.mass_matrix(&q), &general.mass_matrix(&q)) < 1e-12);
    }

    #[test]
    fn the_torques_of_an_acceleration_cause_it(
        finger in fingers(), q in vectors(4.0), qd in vectors(10.0), qdd in vectors(300.0),
        gravity in fields(), armature in prop::array::uniform4(0.0..1e-4),
    ) {
        let armature = Vector4::from(armature);
        let torque = finger.inverse_dynamics(&q, &qd, &qdd, &gravity) + armature.component_mul(&qdd);
        let caused = finger.forward_dynamics(&q, &qd, &torque, &gravity, &armature).unwrap();
        prop_assert!(apart(&caused, &qdd) < 1e-9, "{caused} {qdd}");
    }

    #[test]
    fn the_mass_matrix_is_symmetric_and_positive_definite(finger in fingers(), q in angles()) {
        for mass in [finger.mass_matrix(&q), finger.chain().mass_matrix(&q)] {
            prop_assert_eq!(mass, mass.transpose());
            prop_assert!(mass.symmetric_eigenvalues().min() > 0.0, "{}", mass);
        }
    }

    #[test]
    fn finite_arguments_give_finite_answers(
        finger in fingers(), q in angles(), qd in vectors(1e150), qdd in vectors(1e300),
        torque in vectors(1e300), gravity in fields(),
    ) {
        for model in [&finger as &dyn Dynamics<4>, &finger.chain()] {
            let still = Vector4::zeros();
            let answers = [
                model.inverse_dynamics(&q, &qd, &qdd, &gravity),
                model.bias(&q, &qd, &gravity),
                model.gravity_torque(&q, &gravity),
                model.forward_dynamics(&q, &qd, &torque, &gravity, &still).unwrap(),
            ];
            for answer in answers {
                prop_assert!(answer.iter().all(|x| x.is_finite()), "{}", answer);
            }
        }
    }
}

#[test]
fn a_finger_without_inertia_has_no_forward_dynamics() {
    let mut finger = geometry().finger(0);
    let (q, gravity) = (Vector4::repeat(0.5), Vector3::new(0.0, 0.0, -9.81));
    let accelerations = |finger: &PlanarFinger, torque, armature| {
        let closed = finger.forward_dynamics(&q, &q, &torque, &gravity, &armature);
        let general = finger
            .chain()
            .forward_dynamics(&q, &q, &torque, &gravity, &armature);
        assert_eq!(closed.is_some(), general.is_some());
        closed
    };
    let none = Vector4::zeros();
    assert!(accelerations(&finger, none, none).is_some());
    assert_eq!(
        accelerations(&finger, Vector4::repeat(f64::NAN), none),
        None
    );
    let massless = Rod {
        mass: 0.0,
        center: 0.0,
        inertia: Vector3::zeros(),
    };
    finger = PlanarFinger::new(*finger.base(), *finger.lengths(), [massless; 4]).unwrap();
    assert_eq!(accelerations(&finger, none, none), None);
    for joint in 0..4 {
        let mut armature = Vector4::repeat(1e-5);
        armature[joint] = 0.0;
        assert_eq!(accelerations(&finger, none, armature), None);
    }
    assert_eq!(
        accelerations(&finger, none, Vector4::repeat(1e-5)),
        Some(none)
    );
}
