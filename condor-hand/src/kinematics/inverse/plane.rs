//! The plane of a finger: its target there, and the two links that reach it.

use heapless::Vec;
use nalgebra::{SVector, Vector3};

use super::{Branches, InverseError, check_finite, unreachable};
use crate::Subject;
use crate::kinematics::PlanarFinger;
use crate::math::{Real, abs, atan2, max, real, sin_cos, sqrt, wrap};
use crate::number::{Requirement, check};

/// A target in the plane of the finger, seen from the second axis.
#[derive(Clone, Copy)]
pub(super) struct Aim<T> {
    /// The first joint that turns the plane to the target, rad.
    pub(super) turn: T,
    /// Along the straight finger, m.
    pub(super) along: T,
    /// Down, m.
    pub(super) down: T,
}

/// The least and the greatest distance of a planar finger's tip from the axis of its second joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reach<T> {
    /// The least distance of the tip, m.
    pub least: T,
    /// The largest distance of the tip, m.
    pub greatest: T,
}

impl<T: Real> PlanarFinger<T> {
    /// Returns the range of distances that the tip can have from the axis of the second joint, if
    /// the limits of the joints are not regarded. The greatest one is the sum of the last three
    /// links; the least one is the excess of the longest of these links over the two others, or
    /// zero.
    #[must_use]
    pub fn reach(&self) -> Reach<T> {
        let [_, l1, l2, l3] = self.lengths.map(abs);
        let greatest = l1 + l2 + l3;
        let longest = max(l1, max(l2, l3));
        Reach {
            least: max(longest - (greatest - longest), T::zero()),
            greatest,
        }
    }

    /// The target in the plane of the finger: with the finger turned to it, and, where the tip
    /// curls back behind the first axis, turned away from it.
    pub(super) fn aims(
        &self,
        target: &Vector3<T>,
        present: &SVector<T, 4>,
    ) -> Result<Vec<Aim<T>, 2>, InverseError> {
        check_finite("a coordinate of the target", target.iter())?;
        check_finite("an angle of the present posture", present.iter())?;
        for (link, (&length, least)) in self.lengths.iter().zip([0.0, 1e-9, 1e-9, 0.0]).enumerate()
        {
            check("the length, m,", length, Requirement::Within(least, 1e9))
                .map_err(|error| error.at(Subject::Link(link as u16)))?;
        }

        let local = self.base.rotation.transpose() * (target - self.base.position);
        check_finite("a coordinate of the target, in the base", local.iter())?;
        let [first, ..] = self.lengths;
        let radius = distance(local.x, local.y);
        check_finite("the distance of the target from the first axis", [&radius])?;
        let mut aims = Vec::new();
        let mut aim = |turn, radius: T| {
            // There is room for two.
            let _ = aims.push(Aim {
                turn,
                along: radius - first,
                down: -local.z,
            });
        };
        if radius <= real::<T>(4.0) * T::default_epsilon() * (first + self.reach().greatest) {
            aim(present.x, T::zero());
        } else {
            aim(atan2(local.y, local.x), radius);
            aim(atan2(-local.y, -local.x), -radius);
        }
        Ok(aims)
    }

    /// The axis of the last joint, from the second, where the tip is at the aim with this pitch.
    pub(super) fn last_axis(&self, aim: &Aim<T>, pitch: T) -> (T, T) {
        let [_, _, _, l3] = self.lengths;
        let (s, c) = sin_cos(pitch);
        (aim.along - l3 * c, aim.down - l3 * s)
    }

    /// The angles of the second and third joints that bring the axis of the last to a point; bent
    /// to the side of `flexed`. Or how far out of reach the point is, m.
    ///
    /// By the law of cosines, as tan² of the half angle: `((l1 + l2)² - d²) / (d² - (l1 - l2)²)`,
    /// which keeps its digits where the finger is nearly straight (Siciliano et al., 2009,
    /// section 2.12.2).
    pub(super) fn two_links(&self, (along, down): (T, T), flexed: bool) -> Result<(T, T), T> {
        let [_, l1, l2, _] = self.lengths;
        let d = distance(along, down);
        let (greatest, least) = (l1 + l2, abs(l1 - l2));
        let short = max(d - greatest, least - d);
        if short > tolerance::<T>() * greatest {
            return Err(short);
        }
        let half = atan2(
            sqrt((greatest - d) * (greatest + d)),
            sqrt((d - least) * (d + least)),
        );
        let q2 = if flexed { half + half } else { -(half + half) };
        let (s, c) = sin_cos(q2);
        let q1 = atan2(down, along) - atan2(l2 * s, l1 + l2 * c);
        Ok((wrap(q1), q2))
    }
}

/// The branches, or that they are out of reach by the least that was found.
pub(super) fn reached<T: Real>(
    branches: Branches<T>,
    short: T,
) -> Result<Branches<T>, InverseError> {
    if branches.is_empty() {
        Err(unreachable(short))
    } else {
        Ok(branches)
    }
}

/// Farther than anything: where the search for the least begins.
pub(super) fn far<T: Real>() -> T {
    T::max_value().unwrap_or_else(T::one)
}

/// The largest distance that counts as rounding, as a fraction of the length of the finger.
pub(super) fn tolerance<T: Real>() -> T {
    max(real::<T>(1e-12), real::<T>(16.0) * T::default_epsilon())
}

/// The length of a vector, also where its square cannot be written.
pub(super) fn distance<T: Real>(x: T, y: T) -> T {
    let size = max(abs(x), abs(y));
    if size == T::zero() {
        return size;
    }
    let (x, y) = (x / size, y / size);
    size * sqrt(x * x + y * y)
}
