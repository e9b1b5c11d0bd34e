//! The dynamics of a finger, in closed form and as a chain, against other programs and against
//! physics.

mod support;

use condor_hand::dynamics::Dynamics;
use nalgebra::{Matrix4, SMatrix, Vector4};
use serde::Deserialize;

use support::{FINGERS, geometry, joints, reference, vector};

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

fn agrees_with_pinocchio(finger_of: impl Fn(usize) -> Box<dyn Dynamics<f64, 4>>) {
    let cases = reference::<Cases>("dynamics.json").cases;
    assert_eq!(cases.len(), 200);
    let still = Vector4::zeros();
    for (number, case) in cases.iter().enumerate() {
        let gravity = vector::<f64>(case.gravity) - vector(case.base_acc);
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
    agrees_with_pinocchio(|finger| Box::new(geometry().finger::<f64>(finger)));
}

#[test]
fn the_chain_agrees_with_pinocchio() {
    agrees_with_pinocchio(|finger| Box::new(geometry().chain::<f64>(finger)));
}
