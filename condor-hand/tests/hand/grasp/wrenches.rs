//! What forces at contacts do, by definition.

use condor_hand::grasp::{Twist, Wrench};
use nalgebra::Vector3;

/// The wrench of forces on the object: `G f`.
pub(crate) fn wrench_of(
    points: &[Vector3<f64>],
    forces: &[Vector3<f64>],
    about: &Vector3<f64>,
) -> Wrench {
    let mut wrench = Wrench::zero();
    for (point, force) in points.iter().zip(forces) {
        wrench.force += force;
        wrench.moment += (point - about).cross(force);
    }
    wrench
}

/// The motions of the tips with the object: `Gᵀ d`.
pub(crate) fn tip_motions<const M: usize>(
    points: &[Vector3<f64>; M],
    twist: &Twist,
    about: &Vector3<f64>,
) -> [Vector3<f64>; M] {
    points.map(|point| twist.linear + twist.angular.cross(&(point - about)))
}

pub(crate) fn wrench(numbers: &[f64; 6]) -> Wrench {
    let (force, moment) = numbers.split_at(3);
    Wrench {
        force: Vector3::from_column_slice(force),
        moment: Vector3::from_column_slice(moment),
    }
}

pub(crate) fn twist(numbers: &[f64; 6]) -> Twist {
    let Wrench { force, moment } = wrench(numbers);
    Twist {
        linear: force,
        angular: moment,
    }
}

/// The Euclidean norm of all six numbers.
pub(crate) fn size(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    a.norm().hypot(b.norm())
}

pub(crate) fn square_sum(forces: &[Vector3<f64>]) -> f64 {
    forces.iter().map(Vector3::norm_squared).sum()
}

/// The greatest difference of a component.
pub(crate) fn difference(left: &[Vector3<f64>], right: &[Vector3<f64>]) -> f64 {
    assert_eq!(left.len(), right.len());
    let pairs = left.iter().zip(right);
    pairs.map(|(a, b)| (a - b).amax()).fold(0.0, f64::max)
}
