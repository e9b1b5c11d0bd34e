use nalgebra::Vector3;

use crate::{Pose, Real};

/// A finger of four joints in closed form: the first turns the finger about the z axis of its
/// base, the others bend it in one plane, about parallel axes.
///
/// In the frame of the base the straight finger lies along x, and the three flexion axes along y.
/// Positive angles turn x to y, and x to -z. The links are straight; the body of each has its centre
/// of mass on the link and its principal axes along it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanarFinger<T: Real = f64> {
    /// The base in the palm: its origin is on the first axis, at the height of the second.
    pub base: Pose<T>,
    /// From each axis to the next, and from the last to the tip, m.
    pub lengths: [T; 4],
    /// The bodies of the links.
    pub bodies: [Rod<T>; 4],
}

/// A body on the line of its link with principal axes along the link's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rod<T: Real = f64> {
    /// Mass, kg.
    pub mass: T,
    /// The centre of mass, from the link's own axis along the link, m.
    pub center: T,
    /// Moments of inertia about the centre of mass: along x (the link), y (the flexion axis) and z,
    /// kg m².
    pub inertia: Vector3<T>,
}
