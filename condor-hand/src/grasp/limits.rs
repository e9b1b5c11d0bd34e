use nalgebra::SVector;

use crate::Subject;
use crate::math::{abs, max};
use crate::number::{NumberError, Requirement};

/// The torques that the joints of one finger can exert, from `low` to `high`, N m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TorqueLimits<const N: usize> {
    /// The least, not above zero.
    pub low: SVector<f64, N>,
    /// The greatest, not below zero.
    pub high: SVector<f64, N>,
}

/// The report that a joint would need a torque beyond its limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TorqueExcess {
    /// The finger, from 0.
    pub finger: usize,
    /// The joint, from 0.
    pub joint: usize,
    /// The required torque, N m.
    pub torque: f64,
    /// The limit, N m.
    pub limit: f64,
}

impl<const N: usize> TorqueLimits<N> {
    /// Returns infinite limits, with which every torque is permitted.
    #[must_use]
    pub fn none() -> Self {
        let infinity = f64::INFINITY;
        Self {
            low: SVector::repeat(-infinity),
            high: SVector::repeat(infinity),
        }
    }

    /// Makes limits from `-limits` to `limits`, N m, for each joint.
    #[must_use]
    pub fn symmetric(limits: &SVector<f64, N>) -> Self {
        Self {
            low: -limits,
            high: *limits,
        }
    }

    /// The limit that a torque is beyond, and by how much, N m.
    fn exceeded(&self, joint: usize, torque: f64) -> Option<(f64, f64)> {
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

pub(super) fn check_limits<const M: usize, const N: usize>(
    limits: &[TorqueLimits<N>; M],
) -> Result<(), NumberError> {
    for (finger, limits) in limits.iter().enumerate() {
        for (joint, (&low, &high)) in limits.low.iter().zip(limits.high.iter()).enumerate() {
            // An infinite limit is none.
            let (what, value, must) = match (low <= 0.0, high >= 0.0) {
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
                value,
                must,
            });
        }
    }
    Ok(())
}

/// The part of a squeeze that the joints can bear beside the torques of a load.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fit {
    /// The part of the squeeze, 0 to 1.
    pub(super) share: f64,
    /// The joint that allows no more, with its torque at the whole squeeze.
    pub(super) squeeze_limit: Option<TorqueExcess>,
    /// The joint that is farthest beyond its limit even so.
    pub(super) overload: Option<TorqueExcess>,
}

/// The greatest part of the squeeze that pushes no joint beyond its limit. The load is left whole.
pub(super) fn fit<const M: usize, const N: usize>(
    load: &[SVector<f64, N>; M],
    squeeze: &[SVector<f64, N>; M],
    limits: &[TorqueLimits<N>; M],
) -> Fit {
    let mut fit = Fit {
        share: 1.0,
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
            if outward <= 0.0 {
                continue;
            }
            let share = max((limit - load) / squeeze, 0.0);
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
    let mut worst = 0.0;
    for (finger, ((load, squeeze), limits)) in fingers() {
        for (joint, (&load, &squeeze)) in load.iter().zip(squeeze.iter()).enumerate() {
            let torque = load + squeeze * fit.share;
            if let Some((limit, excess)) = limits.exceeded(joint, torque) {
                // The share was made to meet one limit: what is beyond it by rounding is at it.
                let rounding = max(abs(load), abs(limit)) * f64::EPSILON;
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
