use nalgebra::SVector;

use super::{Pair, TendonPairs};
use crate::Subject;
use crate::math::is_finite;
use crate::number::{NumberError, Requirement, finite};
use crate::transmission::{Actuated, Arms, EffortLimits, Rows};

/// The tendons of one finger: their moment arms, the matrix P of `torque = P tension`, and the limits of their
/// tensions.
///
/// Row j has the arms at joint j of the tendons of joint k: metres, positive where the tendon pulls joint j to positive
/// angles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MomentArms<const N: usize> {
    rows: [TendonPairs<f64, N>; N],
    limits: [[EffortLimits; 2]; N],
    scaled: Rows<N>,
    columns: [[[f64; N]; 2]; N],
}

/// The tensions for the requested torques of a finger, and the torques that they produce.
#[derive(Clone, Copy, Debug, PartialEq)]
#[must_use]
pub struct AllocatedTensions<const N: usize> {
    /// The tensions, N: each within the limits of its tendon.
    pub tensions: TendonPairs<f64, N>,
    /// The torques of these tensions, N m; equal to the requested torques if no bit is set.
    pub torque: SVector<f64, N>,
    /// The joints, a bit each, whose torque is not the requested one because the limits of tensions do not permit it. The
    /// torques of the others are then those that were requested up to 1e-5 of the greatest tension times an arm.
    pub saturated: u32,
    /// The joints, a bit each, whose torque was not finite. If there is one, all tendons are at rest, and no bit of
    /// `saturated` is set.
    pub not_finite: u32,
    /// The steps of the search for the tensions; 0 if the nearest to the preferred ones are within their limits.
    pub steps: u32,
}

impl<const N: usize> MomentArms<N> {
    /// Makes the tendons of a finger from their arms, m, and their limits, N: `rows[j][k]` are the arms at joint j of the
    /// flexor and the extensor of joint k.
    ///
    /// # Errors
    /// [`NumberError`] for the first arm that is not finite, for limits that are not in order, and for a joint that no
    /// tendon can turn by itself.
    pub fn new(
        rows: [TendonPairs<f64, N>; N],
        limits: TendonPairs<EffortLimits, N>,
    ) -> Result<Self, NumberError> {
        const { assert!(N > 0 && N <= 32, "a joint is a bit of 32") };
        let mut columns = [[[0.0; N]; 2]; N];
        for (joint, row) in rows.iter().enumerate() {
            for (tendon, (pair, column)) in row.iter().zip(&mut columns).enumerate() {
                for (arm, column) in pair.lanes().into_iter().zip(column) {
                    finite("the arm, m,", arm).map_err(|error| {
                        error.at(Subject::Crossing {
                            tendon: tendon as u16,
                            joint: joint as u16,
                        })
                    })?;
                    column[joint] = arm;
                }
            }
        }
        for (joint, limits) in limits.iter().enumerate() {
            let joint = joint as u16;
            (limits.flexor.check()).map_err(|error| error.at(Subject::Flexor(joint)))?;
            (limits.extensor.check()).map_err(|error| error.at(Subject::Extensor(joint)))?;
        }
        let scaled = Rows::new(columns.as_flattened_mut()).map_err(|joint| NumberError {
            at: Subject::Joint(joint as u16),
            what: "the number of tendons that turn it by itself",
            value: 0.0,
            must: Requirement::AtLeast(1.0),
        })?;
        Ok(Self {
            rows,
            limits: limits.map(Pair::lanes),
            scaled,
            columns,
        })
    }

    /// Returns the rows of the matrix, m: `rows[j][k]` are the arms at joint j of the flexor and the extensor of joint
    /// k.
    #[inline(always)]
    #[must_use]
    pub const fn rows(&self) -> &[TendonPairs<f64, N>; N] {
        &self.rows
    }

    /// Returns the limits of the two tendons of each joint, N.
    #[must_use]
    pub fn limits(&self) -> TendonPairs<EffortLimits, N> {
        self.limits.map(Pair::of)
    }

    /// Returns the tensions of tendons from which nothing is asked, N.
    #[must_use]
    pub fn at_rest(&self) -> TendonPairs<f64, N> {
        self.limits
            .map(|limits| Pair::of(limits.map(|limits| limits.at_rest())))
    }

    /// Returns the joint torques that the tensions (N) of the tendons produce, N m: `P tensions`.
    #[inline(always)]
    #[must_use]
    pub fn torque(&self, tensions: &TendonPairs<f64, N>) -> SVector<f64, N> {
        let mut torques = SVector::<f64, N>::zeros();
        for (torque, row) in torques.iter_mut().zip(&self.rows) {
            for (arm, tension) in row.iter().zip(tensions) {
                *torque += arm.flexor * tension.flexor + arm.extensor * tension.extensor;
            }
        }
        torques
    }

    /// Returns the least and the greatest torque that the tendons can give a joint, whatever torques the other joints
    /// have then, N m. It is 0 to 0 for a joint that the finger does not have.
    #[must_use]
    pub fn torque_range(&self, joint: usize) -> (f64, f64) {
        let (mut low, mut high) = (0.0, 0.0);
        for (arms, limits) in self.rows.get(joint).into_iter().flatten().zip(&self.limits) {
            for (arm, limits) in arms.lanes().into_iter().zip(limits) {
                let ends = (arm * limits.low, arm * limits.high);
                low += crate::math::min(ends.0, ends.1);
                high += crate::math::max(ends.0, ends.1);
            }
        }
        (low, high)
    }

    /// Returns the rates at which the lengths of the tendons change while the joints move at `qd`
    /// (rad/s): `-Pᵀ qd`, m/s. A rate is negative for a tendon that shortens.
    #[inline(always)]
    #[must_use]
    pub fn length_rates(&self, qd: &SVector<f64, N>) -> TendonPairs<f64, N> {
        let mut rates = [Pair::both(0.0); N];
        for (row, &rate) in self.rows.iter().zip(qd.iter()) {
            for (length, arm) in rates.iter_mut().zip(row) {
                length.flexor -= arm.flexor * rate;
                length.extensor -= arm.extensor * rate;
            }
        }
        rates
    }

    /// Converts the torques of the joints (N m) into tensions. Of all tensions within their limits that produce the
    /// torques these are nearest to the preferred ones, in the sense of least squares.
    ///
    /// If no tensions produce the torques, each torque is limited to its [range](Self::torque_range), and the sum of the
    /// squares of what is missing then is the least, where the torque of each joint is divided by the length of its row
    /// of arms. Joints that share tendons share what is missing.
    pub fn allocate(&self, torque: &SVector<f64, N>) -> AllocatedTensions<N> {
        self.allocate_around(torque, &[None; N])
    }

    /// Converts joint torques into tensions like [`allocate`](Self::allocate), but joints for which
    /// `given` has tensions (N) get these. The torque of such a joint is what it comes to.
    ///
    /// Given tensions are limited to the range of their tendon; a NaN becomes the minimum.
    pub fn allocate_around(
        &self,
        torque: &SVector<f64, N>,
        given: &[Option<Pair<f64>>; N],
    ) -> AllocatedTensions<N> {
        let [torques] = &torque.data.0;
        let (mut asked, mut not_finite) = (0, 0);
        for (joint, (torque, given)) in torques.iter().zip(given).enumerate() {
            asked |= u32::from(given.is_none()) << joint;
            not_finite |= u32::from(!is_finite(*torque)) << joint;
        }
        if not_finite != 0 {
            let tensions = self.at_rest();
            return AllocatedTensions {
                tensions,
                torque: self.torque(&tensions),
                saturated: 0,
                not_finite,
                steps: 0,
            };
        }
        let mut limits = self.limits;
        for (limits, given) in limits.iter_mut().zip(given) {
            if let Some(given) = given {
                for (limits, tension) in limits.iter_mut().zip(given.lanes()) {
                    *limits = EffortLimits::fixed(limits.clamp(tension));
                }
            }
        }
        let mut actuated = [[Actuated::default(); 2]; N];
        let arms = Arms {
            columns: self.columns.as_flattened(),
            limits: limits.as_flattened(),
            rows: &self.scaled,
        };
        let choice = arms.choose(torques, asked, actuated.as_flattened_mut());
        let tensions = actuated.map(|pair| Pair::of(pair.map(|tendon| tendon.effort)));
        let made = self.torque(&tensions);
        let mut torque = *torque;
        for (joint, (torque, &made)) in torque.iter_mut().zip(&made).enumerate() {
            if choice.saturated != 0 || asked >> joint & 1 == 0 {
                *torque = made;
            }
        }
        AllocatedTensions {
            tensions,
            torque,
            saturated: choice.saturated,
            not_finite: 0,
            steps: choice.steps,
        }
    }
}
