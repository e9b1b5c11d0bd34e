use condor_hand::grasp::{ContactFriction, Contacts, Normals, SpatialGain, Squeeze, Twist, Wrench};
use condor_hand::kinematics::Jacobian;
use nalgebra::{Matrix6, Vector3};
use serde::Deserialize;

use super::law::{hand, states};
use super::wrenches::{difference, size, tip_motions, twist, wrench, wrench_of};
use crate::support;

#[derive(Deserialize)]
struct File<C> {
    cases: Vec<C>,
}

#[derive(Deserialize)]
struct Case {
    n: usize,
    c: [f64; 3],
    p: Vec<[f64; 3]>,
    normal_inward: Vec<[f64; 3]>,
    wrench: [f64; 6],
    rank: usize,
    realizable: bool,
    f_pinv: Vec<[f64; 3]>,
    residual: f64,
    edges: Vec<(usize, usize)>,
    edge_lambda: Vec<f64>,
    f_internal: Vec<[f64; 3]>,
    null_dim: usize,
    #[serde(rename = "K")]
    stiffness: [[f64; 6]; 6],
    dx: [f64; 6],
    f_stiff: Vec<[f64; 3]>,
    dx_from_tips: [f64; 6],
    mu: f64,
    min_equal_edge_lambda: Option<f64>,
}

/// The rotation about the line of two contacts, as a twist about c: what their forces do not feel,
/// and as a wrench what they cannot make.
fn blind<const M: usize>(points: &[Vector3<f64>; M], c: &Vector3<f64>) -> Option<Wrench> {
    let [first, second] = points.as_slice() else {
        return None;
    };
    let line = (second - first).normalize();
    let blind = Wrench {
        force: -line.cross(&(first - c)),
        moment: line,
    };
    let norm = size(&blind.force, &blind.moment);
    Some(Wrench {
        force: blind.force / norm,
        moment: blind.moment / norm,
    })
}

/// The wrench without its part along the blind direction: the nearest that two contacts can make.
fn realizable(wrench: &Wrench, blind: Option<&Wrench>) -> Wrench {
    let Some(blind) = blind else { return *wrench };
    let part = wrench.force.dot(&blind.force) + wrench.moment.dot(&blind.moment);
    Wrench {
        force: wrench.force - blind.force * part,
        moment: wrench.moment - blind.moment * part,
    }
}

fn vectors(rows: &[[f64; 3]]) -> Vec<Vector3<f64>> {
    rows.iter().map(|&row| Vector3::from(row)).collect()
}

fn check<const M: usize>(index: usize, case: &Case) {
    let points: [Vector3<f64>; M] = vectors(&case.p).try_into().unwrap();
    let c = Vector3::from(case.c);
    let contacts = Contacts::new(points).unwrap();
    let blind = blind(&points, &c);
    let forces_of = |wrench: &Wrench| {
        let nearest = realizable(wrench, blind.as_ref());
        let held = contacts.forces(&nearest, &c).unwrap();
        assert!(held.lost_moment.amax() < 1e-14, "case {index}");
        held.forces
    };

    let asked = wrench(&case.wrench);
    let forces = forces_of(&asked);
    assert!(
        difference(&forces, &vectors(&case.f_pinv)) < 1e-12,
        "case {index}"
    );

    // All of the wrench that two contacts cannot make is the moment that the answer names.
    let held = contacts.forces(&asked, &c).unwrap();
    let made = wrench_of(&points, &held.forces, &c);
    let missing = asked.moment - made.moment - held.lost_moment;
    let asked_size = size(&asked.force, &asked.moment);
    assert!(
        size(&(asked.force - made.force), &missing) < 1e-12 * asked_size,
        "case {index}"
    );
    let complete = held.lost_moment.norm() < 1e-12 * asked_size;
    assert_eq!(complete, case.realizable, "case {index}");
    assert_eq!(case.realizable, case.residual < 1e-12, "case {index}");
    assert_eq!(case.rank, if M == 2 { 5 } else { 6 }, "case {index}");
    assert_eq!(case.null_dim, 3 * M - case.rank, "case {index}");

    let mut squeeze = Squeeze::none();
    for (&(first, second), &force) in case.edges.iter().zip(&case.edge_lambda) {
        squeeze = squeeze.with_edge(first, second, force).unwrap();
    }
    let internal = contacts.internal_forces(&squeeze).unwrap();
    assert!(
        difference(&internal, &vectors(&case.f_internal)) < 1e-12,
        "case {index}"
    );

    let rows = &case.stiffness;
    let stiffness = SpatialGain::new(&Matrix6::from_fn(|row, column| rows[row][column])).unwrap();
    let displacement = twist(&case.dx);
    let stiff = forces_of(&stiffness.times(&displacement));
    assert!(
        difference(&stiff, &vectors(&case.f_stiff)) < 1e-12,
        "case {index}"
    );

    let motions = tip_motions(&points, &displacement, &c);
    let Twist { linear, angular } = contacts.object_motion(&motions, &c).unwrap();
    let (force, moment) = (linear, angular);
    let seen = realizable(&Wrench { force, moment }, blind.as_ref());
    let expected = wrench(&case.dx_from_tips);
    let wrong = size(
        &(seen.force - expected.force),
        &(seen.moment - expected.moment),
    );
    assert!(wrong < 1e-12, "case {index}: {wrong}");

    let normals: [Vector3<f64>; M] = vectors(&case.normal_inward).try_into().unwrap();
    let normals = Normals::new(normals).unwrap();
    let friction = ContactFriction::point(case.mu).unwrap();
    let direction = contacts
        .internal_forces(&Squeeze::equal(1.0).unwrap())
        .unwrap();
    let Some(least) = case.min_equal_edge_lambda else {
        return;
    };
    // With the least squeeze of the other program, which halves intervals, one contact is about to slip.
    let held = std::array::from_fn(|contact| forces[contact] + direction[contact] * least);
    let margins = friction.margins(&normals, &held).unwrap();
    let worst = margins.into_iter().fold(f64::INFINITY, f64::min);
    let slack = 1e-9 * least.max(1.0);
    assert!(worst > -slack, "case {index}: {worst}");
    assert!(worst < slack || least < slack, "case {index}: {worst}");
}

#[test]
fn forces_motions_and_squeezes_are_those_of_the_pseudo_inverse() {
    let File::<Case> { cases } = support::reference("grasp.json");
    for (index, case) in cases.iter().enumerate() {
        match case.n {
            2 => check::<2>(index, case),
            3 => check::<3>(index, case),
            4 => check::<4>(index, case),
            other => panic!("{other} contacts"),
        }
    }
    assert!(cases.len() > 50);
}

#[derive(Deserialize)]
struct StiffnessCase {
    q: [f64; 16],
    c: [f64; 3],
    #[serde(rename = "K_diag")]
    stiffness: [f64; 6],
    dx: [f64; 6],
    f: [[f64; 3]; 4],
    tau: [f64; 16],
    #[serde(rename = "K_joint")]
    joint_stiffness: Vec<Vec<f64>>,
}

/// How the joints of each finger move the object, `(G⁺)ᵀ J`, by the motion that fits those of the tips.
fn object_jacobians(
    contacts: &Contacts<4>,
    jacobians: &[Jacobian<4>; 4],
    about: &Vector3<f64>,
) -> [Jacobian<4>; 4] {
    std::array::from_fn(|finger| {
        let columns: [_; 4] = std::array::from_fn(|joint| {
            let mut tips = [Vector3::zeros(); 4];
            tips[finger] = jacobians[finger].fixed_view::<3, 1>(0, joint).into_owned();
            let Twist { linear, angular } = contacts.object_motion(&tips, about).unwrap();
            nalgebra::vector![
                linear.x, linear.y, linear.z, angular.x, angular.y, angular.z
            ]
        });
        Jacobian::from_columns(&columns)
    })
}

#[test]
fn torques_and_joint_stiffness_are_those_of_the_whole_grasp_matrix() {
    let hand = hand();
    let File::<StiffnessCase> { cases } = support::reference("stiffness.json");
    for (index, case) in cases.iter().enumerate() {
        let c = Vector3::from(case.c);
        let states = states(&hand, &case.q);
        let tips = states.map(|state| state.tip);
        let jacobians: [Jacobian<4>; 4] = states.map(|state| state.jacobian);
        let contacts = Contacts::new(tips).unwrap();
        let stiffness = SpatialGain::diagonal(case.stiffness).unwrap();
        let forces = contacts
            .forces(&stiffness.times(&twist(&case.dx)), &c)
            .unwrap()
            .forces;
        assert!(
            difference(&forces, &vectors(&case.f)) < 1e-12,
            "case {index}"
        );
        for (finger, (jacobian, force)) in jacobians.iter().zip(&forces).enumerate() {
            let torque = jacobian.fixed_rows::<3>(0).tr_mul(force);
            for joint in 0..4 {
                let wrong = torque[joint] - case.tau[4 * finger + joint];
                assert!(
                    wrong.abs() < 1e-12,
                    "case {index}, finger {finger}: {wrong}"
                );
            }
        }
        let motions = object_jacobians(&contacts, &jacobians, &c);
        let blocks = motions.map(|row| {
            let loads = row.transpose() * stiffness.matrix();
            motions.map(|column| loads * column)
        });
        for (row, line) in case.joint_stiffness.iter().enumerate() {
            for (column, expected) in line.iter().enumerate() {
                let gain = blocks[row / 4][column / 4][(row % 4, column % 4)];
                assert!(
                    (gain - expected).abs() < 1e-12,
                    "case {index}: {row}, {column}"
                );
            }
        }
    }
    assert!(cases.len() > 50);
}
