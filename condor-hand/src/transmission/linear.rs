use nalgebra::SVector;

use super::EffortLimits;
use super::search::{Actuated, Arms, Rows};
use crate::Subject;
use crate::math::{abs, is_finite, max, min};
use crate::number::{NumberError, Requirement, finite};

/// A transmission whose arms are the same in every posture: the matrix P of `torque = P effort`, and the limits of the
/// efforts.
///
/// ```
/// use condor_hand::transmission::{EffortLimits, Linear};
///
/// // A differential: two motors turn a joint together, and another one against each other.
/// let motor = EffortLimits { low: -2.0, high: 2.0, bias: 0.0 }; // N m
/// let wrist = Linear::new([[1.0, 1.0], [1.0, -1.0]], [motor; 2])?;
/// let efforts = wrist.efforts(&[1.5, 0.5].into());
/// assert_eq!((efforts.effort, efforts.saturated), ([1.0, 0.5], 0));
/// # Ok::<_, condor_hand::NumberError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Linear<const N: usize, const A: usize> {
    arms: [[f64; N]; A],
    limits: [EffortLimits; A],
    /// The arms, each row of the matrix divided by its length.
    scaled: [[f64; N]; A],
    rows: Rows<N>,
    /// The number of actuators without those at the end that have no arms.
    actuators: usize,
}

/// The efforts for the torques of N joints, and the torques that they produce.
#[derive(Clone, Copy, Debug, PartialEq)]
#[must_use]
pub struct Efforts<const N: usize, const A: usize> {
    /// The efforts, N or N m: each within the limits of its actuator.
    pub effort: [f64; A],
    /// The torques of these efforts, N m, or N for a sliding joint; equal to the requested torques if no bit is set.
    pub torque: SVector<f64, N>,
    /// The joints, a bit each, whose torque is not the requested one because the limits of efforts do not permit it. The
    /// torques of the others are then those that were requested up to 1e-5 of the greatest effort times an arm.
    pub saturated: u32,
    /// The joints, a bit each, whose torque was not finite. If there is one, all actuators are at rest, and no bit of
    /// `saturated` is set.
    pub not_finite: u32,
    /// The steps of the search for the efforts; 0 if the nearest to the preferred ones are within their limits.
    pub steps: u32,
}

impl<const N: usize, const A: usize> Linear<N, A> {
    /// Makes a transmission from the arms of each actuator at the joints, and the limits of its effort (N, or N m):
    /// `arms[a][j]` is the torque of joint j (N m, or N for a sliding joint) for a unit of the effort of actuator a.
    ///
    /// A joint at which no actuator has an arm has no torque.
    ///
    /// # Errors
    /// [`NumberError`] for the first arm that is not finite, for limits that are not in order, and for a joint whose
    /// torque depends on those of the joints after it.
    pub fn new(arms: [[f64; N]; A], limits: [EffortLimits; A]) -> Result<Self, NumberError> {
        const { assert!(N > 0 && N <= 32, "a joint is a bit of 32") };
        for (actuator, (column, limits)) in arms.iter().zip(&limits).enumerate() {
            let actuator = actuator as u16;
            for (joint, &arm) in column.iter().enumerate() {
                let joint = joint as u16;
                finite("the arm", arm)
                    .map_err(|error| error.at(Subject::Arm { actuator, joint }))?;
            }
            (limits.check()).map_err(|error| error.at(Subject::Actuator(actuator)))?;
        }
        let mut scaled = arms;
        let rows = Rows::new(&mut scaled).map_err(|joint| NumberError {
            at: Subject::Joint(joint as u16),
            what: "the number of actuators that move it without the joints after it",
            value: 0.0,
            must: Requirement::AtLeast(1.0),
        })?;
        let moves = |column: &[f64; N]| column.iter().any(|&arm| arm != 0.0);
        Ok(Self {
            arms,
            limits,
            scaled,
            rows,
            actuators: arms.iter().rposition(moves).map_or(0, |last| last + 1),
        })
    }

    /// Returns the arms of each actuator at the joints, as [`new`](Self::new) takes them.
    #[inline(always)]
    #[must_use]
    pub const fn arms(&self) -> &[[f64; N]; A] {
        &self.arms
    }

    /// Returns the limits of the efforts, N or N m.
    #[inline(always)]
    #[must_use]
    pub const fn limits(&self) -> &[EffortLimits; A] {
        &self.limits
    }

    /// Returns the efforts of actuators from which nothing is asked, N or N m.
    #[must_use]
    pub fn at_rest(&self) -> [f64; A] {
        self.limits.map(|limits| limits.at_rest())
    }

    /// Returns the joint to which an actuator belongs: the last one at which it has an arm. `None` if it has none, or
    /// if there is no such actuator.
    #[inline(always)]
    #[must_use]
    pub fn joint_of(&self, actuator: usize) -> Option<usize> {
        self.arms.get(actuator)?.iter().rposition(|&arm| arm != 0.0)
    }

    /// Returns the greatest effort of the actuators of each joint, to either side, N or N m: of those that belong to it, or
    /// of all that move it if none does. An effort that is not finite counts as the greatest.
    #[must_use]
    pub fn greatest_efforts(&self, effort: &[f64; A]) -> [f64; N] {
        let mut greatest = [0.0; N];
        let mut has_own = [false; N];
        for actuator in 0..A {
            if let Some(has_own) = self
                .joint_of(actuator)
                .and_then(|joint| has_own.get_mut(joint))
            {
                *has_own = true;
            }
        }
        for (actuator, (arms, &effort)) in self.arms.iter().zip(effort).enumerate() {
            let own = self.joint_of(actuator);
            let joints = greatest.iter_mut().zip(arms).zip(&has_own);
            for (joint, ((greatest, &arm), &has_own)) in joints.enumerate() {
                let counts = own == Some(joint) || !has_own && arm != 0.0;
                let is_more = abs(effort) > *greatest || !is_finite(effort);
                if counts && is_more && is_finite(*greatest) {
                    *greatest = abs(effort);
                }
            }
        }
        greatest
    }

    /// Returns the torques of the joints that efforts (N, or N m) produce, N m, or N for a sliding joint: `P effort`.
    #[inline(always)]
    #[must_use]
    pub fn torque(&self, effort: &[f64; A]) -> SVector<f64, N> {
        let mut torques = [0.0; N];
        for (column, effort) in self.arms.iter().zip(effort).take(self.actuators) {
            for (torque, arm) in torques.iter_mut().zip(column) {
                *torque += arm * effort;
            }
        }
        torques.into()
    }

    /// Returns the least and the greatest torque that the actuators can give a joint, whatever torques the other joints
    /// have then, N m, or N for a sliding joint. It is 0 to 0 for a joint that nothing moves.
    #[must_use]
    pub fn torque_range(&self, joint: usize) -> (f64, f64) {
        let (mut low, mut high) = (0.0, 0.0);
        for (column, limits) in self.arms.iter().zip(&self.limits) {
            let arm = column.get(joint).copied().unwrap_or(0.0);
            let ends = (arm * limits.low, arm * limits.high);
            low += min(ends.0, ends.1);
            high += max(ends.0, ends.1);
        }
        (low, high)
    }

    /// Returns the positions or rates of the actuators by those of the joints: `Pᵀ joints`. A tendon that its actuator
    /// draws in has a positive rate, m/s; a motor turns in its own direction, rad/s.
    #[inline(always)]
    #[must_use]
    pub fn actuators(&self, joints: &SVector<f64, N>) -> [f64; A] {
        let [joints] = &joints.data.0;
        let mut actuators = [0.0; A];
        let places = actuators.iter_mut().zip(&self.arms);
        for (actuator, column) in places.take(self.actuators) {
            let of_joints = column.iter().zip(joints);
            *actuator = of_joints.fold(0.0, |sum, (arm, joint)| sum + arm * joint);
        }
        actuators
    }

    /// Returns the efforts for torques of the joints (N m, or N for a sliding joint). Of all efforts within the limits
    /// that produce the torques these are nearest to the preferred ones, in the sense of least squares.
    ///
    /// If no efforts produce the torques, each torque is limited to its [range](Self::torque_range), and the sum of the
    /// squares of what is missing then is the least, where the torque of each joint is divided by the length of its row
    /// of arms. Joints that share actuators share what is missing.
    pub fn efforts(&self, torque: &SVector<f64, N>) -> Efforts<N, A> {
        self.efforts_within(torque, u32::MAX, &self.limits)
    }

    /// Returns efforts like [`efforts`](Self::efforts), but for the torques of the `joints` of this bit mask alone, and
    /// with other limits (N, or N m), which must be in order. The torques of all other joints are what they come to. An
    /// actuator with a [fixed](EffortLimits::fixed) effort has that.
    pub fn efforts_within(
        &self,
        torque: &SVector<f64, N>,
        joints: u32,
        limits: &[EffortLimits; A],
    ) -> Efforts<N, A> {
        let [asked] = &torque.data.0;
        let mut not_finite = 0;
        for (joint, torque) in asked.iter().enumerate() {
            not_finite |= u32::from(!is_finite(*torque)) << joint;
        }
        not_finite &= joints;
        if not_finite != 0 {
            let effort = limits.map(|limits| limits.at_rest());
            return Efforts {
                effort,
                torque: self.torque(&effort),
                saturated: 0,
                not_finite,
                steps: 0,
            };
        }
        // Actuators without arms have what they prefer.
        let mut actuated = limits.map(Actuated::preferred);
        let arms = Arms {
            columns: self.scaled.get(..self.actuators).unwrap_or(&self.scaled),
            limits,
            rows: &self.rows,
        };
        let moving = actuated.get_mut(..self.actuators).unwrap_or_default();
        let choice = arms.choose(asked, joints, moving);
        let effort = actuated.map(|actuator| actuator.effort);
        let mut torque = *torque;
        let made = self.torque(&effort);
        for (joint, (torque, &made)) in torque.iter_mut().zip(&made).enumerate() {
            if choice.saturated != 0 || joints >> joint & 1 == 0 {
                *torque = made;
            }
        }
        Efforts {
            effort,
            torque,
            saturated: choice.saturated,
            not_finite: 0,
            steps: choice.steps,
        }
    }
}
