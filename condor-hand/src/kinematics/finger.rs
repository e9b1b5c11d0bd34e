use nalgebra::{Matrix3, SVector, Vector3, Vector6};

use super::check;
use super::{Chain, ChainBody, ChainJoint, ChainMotion, Jacobian, Kinematics};
use crate::math::{is_finite, of_sum, sin_cos, sqrt};
use crate::number::{NumberError, not_negative};
use crate::{Pose, Subject};

/// The model of a finger of four joints, with equations in closed form, which are faster than a [`Chain`]. The first
/// joint turns the finger about the z axis of its base; the others bend it in one plane, about parallel axes.
///
/// In the frame of the base the straight finger lies along x, and the three flexion axes along y. Positive angles turn
/// x to y, and x to -z. The links are straight; the body of each has its centre of mass on the link and its principal
/// axes along it.
///
/// # Equations
///
/// With the absolute angles `a1 = q1`, `a2 = a1 + q2` and `a3 = a2 + q3` of the links in their
/// plane, the tip lies beyond the axis of joint k by `X_k = Σ l_j cos a_j` along the finger and by
/// `Z_k = Σ l_j sin a_j` down (to -z), both over `j = k..=3`. In the frame of the base, with
/// `r = l0 + X_1`, the radial axis `e = (cos q0, sin q0, 0)`, the flexion axis
/// `y' = (-sin q0, cos q0, 0)` and z, the tip is at `r e - Z_1 z`; joint 0 moves it along `r y'` and
/// turns it about z; joint k moves it along `-Z_k e - X_k z` and turns it about y'. They follow from
/// the product of placements that [`Chain`] forms, with all axes written out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanarFinger {
    pub(crate) base: Pose,
    pub(crate) lengths: [f64; 4],
    pub(crate) bodies: [Rod; 4],
}

/// The body of a straight link of a [`PlanarFinger`]: its centre of mass is on the line of the
/// link, and its principal axes are those of the link.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rod {
    /// The mass, kg.
    pub mass: f64,
    /// The centre of mass, from the link's own axis along the link, m.
    pub center: f64,
    /// Moments of inertia about the centre of mass: along x (the link), y (the flexion axis) and z,
    /// kg m².
    pub inertia: Vector3<f64>,
}

impl Rod {
    fn body(&self) -> ChainBody {
        ChainBody {
            mass: self.mass,
            center: Vector3::new(self.center, 0.0, 0.0),
            inertia: Matrix3::from_diagonal(&self.inertia),
        }
    }
}

/// The finger in one posture, in its own plane.
#[derive(Clone, Copy)]
struct Posture {
    /// Sine and cosine of the first angle.
    turn: (f64, f64),
    /// Sine and cosine of the absolute angle of the last link.
    last: (f64, f64),
    /// The tip beyond each flexion axis, along the finger, m.
    along: [f64; 3],
    /// The tip below each flexion axis, m.
    down: [f64; 3],
    /// From the first axis to the tip, along the finger, m.
    radius: f64,
}

/// The axes of the plane of the finger, in the palm.
#[derive(Clone, Copy)]
struct Axes {
    radial: Vector3<f64>,
    flexion: Vector3<f64>,
    up: Vector3<f64>,
}

impl PlanarFinger {
    /// Makes a planar finger from its parts.
    ///
    /// * `base`: the pose of the finger's base in the palm. Its origin is on the axis of the first joint, at the height
    ///   of the second.
    /// * `lengths`: the distances from each joint axis to the next, and from the last axis to the tip, m.
    /// * `bodies`: the bodies of the links, proximal first.
    ///
    /// # Errors
    /// [`NumberError`] for the first part that cannot be: a rotation that is not orthonormal and
    /// right-handed, a negative length or mass, an inertia that no body has, or a number that is not
    /// finite.
    pub fn new(base: Pose, lengths: [f64; 4], bodies: [Rod; 4]) -> Result<Self, NumberError> {
        check::pose(Subject::Base, &base)?;
        for (link, &length) in lengths.iter().enumerate() {
            not_negative("the length, m,", length)
                .map_err(|error| error.at(Subject::Link(link as u16)))?;
        }
        for (link, rod) in bodies.iter().enumerate() {
            rod.body().check(link)?;
        }
        Ok(Self {
            base,
            lengths,
            bodies,
        })
    }

    /// Returns the pose of the finger's base in the frame of the palm.
    #[must_use]
    pub const fn base(&self) -> &Pose {
        &self.base
    }

    /// Returns the distances from each joint axis to the next, and from the last axis to the tip,
    /// m.
    #[must_use]
    pub const fn lengths(&self) -> &[f64; 4] {
        &self.lengths
    }

    /// Returns the bodies of the four links, proximal first.
    #[must_use]
    pub const fn bodies(&self) -> &[Rod; 4] {
        &self.bodies
    }

    /// Returns the same mechanism as a general [`Chain`].
    #[must_use]
    pub fn chain(&self) -> Chain<4> {
        let [l0, l1, l2, l3] = self.lengths;
        let joint =
            |offset, axis| ChainJoint::new(Pose::at(offset, 0.0, 0.0), ChainMotion::Revolute(axis));
        let joints = [
            joint(0.0, Vector3::z()),
            joint(l0, Vector3::y()),
            joint(l1, Vector3::y()),
            joint(l2, Vector3::y()),
        ];
        let bodies = self.bodies.map(|rod| rod.body());
        Chain::of(self.base, joints, bodies, (3, Vector3::new(l3, 0.0, 0.0)))
    }

    // Sines and cosines of the sums by addition theorems: for no finite angle does a sum overflow
    // or lose the smaller angle.
    #[inline(always)]
    fn posture(&self, q: &SVector<f64, 4>) -> Posture {
        let [l0, l1, l2, l3] = self.lengths;
        let (s1, c1) = sin_cos(q.y);
        let (s2, c2) = of_sum((s1, c1), sin_cos(q.z));
        let (s3, c3) = of_sum((s2, c2), sin_cos(q.w));
        let (x3, z3) = (l3 * c3, l3 * s3);
        let (x2, z2) = (x3 + l2 * c2, z3 + l2 * s2);
        let (x1, z1) = (x2 + l1 * c1, z2 + l1 * s1);
        Posture {
            turn: sin_cos(q.x),
            last: (s3, c3),
            along: [x1, x2, x3],
            down: [z1, z2, z3],
            radius: l0 + x1,
        }
    }

    #[inline(always)]
    fn axes(&self, turn: (f64, f64)) -> Axes {
        let rotation = &self.base.rotation;
        let (s0, c0) = turn;
        let (x, y, up) = (
            rotation.fixed_columns::<1>(0),
            rotation.fixed_columns::<1>(1),
            rotation.fixed_columns::<1>(2).into_owned(),
        );
        Axes {
            radial: x * c0 + y * s0,
            flexion: y * c0 - x * s0,
            up,
        }
    }

    #[inline(always)]
    fn tip_of(&self, posture: &Posture, axes: &Axes) -> Pose {
        let (s3, c3) = posture.last;
        let [down, _, _] = posture.down;
        Pose {
            rotation: Matrix3::from_columns(&[
                axes.radial * c3 - axes.up * s3,
                axes.flexion,
                axes.radial * s3 + axes.up * c3,
            ]),
            position: self.base.position + axes.radial * posture.radius - axes.up * down,
        }
    }
}

/// The closed form: four sines and cosines for the tip and its Jacobian.
impl Kinematics<4> for PlanarFinger {
    #[inline]
    fn tip(&self, q: &SVector<f64, 4>) -> Pose {
        let posture = self.posture(q);
        self.tip_of(&posture, &self.axes(posture.turn))
    }

    #[inline]
    fn kinematics(&self, q: &SVector<f64, 4>) -> (Pose, Jacobian<4>) {
        let posture = self.posture(q);
        let axes = self.axes(posture.turn);
        let column = |linear: Vector3<f64>, angular: Vector3<f64>| {
            Vector6::new(
                linear.x, linear.y, linear.z, angular.x, angular.y, angular.z,
            )
        };
        let flexion = |down: f64, along: f64| {
            let linear = -(axes.radial * down + axes.up * along);
            column(linear, axes.flexion)
        };
        let [x1, x2, x3] = posture.along;
        let [z1, z2, z3] = posture.down;
        let jacobian = Jacobian::from_columns(&[
            column(axes.flexion * posture.radius, axes.up),
            flexion(z1, x1),
            flexion(z2, x2),
            flexion(z3, x3),
        ]);
        (self.tip_of(&posture, &axes), jacobian)
    }

    /// The cross product of the rows X and Z: `(0, X2 Z3 - X3 Z2, X3 Z1 - X1 Z3, X1 Z2 - X2 Z1)`,
    /// of unit length; joint 1 flexes where joint 3 is flexed. There is none where the finger is
    /// straight, so that the rows are parallel, and another where the tip is on the first axis.
    fn self_motion(&self, q: &SVector<f64, 4>) -> Option<SVector<f64, 4>> {
        let posture = self.posture(q);
        let along = Vector3::from(posture.along);
        let down = Vector3::from(posture.down);
        let normal = along.cross(&down);
        let size = along.norm_squared() + down.norm_squared();
        let square = normal.norm_squared();
        // Within √ε of either singularity, in proportion, what remains is rounding.
        let least = size * f64::EPSILON;
        if !(square > least * size && posture.radius * posture.radius > least && is_finite(square))
        {
            return None;
        }
        let unit = normal / sqrt(square);
        Some(SVector::from([0.0, unit.x, unit.y, unit.z]))
    }
}
