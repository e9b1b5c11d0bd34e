use nalgebra::SVector;

use crate::Subject;
use crate::math::{Real, clamp, is_finite, max, min, real, wrap};
use crate::number::{NumberError, Requirement, check, finite};

/// The lower and upper limits of the positions of N joints: rad, or m for a prismatic joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointLimits<T: Real, const N: usize> {
    lower: SVector<T, N>,
    upper: SVector<T, N>,
}

/// The joint that is farthest outside its limits, or nearest to them.
#[derive(Clone, Copy)]
pub(super) struct Tightest<T> {
    pub(super) joint: usize,
    pub(super) position: T,
    /// To the nearer limit; negative outside.
    pub(super) margin: T,
}

impl<T: Real, const N: usize> JointLimits<T, N> {
    /// Makes limits from the lowest and the highest position of each joint, rad (m for a prismatic
    /// joint).
    ///
    /// # Errors
    /// [`NumberError`] for the first joint whose lower limit is not below its upper one, or whose limits are not
    /// finite.
    pub fn new(lower: SVector<T, N>, upper: SVector<T, N>) -> Result<Self, NumberError> {
        for (joint, (&low, &high)) in lower.iter().zip(upper.iter()).enumerate() {
            let above = Requirement::Above(low.to_f64());
            finite("the lower limit, rad or m,", low)
                .and_then(|()| check("the upper limit, rad or m,", high, above))
                .map_err(|error| error.at(Subject::Joint(joint as u16)))?;
        }
        Ok(Self { lower, upper })
    }

    /// Returns the lowest position of each joint, rad (m for a prismatic joint).
    #[must_use]
    pub fn lower(&self) -> &SVector<T, N> {
        &self.lower
    }

    /// Returns the highest position of each joint, rad (m for a prismatic joint).
    #[must_use]
    pub fn upper(&self) -> &SVector<T, N> {
        &self.upper
    }

    /// Returns true if all positions in `q` are within their limits or at them.
    #[must_use]
    pub fn contains(&self, q: &SVector<T, N>) -> bool {
        self.margin(q) >= T::zero()
    }

    /// Returns the distance between a joint in `q` and its nearer limit, rad (m for a prismatic
    /// joint), for the joint that has the least such distance. The result is negative if a joint is
    /// outside of its limits or is a NaN.
    #[must_use]
    pub fn margin(&self, q: &SVector<T, N>) -> T {
        self.tightest(q, 0).margin
    }

    /// Returns `q` with each position moved to the nearest one within its limits; a NaN becomes the
    /// lower limit.
    #[must_use]
    pub fn clamp(&self, q: &SVector<T, N>) -> SVector<T, N> {
        q.zip_zip_map(&self.lower, &self.upper, clamp)
    }

    /// The tightest joint from `first` on.
    pub(super) fn tightest(&self, q: &SVector<T, N>, first: usize) -> Tightest<T> {
        let mut tightest = Tightest {
            joint: first,
            position: T::zero(),
            margin: T::max_value().unwrap_or_else(T::one),
        };
        let limits = self.lower.iter().zip(self.upper.iter());
        for (joint, (&q, (&lower, &upper))) in q.iter().zip(limits).enumerate().skip(first) {
            let margin = if is_finite(q) {
                min(q - lower, upper - q)
            } else {
                -T::max_value().unwrap_or_else(T::one)
            };
            if margin < tightest.margin {
                tightest = Tightest {
                    joint,
                    position: q,
                    margin,
                };
            }
        }
        tightest
    }

    /// Turns each angle by whole turns to where it is within its limits, if it is anywhere.
    pub(super) fn unwind(&self, q: &SVector<T, N>) -> SVector<T, N> {
        q.zip_zip_map(&self.lower, &self.upper, |q, lower, upper| {
            if lower <= q && q <= upper {
                return q;
            }
            let middle = lower + (upper - lower) * real::<T>(0.5);
            middle + wrap(q - middle)
        })
    }

    /// The distance by which rounding may exceed the limits, rad.
    pub(super) fn slack() -> T {
        max(real::<T>(1e-9), real::<T>(64.0) * T::default_epsilon())
    }
}
