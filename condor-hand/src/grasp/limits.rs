use nalgebra::SVector;

use crate::Subject;
use crate::math::{Real, abs, max};
use crate::number::{NumberError, Requirement};

/// The torques that the joints of one finger can exert, from `low` to `high`, N m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TorqueLimits<T: Real, const N: usize> {
    /// The least, not above zero.
    pub low: SVector<T, N>,
    /// The greatest, not below zero.
    pub high: SVector<T, N>,
}

/// The report that a joint would need a torque beyond its limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TorqueExcess<T: Real = f64> {
    /// The finger, from 0.
    pub finger: usize,
    /// The joint, from 0.
    pub joint: usize,
    /// The required torque, N m.
    pub torque: T,
    /// The limit, N m.
    pub limit: T,
}

impl<T: Real, const N: usize> TorqueLimits<T, N> {
    /// Returns infinite limits, with which every torque is permitted.
    #[must_use]
    pub fn none() -> Self {
        let infinity = T::one() / T::zero();
        Self {
            low: SVector::repeat(-infinity),
            high: SVector::repeat(infinity),
        }
    }

    /// Makes limits from `-limits` to `limits`, N m, for each joint.
    #[must_use]
    pub fn symmetric(limits: &SVector<T, N>) -> Self {
        Self {
            low: -limits,
            high: *limits,
        }
    }

    /// The limit that a torque is beyond, and by how much, N m.
    fn exceeded(&self, joint: usize, torque: T) -> Option<(T, T)> {
        let (&low, &high) = self.low.get(joint).zip(self.high.get(joint))?;
        if torque > high {
            Some((high, torque - high))
        } else if torque < low {
            Some((low, low - torque))
        } else {
            None
        }
    }
}

pub(super) fn check_limits<T: Real, const M: usize, const N: usize>(
    limits: &[TorqueLimits<T, N>; M],
) -> Result<(), NumberError> {
    for (finger, limits) in limits.iter().enumerate() {
        for (joint, (&low, &high)) in limits.low.iter().zip(limits.high.iter()).enumerate() {
            // An infinite limit is none.
            let (what, value, must) = match (low <= T::zero(), high >= T::zero()) {
                (true, true) => continue,
                (false, _) => {
                    let what = "the lower limit of the torque, N m,";
                    (what, low, Requirement::AtMost(0.0))
                }
                (true, false) => {
                    let what = "the upper limit of the torque, N m,";
                    (what, high, Requirement::AtLeast(0.0))
                }
            };
            let (finger, joint) = (finger as u16, joint as u16);
            return Err(NumberError {
                at: Subject::FingerJoint { finger, joint },
                what,
                value: value.to_f64(),
                must,
            });
        }
    }
    Ok(())
}

/// The part of a squeeze that the joints can bear beside the torques of a load.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fit<T: Real> {
    /// The part of the squeeze, 0 to 1.
    pub(super) share: T,
    /// The joint that allows no more, with its torque at the whole squeeze.
    pub(super) squeeze_limit: Option<TorqueExcess<T>>,
    /// The joint that is farthest beyond its limit even so.
    pub(super) overload: Option<TorqueExcess<T>>,
}

/// The greatest part of the squeeze that pushes no joint beyond its limit. The load is left whole.
pub(super) fn fit<T: Real, const M: usize, const N: usize>(
    load: &[SVector<T, N>; M],
    squeeze: &[SVector<T, N>; M],
    limits: &[TorqueLimits<T, N>; M],
) -> Fit<T> {
    let mut fit = Fit {
        share: T::one(),
        squeeze_limit: None,
        overload: None,
    };
    let fingers = || load.iter().zip(squeeze).zip(limits).enumerate();
    for (finger, ((load, squeeze), limits)) in fingers() {
        for (joint, (&load, &squeeze)) in load.iter().zip(squeeze.iter()).enumerate() {
            let torque = load + squeeze;
            let Some((limit, _)) = limits.exceeded(joint, torque) else {
                continue;
            };
            // A squeeze that relieves the joint is not what exceeds its limit.
            let outward = if torque > limit { squeeze } else { -squeeze };
            if outward <= T::zero() {
                continue;
            }
            let share = max((limit - load) / squeeze, T::zero());
            if share < fit.share {
                fit.share = share;
                fit.squeeze_limit = Some(TorqueExcess {
                    finger,
                    joint,
                    torque,
                    limit,
                });
            }
        }
    }
    let mut worst = T::zero();
    for (finger, ((load, squeeze), limits)) in fingers() {
        for (joint, (&load, &squeeze)) in load.iter().zip(squeeze.iter()).enumerate() {
            let torque = load + squeeze * fit.share;
            if let Some((limit, excess)) = limits.exceeded(joint, torque) {
                // The share was made to meet one limit: what is beyond it by rounding is at it.
                let rounding = max(abs(load), abs(limit)) * T::default_epsilon();
                if excess > worst && excess > rounding + rounding {
                    worst = excess;
                    fit.overload = Some(TorqueExcess {
                        finger,
                        joint,
                        torque,
                        limit,
                    });
                }
            }
        }
    }
    fit
}
