//! The search for joints that bring a tip nearer to a goal, downhill and within limits.

use nalgebra::{SMatrix, SVector, Vector3};

use super::{Jacobian, JointLimits, Kinematics, Side};
use crate::control::linear::Ldl;
use crate::math::{is_finite, max, min, sin_cos, sqrt};
use crate::pose::{Pose, rotation_vector};

/// The least damping, in squares of the size of the mechanism.
const LEAST: f64 = 1e-10;
/// Steps that bring a tip back to its target after a move along the null space.
pub(super) const CORRECTION: u32 = 4;
/// The move below which joints have settled, rad or m.
const SETTLED: f64 = 1e-6;

/// A pose that the tip of a mechanism must reach, and the measure of the distance from it.
pub(super) struct Goal<'a, M, const N: usize> {
    pub(super) mechanism: &'a M,
    pub(super) limits: &'a JointLimits<N>,
    pub(super) target: Pose,
    /// The size of the mechanism, which scales the damping, m.
    pub(super) size: f64,
    /// The distance that counts as much as a rotation by one rad, m; zero if any rotation will do.
    pub(super) length: f64,
    /// The largest change of a joint in one step, rad or m.
    pub(super) stride: f64,
    /// Errors of position (m) and rotation (rad) within which the search ends before its steps are used; negative
    /// for none.
    pub(super) enough: (f64, f64),
}

/// A posture, and the error of the tip there.
#[derive(Clone, Copy)]
pub(super) struct Place<const N: usize> {
    pub(super) q: SVector<f64, N>,
    /// From the tip to the target, m.
    pub(super) shift: Vector3<f64>,
    /// The rotation from the tip to the target, as axis times angle, rad; zero if it does not count.
    pub(super) turn: Vector3<f64>,
    pub(super) jacobian: Jacobian<N>,
}

impl<M: Kinematics<N>, const N: usize> Goal<'_, M, N> {
    pub(super) fn place(&self, q: &SVector<f64, N>) -> Place<N> {
        let (tip, jacobian) = self.mechanism.kinematics(q);
        Place {
            q: *q,
            shift: self.target.position - tip.position,
            turn: if self.length > 0.0 {
                rotation_vector(&(self.target.rotation * tip.rotation.transpose()))
            } else {
                Vector3::zeros()
            },
            jacobian,
        }
    }

    /// The square of the distance from the goal, m².
    pub(super) fn square(&self, place: &Place<N>) -> f64 {
        place.shift.norm_squared() + self.length * self.length * place.turn.norm_squared()
    }

    /// Returns true if the tip is as near to the goal as is enough.
    pub(super) fn is_reached(&self, place: &Place<N>) -> bool {
        let (position, rotation) = self.enough;
        sqrt(place.shift.norm_squared()) <= position && sqrt(place.turn.norm_squared()) <= rotation
    }

    /// Goes downhill from `q`, in at most `steps` steps; returns the place where it ends, and the steps that it took.
    ///
    /// Each step is one of Newton's on half the square of the distance, with `λ` added to the diagonal where that is
    /// needed to go downhill (Levenberg 1944). Joints that a limit holds are left out.
    pub(super) fn descend(&self, q: SVector<f64, N>, steps: u32) -> (Place<N>, u32) {
        let size = self.size;
        let least = size * size * LEAST;
        let mut damping = size * size * 1e-4;
        let mut place = self.place(&q);
        for step in 0..steps {
            if self.is_reached(&place) {
                return (place, step);
            }
            let held = self.held(&place);
            let (slope, mut curvature) = self.downhill(&place, &held);
            add_to_diagonal(&mut curvature, damping);
            let way = Ldl::new(&curvature).map(|factors| factors.solve(&slope));
            let longest = way.map_or(0.0, |way| way.amax());
            if way.is_some() && !(is_finite(longest) && longest > f64::EPSILON) {
                return (place, step);
            }
            if let Some(way) = way {
                let next = place.q + way * min(1.0, self.stride / longest);
                let next = self.place(&self.limits.clamp(&next));
                if self.square(&next) < self.square(&place) {
                    place = next;
                    damping = max(damping * 0.1, least);
                    continue;
                }
            }
            if damping > 1e3 * size * (size + sqrt(self.square(&place))) {
                // Rounding is all that is left.
                return (place, step);
            }
            damping *= 10.0;
        }
        (place, steps)
    }

    /// Moves the joints of a tip at its target towards a posture, in at most `steps` steps and as many corrections of
    /// [`CORRECTION`] steps; returns the place where the joints come nearest to the posture, and the steps that it took.
    ///
    /// The joints move along the null space of the Jacobian, and a descent brings the tip back to the target after each
    /// move (Rosen's projected gradient for nonlinear constraints, 1961). A move that does not come nearer is halved.
    pub(super) fn settle(
        &self,
        mut place: Place<N>,
        posture: &SVector<f64, N>,
        steps: u32,
    ) -> (Place<N>, u32) {
        let (mut share, mut taken) = (1.0, 0_u32);
        for _ in 0..steps {
            let pull = posture - place.q;
            let way = self.slide(&place, &pull).unwrap_or_else(SVector::zeros);
            taken = taken.saturating_add(1);
            let longest = way.amax();
            let is_moving = is_finite(longest) && longest * share > SETTLED;
            if !is_moving {
                break;
            }
            let next = place.q + way * min(share, self.stride / longest);
            let (next, more) = self.descend(self.limits.clamp(&next), CORRECTION);
            taken = taken.saturating_add(more);
            let nearer = (posture - next.q).norm_squared() < pull.norm_squared();
            if nearer && self.is_reached(&next) {
                place = next;
                share = min(share * 2.0, 1.0);
            } else {
                share *= 0.5;
            }
        }
        (place, taken)
    }

    /// The part of a motion `pull` of the joints that does not move the tip and presses no joint against a limit.
    ///
    /// The solution `s` of `(JᵀJ + λ) s = λ pull` is the projection on the null space of J, but for `λ` over the squares
    /// of singular values; so a direction in which the tip hardly moves counts as one of the null space (Nakamura and
    /// Hanafusa 1986).
    fn slide(&self, place: &Place<N>, pull: &SVector<f64, N>) -> Option<SVector<f64, N>> {
        let damping = self.size * self.size * LEAST;
        // Without the second derivatives by the error that is left, which may exceed the damping.
        let there = Place {
            shift: Vector3::zeros(),
            turn: Vector3::zeros(),
            ..*place
        };
        let mut holds = [None; N];
        for _ in 0..=N {
            let (_, mut curvature) = self.downhill(&there, &holds);
            add_to_diagonal(&mut curvature, damping);
            let mut right = pull * damping;
            for (entry, _) in right
                .iter_mut()
                .zip(&holds)
                .filter(|(_, held)| held.is_some())
            {
                *entry = 0.0;
            }
            let way = Ldl::new(&curvature)?.solve(&right);
            let mut is_free = true;
            for (held, blocked) in holds.iter_mut().zip(held(&place.q, &way, self.limits)) {
                if blocked.is_some() {
                    (*held, is_free) = (blocked, false);
                }
            }
            if is_free {
                return Some(way);
            }
        }
        None
    }

    /// The joints at limits beyond which they would move the tip nearer.
    pub(super) fn held(&self, place: &Place<N>) -> [Option<Side>; N] {
        let mut nearer = place.jacobian.fixed_rows::<3>(0).tr_mul(&place.shift);
        if self.length > 0.0 {
            let turning = place.jacobian.fixed_rows::<3>(3).tr_mul(&place.turn);
            nearer += turning * (self.length * self.length);
        }
        held(&place.q, &nearer, self.limits)
    }

    /// The derivative of half the square of the distance, downhill, and its second derivative, by the joints that
    /// are free.
    ///
    /// With the columns `v` and `w` of the linear and the angular Jacobian and the errors `e` of the position and `r` of
    /// the rotation, the second derivative by joints `i <= j` is `v_i · v_j - e · (w_i x v_j)` and, times the square of
    /// the length that counts as a rad, `c w_i · w_j + (1 - c) (a · w_i) (a · w_j) - r · (w_i x w_j) / 2`. There `a` is
    /// the axis of r, and `c = t / tan t` with half its angle t: the derivative of a rotation vector (Bullo and Murray,
    /// "Proportional derivative (PD) control on the Euclidean group", 1995).
    fn downhill(
        &self,
        place: &Place<N>,
        held: &[Option<Side>; N],
    ) -> (SVector<f64, N>, SMatrix<f64, N, N>) {
        let mut columns = [(Vector3::zeros(), Vector3::zeros()); N];
        let all = columns.iter_mut().zip(held).zip(&place.jacobian.data.0);
        for ((column, held), &[x, y, z, a, b, c]) in all {
            if held.is_none() {
                *column = (Vector3::new(x, y, z), Vector3::new(a, b, c));
            }
        }
        let weight = self.length * self.length;
        let turning = Turning::of(&place.turn);
        let mut slope = SVector::<f64, N>::zeros();
        let mut curvature = SMatrix::<f64, N, N>::zeros();
        for ((j, (linear, angular)), slope) in columns.iter().enumerate().zip(slope.iter_mut()) {
            *slope = linear.dot(&place.shift);
            if weight > 0.0 {
                *slope += weight * angular.dot(&place.turn);
            }
            for (i, (before, axis)) in columns.iter().enumerate().take(j + 1) {
                let mut entry = before.dot(linear) - place.shift.dot(&axis.cross(linear));
                if weight > 0.0 {
                    entry += weight * turning.curvature(axis, angular);
                }
                for at in [(i, j), (j, i)] {
                    if let Some(at) = curvature.get_mut(at) {
                        *at = entry;
                    }
                }
            }
        }
        (slope, curvature)
    }
}

/// A rotation that is left, prepared for the second derivatives of half the square of its angle.
struct Turning {
    /// Axis times angle, rad.
    turn: Vector3<f64>,
    axis: Vector3<f64>,
    /// Half the angle over its tangent.
    share: f64,
}

impl Turning {
    fn of(turn: &Vector3<f64>) -> Self {
        let angle = sqrt(turn.norm_squared());
        let (sine, cosine) = sin_cos(angle * 0.5);
        let is_turned = sine > 0.0;
        Self {
            turn: *turn,
            axis: if is_turned { turn / angle } else { *turn },
            share: if is_turned {
                angle * 0.5 * cosine / sine
            } else {
                1.0
            },
        }
    }

    fn curvature(&self, first: &Vector3<f64>, second: &Vector3<f64>) -> f64 {
        self.share * first.dot(second)
            + (1.0 - self.share) * self.axis.dot(first) * self.axis.dot(second)
            - 0.5 * self.turn.dot(&first.cross(second))
    }
}

fn add_to_diagonal<const N: usize>(matrix: &mut SMatrix<f64, N, N>, damping: f64) {
    for place in 0..N {
        if let Some(entry) = matrix.get_mut((place, place)) {
            *entry += damping;
        }
    }
}

/// The joints at limits beyond which `rates` would move them.
pub(super) fn held<const N: usize>(
    q: &SVector<f64, N>,
    rates: &SVector<f64, N>,
    limits: &JointLimits<N>,
) -> [Option<Side>; N] {
    let mut held = [None; N];
    let ranges = limits.lower().iter().zip(limits.upper().iter());
    for ((place, (&q, &rate)), (&lower, &upper)) in
        held.iter_mut().zip(q.iter().zip(rates.iter())).zip(ranges)
    {
        *place = if q <= lower && rate < 0.0 {
            Some(Side::Low)
        } else if q >= upper && rate > 0.0 {
            Some(Side::High)
        } else {
            None
        };
    }
    held
}
