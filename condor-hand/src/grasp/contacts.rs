use nalgebra::Vector3;

use super::wrench::finite;
use super::{GraspError, Twist, Wrench, coincident, off, quantity, too_few, too_large};
use crate::control::linear::Symmetric3;
use crate::math::{abs, is_finite, sqrt};
use crate::number::{self, NumberError};
use crate::{Requirement, Subject};

/// The points at which M fingers touch one object. From these points alone follow the forces that produce a wrench on
/// the object, and the motion of the object that belongs to motions of the tips.
///
/// The method is the minimum-norm solution of `G f = w` without the grasp matrix G (6×3M). Such a solution is
/// `f = Gᵀ y`, so `f_i = a + b × r_i` with arms `r_i` from the centroid m of the contacts. The arms sum to zero, which
/// separates the two equations: `M a = F` and `J b = M_m`, with `J = Σ (|r_i|² I - r_i r_iᵀ)`, the inertia of unit
/// masses at the contacts, and `M_m` the moment about m. Hence `f_i = F/M + (J⁻¹ M_m) × r_i`. In the spirit of
/// Hollerbach, Narasimhan and Wood, "Finger force computation without the grip Jacobian" (1986).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contacts<const M: usize> {
    points: [Vector3<f64>; M],
    centroid: Vector3<f64>,
    /// From the centroid to each contact, m.
    arms: [Vector3<f64>; M],
    /// The (pseudo-)inverse of the inertia of unit masses at the contacts, 1/m².
    inverse: Symmetric3,
    /// The trace of that inertia: twice the sum of the squares of the arms, m².
    trace: f64,
}

/// The forces of M fingers on an object that together produce a requested wrench, as
/// [`Contacts::forces`] computes them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FingerForces<const M: usize> {
    /// The force of each finger on the object, N.
    pub forces: [Vector3<f64>; M],
    /// The part of the requested moment that the forces do not produce, N m. It is zero for three
    /// contacts or more; for two, it is the part about the line through them.
    pub lost_moment: Vector3<f64>,
}

/// The least conditioning of three contacts or more.
const LEAST_CONDITIONING: f64 = 1e-9;

/// The least sum of squares of arms, relative to the square of the distance of the centroid: below
/// it the arms are mostly rounding.
const LEAST_SPREAD: f64 = (1024.0 * f64::EPSILON) * (1024.0 * f64::EPSILON);

/// Refuses vectors with a component that is infinite or NaN.
pub(super) fn check<const M: usize>(
    vectors: &[Vector3<f64>; M],
    quantity: &'static str,
) -> Result<(), NumberError> {
    let mut vectors = vectors.iter().enumerate();
    vectors.try_for_each(|(finger, vector)| check_list(finger, quantity, vector.as_slice()))
}

/// Refuses a finger's list with an entry that is infinite or NaN.
pub(super) fn check_list(
    finger: usize,
    quantity: &'static str,
    list: &[f64],
) -> Result<(), NumberError> {
    list.iter()
        .try_for_each(|&entry| number::finite(quantity, entry))
        .map_err(|error| error.at(Subject::Finger(finger as u16)))
}

#[inline(always)]
pub(super) fn share<const M: usize>() -> f64 {
    1.0 / f64::from(M as u32)
}

#[inline(always)]
pub(super) fn sum(vectors: &[Vector3<f64>]) -> Vector3<f64> {
    let mut sum = Vector3::zeros();
    for vector in vectors {
        sum += vector;
    }
    sum
}

impl<const M: usize> Contacts<M> {
    /// Makes the contacts of an object from the positions of the fingertips, `points` (m), in the
    /// frame of the palm.
    ///
    /// # Errors
    /// [`Number`](GraspError::Number) if a number is not finite, if all contacts are one point, or if three or more
    /// lie on a line.
    #[inline(always)]
    pub fn new(points: [Vector3<f64>; M]) -> Result<Self, GraspError> {
        let centroid = sum(&points) * share::<M>();
        let arms = points.map(|point| point - centroid);
        let mut inertia = Symmetric3::zero();
        for arm in &arms {
            inertia.add_point(arm);
        }
        let trace = inertia.trace();
        let apart = trace > LEAST_SPREAD * centroid.norm_squared();
        let inverse = match M {
            0 => None,
            1 => finite(&centroid).then(Symmetric3::zero),
            // Two opposite arms: J is the projection across the line, times the sum of squares.
            2 => {
                let factor = 1.0 / (trace * trace * 0.25);
                (apart && is_finite(factor) && factor > 0.0).then(|| inertia.scaled(factor))
            }
            _ => {
                let (adjugate, determinant) = inertia.adjugate();
                let third = trace * (1.0 / 3.0);
                let factor = 1.0 / determinant;
                let regular =
                    determinant > LEAST_CONDITIONING * (third * third * third) && is_finite(factor);
                (apart && regular).then(|| adjugate.scaled(factor))
            }
        };
        match inverse {
            Some(inverse) => Ok(Self {
                points,
                centroid,
                arms,
                inverse,
                trace,
            }),
            None => Err(explain(&points)),
        }
    }

    /// Returns the positions of the contacts in the frame of the palm, m.
    #[must_use]
    pub fn points(&self) -> &[Vector3<f64>; M] {
        &self.points
    }

    /// Returns the centroid: the mean of the contacts' positions, m.
    #[must_use]
    pub fn centroid(&self) -> &Vector3<f64> {
        &self.centroid
    }

    /// From the centroid to each contact, m.
    #[inline(always)]
    pub(super) fn arms(&self) -> &[Vector3<f64>; M] {
        &self.arms
    }

    /// Twice the sum of the squares of the arms, m².
    #[inline(always)]
    pub(super) fn trace(&self) -> f64 {
        self.trace
    }

    /// The rotation that a moment of arms and motions (or of arms and forces) belongs to.
    #[inline(always)]
    pub(super) fn turn(&self, moment: &Vector3<f64>) -> Vector3<f64> {
        self.inverse.times(moment)
    }

    /// Returns the forces of the fingers on the object that together produce `wrench`, whose moment
    /// is about the point `about` (m). Of all such forces these have the least sum of squares.
    ///
    /// Two contacts cannot produce a moment about the line through them; the result contains the
    /// moment that is missing.
    ///
    /// # Errors
    /// [`Number`](GraspError::Number) if the wrench is not finite, or if the result exceeds the range of
    /// the type; for one contact unless the wrench is a force through it.
    #[inline(always)]
    pub fn forces(
        &self,
        wrench: &Wrench,
        about: &Vector3<f64>,
    ) -> Result<FingerForces<M>, GraspError> {
        let lever = self.centroid - about;
        let moment = wrench.moment - lever.cross(&wrench.force);
        let turn = self.turn(&moment);
        let part = wrench.force * share::<M>();
        // The arms are from the rounded centroid. Near a line the turn is so large that their sum,
        // which is not zero, would be most of what the wrench lacks.
        let rest = sum(&self.arms) * share::<M>();
        let forces = self.arms.map(|arm| part + turn.cross(&(arm - rest)));
        let total = sum(&forces);
        // One sum is cheaper than a test for each component: infinities and NaN stay in it.
        if !is_finite(total.x + total.y + total.z + moment.x + moment.y + moment.z) {
            return Err(not_finite(wrench, about));
        }
        let lost_moment = match M {
            1 => {
                // The moment is a difference of these.
                let terms = wrench.moment.amax() + lever.amax() * wrench.force.amax();
                if moment.amax() > terms * f64::EPSILON * 16.0 {
                    let what = "the moment about a single contact, N m,";
                    return Err(off(what, moment.amax(), Requirement::Equal(0.0)));
                }
                Vector3::zeros()
            }
            2 => {
                let lost = moment - turn * (self.trace * 0.5);
                // A moment near the largest number rounds to beyond it.
                if !finite(&lost) {
                    return Err(not_finite(wrench, about));
                }
                lost
            }
            _ => Vector3::zeros(),
        };
        Ok(FingerForces {
            forces,
            lost_moment,
        })
    }

    /// Returns the motion of the object that fits the motions of the tips best. `tips` are small
    /// motions (m) or velocities (m/s) of the tips; the linear part of the result is that of the
    /// object's point at `about` (m).
    ///
    /// With two contacts the rotation about the line through them is taken as zero, and with one
    /// contact all rotation.
    ///
    /// This is the dual of [`forces`](Self::forces): minimising `Σ |d_i - t - o × r_i|²` leads to
    /// `o = J⁻¹ Σ r_i × d_i` with the same J.
    ///
    /// # Errors
    /// [`Number`](GraspError::Number) if a motion or the point is not finite, or if the result exceeds
    /// the range of the type.
    #[inline]
    pub fn object_motion(
        &self,
        tips: &[Vector3<f64>; M],
        about: &Vector3<f64>,
    ) -> Result<Twist, GraspError> {
        let mut moment = Vector3::zeros();
        for (arm, tip) in self.arms.iter().zip(tips) {
            moment += arm.cross(tip);
        }
        let angular = self.turn(&moment);
        let linear = sum(tips) * share::<M>() - angular.cross(&(self.centroid - about));
        let twist = Twist { linear, angular };
        if twist.is_finite() {
            return Ok(twist);
        }
        check(tips, quantity::TIP_MOTION)?;
        check_about(about)?;
        Err(too_large(quantity::TIP_MOTION))
    }
}

#[cold]
fn not_finite(wrench: &Wrench, about: &Vector3<f64>) -> GraspError {
    let checked = check_wrench(wrench).and_then(|()| check_about(about));
    checked.map_or_else(GraspError::from, |()| too_large(quantity::FORCE))
}

/// Refuses a wrench with a part that is infinite or NaN.
pub(super) fn check_wrench(wrench: &Wrench) -> Result<(), NumberError> {
    let mut force = wrench.force.iter();
    let mut moment = wrench.moment.iter();
    force.try_for_each(|&part| number::finite("a part of the force, N,", part))?;
    moment.try_for_each(|&part| number::finite("a part of the moment, N m,", part))
}

/// Refuses a point of a wrench or a motion with a coordinate that is infinite or NaN.
pub(super) fn check_about(about: &Vector3<f64>) -> Result<(), NumberError> {
    let mut about = about.iter();
    about.try_for_each(|&x| number::finite("a coordinate of the point that it is about, m,", x))
}

/// Returns the reason why there is no inverse. It computes the inertia again, so that where there is an
/// inverse the inertia stays in registers.
#[cold]
fn explain<const M: usize>(points: &[Vector3<f64>; M]) -> GraspError {
    if M == 0 {
        return too_few(M, 1.0);
    }
    if let Err(error) = check(points, quantity::TIP) {
        return error.into();
    }
    let centroid = sum(points) * share::<M>();
    let mut inertia = Symmetric3::zero();
    for point in points {
        inertia.add_point(&(point - centroid));
    }
    let trace = inertia.trace();
    let third = trace * (1.0 / 3.0);
    let cube = third * third * third;
    if !is_finite(cube) || !is_finite(centroid.norm_squared()) {
        return too_large(quantity::TIP);
    }
    let spread = LEAST_SPREAD * centroid.norm_squared();
    let (_, determinant) = inertia.adjugate();
    // Below this the inverse of the determinant is beyond the range of numbers.
    let inverse = 1.0 / cube;
    if M >= 3 && trace > spread && is_finite(inverse) {
        let what = "the conditioning of the contacts, which is 0 on a line,";
        let must = Requirement::Above(LEAST_CONDITIONING);
        return off(what, abs(determinant) / cube, must);
    }
    let mut points = points.iter();
    let distance = match (points.next(), points.next()) {
        (Some(first), Some(second)) => sqrt((second - first).norm_squared()),
        _ => 0.0,
    };
    coincident(1, distance, sqrt(spread))
}
