use nalgebra::SVector;

use super::{Pair, TendonPairs};
use crate::Subject;
use crate::number::{NumberError, Requirement, check, finite};

/// The moment arms of the tendons of one finger: the matrix P of `torque = P tension`. The tendons of a joint can also
/// cross the joints proximal to it, but none that is distal.
///
/// Row j has the arms at joint j of the tendons of joint k, `k >= j`: metres, positive where the tendon pulls joint j
/// to positive angles. The matrix is block upper triangular. At its own joint a flexor has a positive arm, and an
/// extensor a negative one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MomentArms<const N: usize> {
    rows: [TendonPairs<f64, N>; N],
    /// The reciprocals for each joint's own tendons, so that the servo divides once and not in each tick.
    reciprocals: TendonPairs<f64, N>,
}

impl<const N: usize> MomentArms<N> {
    /// Makes the matrix from its rows, m: `rows[j][k]` are the arms at joint j of the flexor and
    /// the extensor of joint k.
    ///
    /// # Errors
    /// [`NumberError`] for the first arm with which the matrix cannot be inverted by back-substitution: one that is
    /// not finite, one of a tendon at a joint distal to its own that is not 0, or one at its own joint that is
    /// not positive for a flexor, or not negative for an extensor.
    pub fn new(rows: [TendonPairs<f64, N>; N]) -> Result<Self, NumberError> {
        let mut reciprocals = [Pair::both(0.0); N];
        for (joint, (row, reciprocal)) in rows.iter().zip(&mut reciprocals).enumerate() {
            for (tendon, pair) in row.iter().enumerate() {
                let must = if tendon < joint {
                    Requirement::Equal(0.0)
                } else {
                    Requirement::Finite
                };
                for arm in [pair.flexor, pair.extensor] {
                    check("the arm, m,", arm, must).map_err(|error| {
                        error.at(Subject::Crossing {
                            tendon: tendon as u16,
                            joint: joint as u16,
                        })
                    })?;
                }
                if tendon == joint {
                    *reciprocal = pair.map(|arm| 1.0 / arm);
                    let own = "the arm at its own joint, m,";
                    // The reciprocal of a denormal arm overflows.
                    let invertible = "one over the arm at its own joint, 1/m,";
                    check(own, pair.flexor, Requirement::Above(0.0))
                        .and_then(|()| finite(invertible, reciprocal.flexor))
                        .map_err(|error| error.at(Subject::Flexor(joint as u16)))?;
                    check(own, pair.extensor, Requirement::Below(0.0))
                        .and_then(|()| finite(invertible, reciprocal.extensor))
                        .map_err(|error| error.at(Subject::Extensor(joint as u16)))?;
                }
            }
        }
        Ok(Self { rows, reciprocals })
    }

    /// Returns the rows of the matrix, m: `rows[j][k]` are the arms at joint j of the flexor and the extensor of joint
    /// k.
    #[inline(always)]
    #[must_use]
    pub fn rows(&self) -> &[TendonPairs<f64, N>; N] {
        &self.rows
    }

    /// One over each joint's own arms, 1/m.
    #[inline(always)]
    pub(super) fn reciprocals(&self) -> &TendonPairs<f64, N> {
        &self.reciprocals
    }

    /// Returns the joint torques that the tensions (N) of the tendons produce, N m: `P tensions`.
    #[inline(always)]
    #[must_use]
    pub fn torque(&self, tensions: &TendonPairs<f64, N>) -> SVector<f64, N> {
        let mut torques = SVector::<f64, N>::zeros();
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
    pub fn length_rates(&self, qd: &SVector<f64, N>) -> TendonPairs<f64, N> {
        let mut rates = [Pair::both(0.0); N];
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
