//! Symmetric matrices, and equations with them.

#![allow(
    clippy::float_cmp,
    reason = "the tests say where a number is exactly another"
)]

use condor_hand::control::linear::{Ldl, Symmetric3};
use nalgebra::{Matrix4, Vector3, Vector4};

const MATRIX: Symmetric3 = Symmetric3 {
    xx: 4.0,
    xy: 1.0,
    xz: -2.0,
    yy: 5.0,
    yz: 0.5,
    zz: 3.0,
};

#[test]
fn cofactors_invert() {
    let (adjugate, determinant) = MATRIX.adjugate();
    let there = Vector3::new(1.0, -2.0, 3.0);
    assert!((adjugate.times(&MATRIX.times(&there)) / determinant - there).amax() < 1e-14);
    // 4 (15 - 1/4) - (3 + 1) - 2 (1/2 + 10)
    assert_eq!(determinant, 34.0);
}

#[test]
fn a_point_adds_its_inertia() {
    let mut inertia = Symmetric3::zero();
    inertia.add_point(&Vector3::new(1.0, 2.0, -1.0));
    // No inertia about the line through the point, |r|² across it.
    assert_eq!(
        inertia.times(&Vector3::new(1.0, 2.0, -1.0)),
        Vector3::zeros()
    );
    assert_eq!(
        inertia.times(&Vector3::new(2.0, -1.0, 0.0)),
        Vector3::new(12.0, -6.0, 0.0)
    );
    assert_eq!(inertia.trace(), 12.0);
}

#[test]
fn solves_what_is_positive_definite() {
    let root = Matrix4::new(
        1.0, 0.2, -0.5, 3.0, 0.0, 2.0, 0.7, -1.0, 0.3, 0.1, 1.5, 0.4, 0.9, -0.6, 0.8, 1.0,
    );
    let matrix = root * root.transpose();
    let right = Vector4::new(1.0, -2.0, 0.5, 4.0);
    let factors = Ldl::new(&matrix).unwrap();
    assert!((matrix * factors.solve(&right) - right).amax() < 1e-12);
    let mut lower = matrix;
    lower.fill_upper_triangle(f64::NAN, 1);
    let from_lower = Ldl::new(&lower).unwrap();
    assert_eq!(from_lower.solve(&right), factors.solve(&right));
}

#[test]
fn refuses_what_is_not() {
    assert!(Ldl::new(&Matrix4::<f64>::zeros()).is_none());
    let indefinite = Matrix4::from_diagonal(&Vector4::new(1.0, 2.0, -1e-9, 1.0));
    assert!(Ldl::new(&indefinite).is_none());
    assert!(Ldl::new(&Matrix4::from_element(f64::NAN)).is_none());
    assert!(Ldl::new(&Matrix4::from_element(f64::INFINITY)).is_none());
    // The reciprocal of the pivot overflows.
    assert!(Ldl::new(&Matrix4::from_diagonal_element(1e-310)).is_none());
}
