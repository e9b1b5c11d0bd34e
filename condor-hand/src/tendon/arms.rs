use nalgebra::SVector;
use thiserror::Error;

use super::{Pair, TendonPairs};
use crate::decimal::Decimal;
use crate::math::{Real, is_finite};

/// The moment arms of the tendons of one finger: the matrix P of `torque = P tension`. The tendons of a joint can also
/// cross the joints proximal to it, but none that is distal.
///
/// Row j has the arms at joint j of the tendons of joint k, `k >= j`: metres, positive where the tendon pulls joint j
/// to positive angles. The matrix is block upper triangular. At its own joint a flexor has a positive arm, and an
/// extensor a negative one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MomentArms<T: Real, const N: usize> {
    rows: [TendonPairs<T, N>; N],
    /// The reciprocals for each joint's own tendons, so that the servo divides once and not in each tick.
    reciprocals: TendonPairs<T, N>,
}

/// The reason why no finger can have these arms.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum ArmError {
    /// The own tendons of a joint do not pull it to both sides.
    #[error(
        "the tendons of joint {joint} have arms {flexor} m and {extensor} m at it; \
         the flexor's must be positive and the extensor's negative",
        flexor = Decimal(*.flexor),
        extensor = Decimal(*.extensor),
    )]
    Own {
        /// The joint, from 0.
        joint: usize,
        /// The arm of its flexor, m.
        flexor: f64,
        /// The arm of its extensor, m.
        extensor: f64,
    },
    /// An arm is not finite, or a tendon crosses a joint distal to its own.
    #[error(
        "a tendon of joint {tendon} has the arm {arm} m at joint {joint}; it must be finite, and 0 \
         at joints distal to its own",
        arm = Decimal(*.arm),
    )]
    Crossing {
        /// The joint that the tendon belongs to, from 0.
        tendon: usize,
        /// The joint that it crosses, from 0.
        joint: usize,
        /// The arm, m.
        arm: f64,
    },
}

impl<T: Real, const N: usize> MomentArms<T, N> {
    /// Makes the matrix from its rows, m: `rows[j][k]` are the arms at joint j of the flexor and
    /// the extensor of joint k.
    ///
    /// # Errors
    /// [`ArmError`] for the first arm with which the matrix cannot be inverted by
    /// back-substitution.
    pub fn new(rows: [TendonPairs<T, N>; N]) -> Result<Self, ArmError> {
        let mut reciprocals = [Pair::both(T::zero()); N];
        for (joint, (row, reciprocal)) in rows.iter().zip(&mut reciprocals).enumerate() {
            for (tendon, pair) in row.iter().enumerate() {
                for arm in [pair.flexor, pair.extensor] {
                    if !is_finite(arm) || (tendon < joint && arm != T::zero()) {
                        let arm = arm.to_f64();
                        return Err(ArmError::Crossing { tendon, joint, arm });
                    }
                }
                if tendon == joint {
                    *reciprocal = pair.map(|arm| T::one() / arm);
                    // The reciprocal of a denormal arm overflows.
                    let invertible = is_finite(reciprocal.flexor) && is_finite(reciprocal.extensor);
                    let opposed = pair.flexor > T::zero() && pair.extensor < T::zero();
                    if !(invertible && opposed) {
                        return Err(ArmError::Own {
                            joint,
                            flexor: pair.flexor.to_f64(),
                            extensor: pair.extensor.to_f64(),
                        });
                    }
                }
            }
        }
        Ok(Self { rows, reciprocals })
    }

    /// Returns the rows of the matrix, m: `rows[j][k]` are the arms at joint j of the flexor and the extensor of joint
    /// k.
    #[inline(always)]
    #[must_use]
    pub fn rows(&self) -> &[TendonPairs<T, N>; N] {
        &self.rows
    }

    /// One over each joint's own arms, 1/m.
    #[inline(always)]
    pub(super) fn reciprocals(&self) -> &TendonPairs<T, N> {
        &self.reciprocals
    }

    /// Returns the joint torques that the tensions (N) of the tendons produce, N m: `P tensions`.
    #[inline(always)]
    #[must_use]
    pub fn torque(&self, tensions: &TendonPairs<T, N>) -> SVector<T, N> {
        let mut torques = SVector::<T, N>::zeros();
        let rows = self.rows.iter().enumerate();
        for (torque, (joint, row)) in torques.iter_mut().zip(rows) {
            for tendon in joint..N {
                let (arm, tension) = (&row[tendon], &tensions[tendon]);
                *torque += arm.flexor * tension.flexor + arm.extensor * tension.extensor;
            }
        }
        torques
    }

    /// Returns the rates at which the lengths of the tendons change while the joints move at `qd`
    /// (rad/s): `-Pᵀ qd`, m/s. A rate is negative for a tendon that shortens.
    #[inline(always)]
    #[must_use]
    pub fn length_rates(&self, qd: &SVector<T, N>) -> TendonPairs<T, N> {
        let mut rates = [Pair::both(T::zero()); N];
        for (joint, (row, &rate)) in self.rows.iter().zip(qd.iter()).enumerate() {
            for tendon in joint..N {
                let (length, arm) = (&mut rates[tendon], &row[tendon]);
                length.flexor -= arm.flexor * rate;
                length.extensor -= arm.extensor * rate;
            }
        }
        rates
    }
}
