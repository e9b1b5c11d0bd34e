//! What holds for any grasp that is not nearly a line.

use condor_hand::grasp::{Contacts, GraspError, SpatialGain, Squeeze, Twist, Wrench};
use nalgebra::{Matrix6, Rotation3, SMatrix, Vector3};
use proptest::array::{uniform3, uniform4};
use proptest::prelude::*;

use super::wrenches::{difference, size, square_sum, tip_motions, wrench_of};

fn vector(size: f64) -> impl Strategy<Value = Vector3<f64>> {
    uniform3(-size..size).prop_map(Vector3::from)
}

fn wrench() -> impl Strategy<Value = Wrench> {
    (vector(10.0), vector(0.3)).prop_map(|(force, moment)| Wrench { force, moment })
}

fn place() -> impl Strategy<Value = Vector3<f64>> {
    vector(0.1)
}

/// Contacts whose conditioning is not the worst there is.
fn spread<const M: usize>(points: &[Vector3<f64>; M]) -> bool {
    let center = points.iter().sum::<Vector3<f64>>() / M as f64;
    let inertia = points
        .iter()
        .map(|point| point - center)
        .fold(SMatrix::<f64, 3, 3>::zeros(), |inertia, r| {
            inertia + SMatrix::identity() * r.norm_squared() - r * r.transpose()
        });
    let third = inertia.trace() / 3.0;
    third > 1e-5 && inertia.determinant() > 0.02 * third.powi(3)
}

fn three() -> impl Strategy<Value = [Vector3<f64>; 3]> {
    uniform3(place()).prop_filter("on a line", spread)
}

fn four() -> impl Strategy<Value = [Vector3<f64>; 4]> {
    uniform4(place()).prop_filter("on a line", spread)
}

/// The wrench is made, and any internal force beside it costs.
fn least_forces<const M: usize>(
    points: [Vector3<f64>; M],
    wrench: &Wrench,
    about: &Vector3<f64>,
    edges: &[f64; 6],
) {
    let contacts = Contacts::new(points).unwrap();
    let held = contacts.forces(wrench, about).unwrap();
    let made = wrench_of(&points, &held.forces, about);
    let wrong = size(&(made.force - wrench.force), &(made.moment - wrench.moment));
    assert!(
        wrong <= 1e-12 * size(&wrench.force, &wrench.moment),
        "{wrong}"
    );

    let mut edges = edges.iter();
    for first in 0..M {
        for second in first + 1..M {
            let force = *edges.next().unwrap();
            let squeeze = Squeeze::none()
                .with_edge(first, second, force.abs())
                .unwrap();
            let Ok(internal) = contacts.internal_forces(&squeeze) else {
                continue;
            };
            let none = wrench_of(&points, &internal, about);
            assert!(size(&none.force, &none.moment) < 1e-14 * (1.0 + force.abs()));
            let mut more = held.forces;
            for (more, internal) in more.iter_mut().zip(internal) {
                *more += internal * force.signum();
            }
            // Orthogonal to the least forces: their squares add.
            let squares = square_sum(&held.forces) + square_sum(&internal);
            assert!((square_sum(&more) - squares).abs() <= 1e-12 * (1.0 + squares));
        }
    }
}

/// The forces of three contacts in a plane, by another way: the parts normal to the plane are
/// statically determinate, and the rest turns about the normal.
fn triangle(
    points: &[Vector3<f64>; 3],
    wrench: &Wrench,
    about: &Vector3<f64>,
) -> [Vector3<f64>; 3] {
    let center = points.iter().sum::<Vector3<f64>>() / 3.0;
    let moment = wrench.moment - (center - about).cross(&wrench.force);
    let area = (points[1] - points[0]).cross(&(points[2] - points[0]));
    let normal = area.normalize();
    let squares: f64 = points
        .iter()
        .map(|point| (point - center).norm_squared())
        .sum();
    std::array::from_fn(|i| {
        let opposite = points[(i + 2) % 3] - points[(i + 1) % 3];
        let out = normal.cross(&opposite).dot(&normal.cross(&moment)) / area.norm();
        let turn = moment.dot(&normal) / squares;
        wrench.force / 3.0 + normal * out + normal.cross(&(points[i] - center)) * turn
    })
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 500,
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    #[test]
    fn three_fingers_make_the_wrench_with_the_least_forces(
        points in three(), wrench in wrench(), about in place(),
        edges in prop::array::uniform6(-5.0..5.0),
    ) {
        least_forces(points, &wrench, &about, &edges);
        let forces = Contacts::new(points).unwrap().forces(&wrench, &about).unwrap().forces;
        let size = square_sum(&forces).sqrt();
        prop_assert!(difference(&forces, &triangle(&points, &wrench, &about)) < 1e-12 * (1.0 + size));
    }

    #[test]
    fn four_fingers_make_the_wrench_with_the_least_forces(
        points in four(), wrench in wrench(), about in place(),
        edges in prop::array::uniform6(-5.0..5.0),
    ) {
        least_forces(points, &wrench, &about, &edges);
    }

    #[test]
    fn a_small_rigid_motion_is_found(
        points in three(), linear in vector(0.01), angular in vector(0.1), about in place(),
    ) {
        let twist = Twist { linear, angular };
        let motions = tip_motions(&points, &twist, &about);
        let seen = Contacts::new(points).unwrap().object_motion(&motions, &about).unwrap();
        prop_assert!((seen.linear - linear).norm() < 1e-13);
        prop_assert!((seen.angular - angular).norm() < 1e-12);
    }

    #[test]
    fn any_rigid_motion_is_found(
        points in four(), linear in vector(0.1), axis in vector(1.0), angle in 0.0..3.1_f64,
        about in place(),
    ) {
        prop_assume!(axis.norm() > 0.01);
        let axis = axis.normalize();
        let turn = Rotation3::from_scaled_axis(axis * angle);
        let moved = points.map(|point| about + linear + turn * (point - about));
        let contacts = Contacts::new(points).unwrap();
        let seen = contacts.rigid_motion(&moved, &about).unwrap();
        let wrong = (seen.angular - axis * angle).norm();
        prop_assert!(wrong < 1e-12, "{wrong}");
        prop_assert!((seen.linear - linear).norm() < 1e-12);

        let [a, b, c, _] = points;
        prop_assume!(spread(&[a, b, c]));
        let [d, e, f, _] = moved;
        let seen = Contacts::new([a, b, c]).unwrap().rigid_motion(&[d, e, f], &about).unwrap();
        let wrong = (seen.angular - axis * angle).norm();
        prop_assert!(wrong < 1e-12, "three: {wrong}");
    }

    #[test]
    fn tips_that_slipped_are_fitted_by_least_squares(
        points in four(), axis in vector(1.0), slip in uniform4(vector(0.004)),
    ) {
        let turn = Rotation3::from_scaled_axis(axis);
        let moved: [_; 4] = std::array::from_fn(|i| turn * (points[i] + slip[i]));
        let contacts = Contacts::new(points).unwrap();
        let seen = contacts.rigid_motion(&moved, &Vector3::zeros()).unwrap();
        let residual = |angular: Vector3<f64>, linear: Vector3<f64>| -> f64 {
            let turn = Rotation3::from_scaled_axis(angular);
            let pairs = points.iter().zip(&moved);
            pairs.map(|(point, moved)| (turn * point + linear - moved).norm_squared()).sum()
        };
        let least = residual(seen.angular, seen.linear);
        for axis in 0..3 {
            let step = Vector3::ith(axis, 1e-4);
            for step in [step, -step] {
                // A turn about the middle, so that the shift does not hide it.
                let center = contacts.centroid();
                let other = Rotation3::from_scaled_axis(step) * Rotation3::from_scaled_axis(seen.angular);
                let shift = Rotation3::from_scaled_axis(seen.angular) * center + seen.linear - other * center;
                prop_assert!(residual(other.scaled_axis(), shift) > least);
                prop_assert!(residual(seen.angular, seen.linear + step) > least);
            }
        }
    }

    #[test]
    fn a_gain_is_taken_exactly_if_it_has_no_negative_eigenvalue(
        numbers in prop::collection::vec(-1.0..1.0, 36), rank in 0_usize..7,
        sink in -0.2..0.2_f64, units in prop::array::uniform6(-3_i32..4),
    ) {
        let factors = Matrix6::from_fn(|i, j| if j < rank { numbers[6 * i + j] } else { 0.0 });
        let product = factors * factors.transpose();
        let unit = Matrix6::from_diagonal(&units.map(|power| 10.0_f64.powi(power)).into());
        let lower = if sink < -0.01 { -sink } else { 0.0 };
        let matrix = Matrix6::from_fn(|i, j| product[(i, j)]) - Matrix6::identity() * lower;
        let least = matrix.symmetric_eigenvalues().min();
        let gain = SpatialGain::new(&(unit * matrix * unit));
        if least > -1e-14 {
            prop_assert!(gain.is_ok(), "{least}: {gain:?}");
        } else if least < -1e-3 {
            let least_pivot = condor_hand::Requirement::AtLeast(0.0);
            let refused = matches!(gain, Err(GraspError::Number(error)) if error.must == least_pivot);
            prop_assert!(refused, "{least}: {gain:?}");
        }
    }
}
