//! From the torques of a finger to tensions that can only pull.
//!
//! The own two tendons of a joint turn it, and so do those of the joints distal to it. Going from
//! distal to proximal, the effect of the distal tendons is known. So each joint has one equation
//! for its own pair, `r₊ f₊ - r₋ f₋ = t`, and one freedom: how much the two tendons pull against
//! each other. With `f₊ = f_min + u / r₊` and `f₋ = f_min + v / r₋` the equation is
//! `u - v = t - f_min (r₊ - r₋)`, with u and v not below zero. [`Rectification`] chooses among the solutions.

use nalgebra::SVector;

use super::{MomentArms, Pair, TendonPairs};
use crate::math::{clamp, is_finite, max, min, sqrt};
use crate::number::{NumberError, Requirement, check, not_negative};

/// The rule for the co-contraction of the two tendons of a joint: how much the tendons pull against
/// each other.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Rectification {
    /// The co-contraction is the least possible: one of the two tensions is at its minimum. The
    /// total tension is the least possible if antagonists have opposite arms at each joint that
    /// they cross.
    Hard,
    /// The two tendons have this mean tension, or more if the torque needs it.
    Mean {
        /// The mean of the two tensions, N.
        co_contraction_n: f64,
    },
    /// The pull goes smoothly from one tendon to the other.
    ///
    /// Without torque the flexor pulls this much more than the minimum, and so does the extensor if
    /// its arm is the same. The more one of them pulls, the nearer the other is to its minimum:
    /// `u = (h + t) / 2` and `v = (h - t) / 2` with `h² = t² + 4 (r₊ softness)²`.
    Smooth {
        /// Half the width of the transition, as a tension, N.
        softness_n: f64,
    },
}

/// The rule by which the torque of one joint is converted into the tensions of its two tendons.
///
/// With any values, the tensions are within `min_n..=max_n`, where a minimum below zero counts as
/// zero, and a maximum below the minimum counts as the minimum.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct TensionAllocation {
    /// The co-contraction of the tendons.
    pub rectification: Rectification,
    /// The least tension, which keeps a tendon from slack, N.
    pub min_n: f64,
    /// The greatest tension of a tendon, N.
    pub max_n: f64,
}

impl TensionAllocation {
    /// Checks that the values are possible: finite, not negative, and the maximum not below the
    /// minimum.
    ///
    /// # Errors
    /// [`NumberError`] for the first value that is wrong.
    pub fn check(&self) -> Result<(), NumberError> {
        not_negative("the least tension, N,", self.min_n)?;
        let above = Requirement::AtLeast(self.min_n);
        check("the largest tension, N,", self.max_n, above)?;
        match self.rectification {
            Rectification::Hard => Ok(()),
            Rectification::Mean { co_contraction_n } => {
                not_negative("the co-contraction, N,", co_contraction_n)
            }
            Rectification::Smooth { softness_n } => not_negative("the softness, N,", softness_n),
        }
    }

    /// The two tensions where at least one would leave its limits, and the net torque that they
    /// make: that asked for if less co-contraction suffices for it, else the nearest.
    #[cold]
    fn at_limit(
        &self,
        u: f64,
        net: f64,
        own: &Pair<f64>,
        reciprocal: &Pair<f64>,
    ) -> (Pair<f64>, f64) {
        let (low, high) = self.limits();
        let span = high - low;
        let (least, most) = (own.extensor * span, own.flexor * span);
        let net = clamp(net, least, most);
        let u = clamp(u, max(net, 0.0), min(most, net - least));
        let pair = Pair {
            flexor: low + u * reciprocal.flexor,
            extensor: low - (u - net) * reciprocal.extensor,
        };
        // Undoes rounding beyond the limits.
        (pair.map(|tension| clamp(tension, low, high)), net)
    }

    /// The limits that are followed: in order, and not below zero, also if a field is NaN.
    #[inline(always)]
    fn limits(&self) -> (f64, f64) {
        let low = max(self.min_n, 0.0);
        (low, max(self.max_n, low))
    }
}

/// The result of [`MomentArms::allocate`]: the tensions for the requested torques of a finger, and
/// the torques that they really produce.
#[derive(Clone, Copy, Debug, PartialEq)]
#[must_use]
pub struct AllocatedTensions<const N: usize> {
    /// The tensions, N: each within the limits of its joint.
    pub tensions: TendonPairs<f64, N>,
    /// The torques of these tensions, N m; equal to the requested torques if no bit is set.
    pub torque: SVector<f64, N>,
    /// The joints, a bit each, whose torque is not the requested one because a tendon is at its
    /// greatest tension. The torques of proximal joints take the tensions of saturated joints into
    /// account.
    pub saturated: u32,
    /// The joints, a bit each, whose torque was not finite. If there is one, all tensions are at
    /// their minimum, and no bit of `saturated` is set.
    pub not_finite: u32,
}

impl<const N: usize> MomentArms<N> {
    /// Converts the joint torques of a finger (`torque`, N m) into tensions of its tendons.
    /// `allocation` has the rule for each joint.
    ///
    /// The tensions produce the torques up to rounding, unless a tendon would leave its limits. The
    /// torque of such a joint is the nearest possible one. The computation goes from the distal
    /// joint to the proximal one. A finger has at most 32 joints.
    pub fn allocate(
        &self,
        torque: &SVector<f64, N>,
        allocation: &[TensionAllocation; N],
    ) -> AllocatedTensions<N> {
        self.allocate_around(torque, allocation, &[None; N])
    }

    /// Converts joint torques into tensions like [`allocate`](Self::allocate), but joints for which
    /// `given` has tensions (N) get these. The torque of such a joint follows from its tensions;
    /// the torques of the joints proximal to it take that into account.
    ///
    /// Given tensions are limited to the range of their joint; a NaN becomes the minimum.
    #[allow(clippy::needless_range_loop, reason = "so it stays in registers")]
    pub fn allocate_around(
        &self,
        torque: &SVector<f64, N>,
        allocation: &[TensionAllocation; N],
        given: &[Option<Pair<f64>>; N],
    ) -> AllocatedTensions<N> {
        const { assert!(N <= 32, "a joint is a bit of 32") };
        let mut allocated = AllocatedTensions {
            tensions: [Pair::both(0.0); N],
            torque: *torque,
            saturated: 0,
            not_finite: 0,
        };
        let mut fixed = 0;
        let [mut net] = torque.data.0;
        for joint in 0..N {
            let (own, (low, _)) = (&self.rows()[joint][joint], allocation[joint].limits());
            net[joint] -= low * (own.flexor + own.extensor);
        }
        for joint in (0..N).rev() {
            let allocation = &allocation[joint];
            let (own, reciprocal) = (&self.rows()[joint][joint], &self.reciprocals()[joint]);
            let (low, high) = allocation.limits();
            let of_joint = net[joint];
            let pair = if let Some(pair) = given[joint] {
                fixed |= 1 << joint;
                pair.map(|tension| clamp(tension, low, high))
            } else {
                let u = allocation.rectification.agonist(of_joint, low, own);
                let mut pair = Pair {
                    flexor: low + u * reciprocal.flexor,
                    extensor: low - (u - of_joint) * reciprocal.extensor,
                };
                // A NaN is not.
                let inside = pair.flexor >= low
                    && pair.flexor <= high
                    && pair.extensor >= low
                    && pair.extensor <= high;
                if !inside {
                    let reached;
                    (pair, reached) = allocation.at_limit(u, of_joint, own, reciprocal);
                    allocated.saturated |= u32::from(reached != of_joint) << joint;
                    allocated.not_finite |= u32::from(!is_finite(of_joint)) << joint;
                }
                pair
            };
            allocated.tensions[joint] = pair;
            // The nearest joint has been known for the shortest time, so it is the last.
            for proximal in 0..joint {
                let arm = &self.rows()[proximal][joint];
                net[proximal] -= arm.flexor * pair.flexor + arm.extensor * pair.extensor;
            }
        }
        let joints = allocated.saturated | fixed;
        if allocated.not_finite != 0 {
            self.at_rest(&mut allocated, torque, allocation);
        } else if joints != 0 {
            self.reckon(&mut allocated, joints);
        }
        allocated
    }

    /// Says what torques some joints do have: the saturated ones, and those of given tensions.
    #[cold]
    fn reckon(&self, allocated: &mut AllocatedTensions<N>, joints: u32) {
        let made = self.torque(&allocated.tensions);
        for (joint, (torque, &made)) in allocated.torque.iter_mut().zip(&made).enumerate() {
            if joints & 1 << joint != 0 {
                *torque = made;
            }
        }
    }

    /// All tensions at their minimum, because a torque is not finite.
    #[cold]
    fn at_rest(
        &self,
        allocated: &mut AllocatedTensions<N>,
        torque: &SVector<f64, N>,
        allocation: &[TensionAllocation; N],
    ) {
        for (tension, allocation) in allocated.tensions.iter_mut().zip(allocation) {
            *tension = Pair::both(allocation.limits().0);
        }
        allocated.torque = self.torque(&allocated.tensions);
        allocated.saturated = 0;
        // A distal torque that is not finite must not be blamed on the joints that it loads.
        let named = torque
            .iter()
            .enumerate()
            .fold(0, |named, (joint, &torque)| {
                named | u32::from(!is_finite(torque)) << joint
            });
        if named != 0 {
            allocated.not_finite = named;
        }
    }
}

impl Rectification {
    /// The torque of the flexor beyond that of its minimum, for a net torque, N m; the caller applies the
    /// limits.
    #[inline(always)]
    fn agonist(&self, net: f64, low: f64, own: &Pair<f64>) -> f64 {
        match *self {
            Self::Hard => max(net, 0.0),
            Self::Mean { co_contraction_n } => {
                // u / r₊ + v / r₋ is the sum of both beyond the minimum.
                let sum = 2.0 * max(co_contraction_n - low, 0.0);
                own.flexor * (net - sum * own.extensor) / (own.flexor - own.extensor)
            }
            Self::Smooth { softness_n } => {
                let width = 2.0 * own.flexor * softness_n;
                0.5 * (sqrt(net * net + width * width) + net)
            }
        }
    }
}
