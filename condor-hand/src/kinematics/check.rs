//! The conditions on a mechanism under which its equations hold.

use nalgebra::{Matrix3, Vector3};

use crate::Subject;
use crate::math::{abs, max, sqrt};
use crate::number::{NumberError, Requirement, check, finite, positive};
use crate::pose::Pose;

const ORTHONORMAL: &str = "the error of the rotation, whose columns must be unit vectors at right angles, x, y and \
     z = x × y,";

/// The largest error of an entry of an orthonormal matrix: people write ten digits.
const TOLERANCE: f64 = 1e-9;

pub(super) fn position(part: Subject, at: &Vector3<f64>) -> Result<(), NumberError> {
    at.iter()
        .try_for_each(|&x| finite("a coordinate, m,", x))
        .map_err(|error| error.at(part))
}

pub(crate) fn pose(part: Subject, pose: &Pose) -> Result<(), NumberError> {
    position(part, &pose.position)?;
    let rotation = pose.rotation;
    let product = rotation.tr_mul(&rotation) - Matrix3::identity();
    let turned = abs(rotation.determinant() - 1.0);
    let off = product
        .iter()
        .fold(turned, |off, &entry| max(off, abs(entry)));
    let mut entries = pose.rotation.iter();
    entries
        .try_for_each(|&x| finite("an entry of the rotation", x))
        .and_then(|()| check(ORTHONORMAL, off, Requirement::AtMost(TOLERANCE)))
        .map_err(|error| error.at(part))
}

pub(super) fn axis(joint: usize, axis: &Vector3<f64>) -> Result<(), NumberError> {
    let length = sqrt(axis.dot(axis));
    if abs(length - 1.0) <= TOLERANCE {
        return Ok(());
    }
    Err(NumberError {
        at: Subject::Joint(joint as u16),
        what: "the length of the axis",
        value: length,
        must: Requirement::Equal(1.0),
    })
}

pub(super) fn inertia(link: usize, inertia: &Matrix3<f64>) -> Result<(), NumberError> {
    body_inertia(inertia, TOLERANCE).map_err(|error| error.at(Subject::Link(link as u16)))
}

/// Checks that a body, perhaps a flat one, a thin one or a point, can have this inertia, up to `slack` of its
/// trace. With `S = tr(I)/2 - I`, the second moments of its mass, this is: `S` is symmetric and has no negative
/// principal minor.
pub(crate) fn body_inertia(inertia: &Matrix3<f64>, slack: f64) -> Result<(), NumberError> {
    if inertia.iter().all(|&entry| entry == 0.0) {
        return Ok(());
    }
    let trace = inertia.trace();
    positive("the sum of the moments of inertia, kg m²,", trace)?;
    // Of the scale of one, so that small bodies do not underflow.
    let scaled = inertia / trace;
    let second = Matrix3::from_diagonal_element(0.5) - scaled;
    let (x, y, z) = (second.m11, second.m22, second.m33);
    let sum = |moment: f64| Requirement::AtMost((1.0 - moment) * trace);
    let minor = |a: f64, b: f64, c: f64| {
        let most = Requirement::AtMost(sqrt(a * b) * trace);
        (a * b - c * c, abs(c), most)
    };
    let symmetric = |a: f64, b: f64| (-abs(a - b), a, Requirement::Equal(b * trace));
    let (xy, xz, yz) = (second.m12, second.m13, second.m23);
    let volume = second.determinant();
    for (what, (at_least_zero, part, must)) in [
        (MOMENTS[0], (x, scaled.m11, sum(scaled.m11))),
        (MOMENTS[1], (y, scaled.m22, sum(scaled.m22))),
        (MOMENTS[2], (z, scaled.m33, sum(scaled.m33))),
        (PRODUCTS[0], symmetric(scaled.m12, scaled.m21)),
        (PRODUCTS[1], symmetric(scaled.m13, scaled.m31)),
        (PRODUCTS[2], symmetric(scaled.m23, scaled.m32)),
        (PRODUCTS[0], minor(x, y, xy)),
        (PRODUCTS[1], minor(x, z, xz)),
        (PRODUCTS[2], minor(y, z, yz)),
        (VOLUME, (volume, volume, Requirement::AtLeast(0.0))),
    ] {
        let is_possible = at_least_zero >= -slack;
        if !is_possible {
            let (at, value) = (Subject::Whole, part * trace);
            return Err(NumberError {
                at,
                what,
                value,
                must,
            });
        }
    }
    Ok(())
}

const MOMENTS: [&str; 3] = [
    "the moment of inertia about x, which exceeds the sum of the two others in no body, kg m²,",
    "the moment of inertia about y, which exceeds the sum of the two others in no body, kg m²,",
    "the moment of inertia about z, which exceeds the sum of the two others in no body, kg m²,",
];
const PRODUCTS: [&str; 3] = [
    "the product of inertia of x and y, kg m²,",
    "the product of inertia of x and z, kg m²,",
    "the product of inertia of y and z, kg m²,",
];
const VOLUME: &str =
    "the determinant of the second moments of the mass, over the squared trace of the inertia,";
