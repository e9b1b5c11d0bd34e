use nalgebra::SVector;

use super::Linear;
use super::search::Rows;
use crate::Subject;
use crate::math::abs;
use crate::number::{NumberError, Requirement};

/// The positions of joints by those that sensors at joints and at actuators measure.
///
/// A joint with a sensor of its own is where that sensor says. The others are where the sensors at the actuators say, by
/// least squares if there are more of them than joints.
///
/// ```
/// use condor_hand::transmission::{EffortLimits, Linear};
///
/// // A differential: two motors turn a joint together, and another one against each other.
/// let motor = EffortLimits { low: -2.0, high: 2.0, bias: 0.0 }; // N m
/// let wrist = Linear::new([[10.0, 10.0], [10.0, -10.0]], [motor; 2])?;
/// let sensing = wrist.position_sensing(&[false; 2], &[true; 2]).unwrap();
/// let joints = sensing.positions(&[0.0; 2].into(), &[4.0, 1.0]); // rad
/// assert!((joints[0] - 0.25).abs() < 1e-12 && (joints[1] - 0.15).abs() < 1e-12);
/// # Ok::<_, condor_hand::NumberError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionSensing<const N: usize, const A: usize> {
    /// The part of each measured joint, and of each actuator, in the position of each joint.
    by_joints: [[f64; N]; N],
    by_actuators: [[f64; A]; N],
}

impl<const N: usize, const A: usize> Linear<N, A> {
    /// Returns how to compute the positions of all joints if these joints and these actuators have sensors of their
    /// positions. A joint that nothing moves and nothing measures is at 0.
    ///
    /// # Errors
    /// [`NumberError`] for the first joint whose position these sensors do not tell.
    pub fn position_sensing(
        &self,
        joints: &[bool; N],
        actuators: &[bool; A],
    ) -> Result<PositionSensing<N, A>, NumberError> {
        let untold = |joint: usize| NumberError {
            at: Subject::Joint(joint as u16),
            what: "the number of sensors that tell its position",
            value: 0.0,
            must: Requirement::AtLeast(1.0),
        };
        let mut scaled = [[0.0; N]; A];
        let mut is_told = *joints;
        let columns = scaled.iter_mut().zip(self.arms()).zip(actuators);
        for ((column, arms), _) in columns.filter(|(_, is_sensed)| **is_sensed) {
            let parts = column
                .iter_mut()
                .zip(arms)
                .zip(joints.iter().zip(&mut is_told));
            for ((part, arm), (_, is_told)) in parts.filter(|(_, (is_sensed, _))| !**is_sensed) {
                *part = *arm;
                *is_told |= *arm != 0.0;
            }
        }
        for (joint, is_told) in is_told.into_iter().enumerate() {
            let moves = |arms: &[f64; N]| arms.get(joint).is_some_and(|arm| *arm != 0.0);
            if !is_told && self.arms().iter().any(moves) {
                return Err(untold(joint));
            }
        }
        let rows = Rows::new(&mut scaled).map_err(untold)?;
        let by_actuators = rows.positions(&scaled);
        let mut by_joints = [[0.0; N]; N];
        for (joint, (row, parts)) in by_joints.iter_mut().zip(&by_actuators).enumerate() {
            for (other, (entry, is_sensed)) in row.iter_mut().zip(joints).enumerate() {
                if joint == other {
                    *entry = f64::from(u8::from(*is_sensed));
                } else if *is_sensed {
                    let arms = self.arms().iter().map(|arms| arms.get(other).copied());
                    for (part, arm) in parts.iter().zip(arms) {
                        *entry -= part * arm.unwrap_or(0.0);
                    }
                }
            }
        }
        Ok(PositionSensing {
            by_joints,
            by_actuators,
        })
    }
}

impl<const N: usize, const A: usize> PositionSensing<N, A> {
    /// Returns the positions of all joints (rad, or m for a sliding joint) by the measured ones of joints and actuators,
    /// rad or m. Those without a sensor may have any number. A position is NaN if one on which it depends is.
    #[must_use]
    pub fn positions(&self, joints: &SVector<f64, N>, actuators: &[f64; A]) -> SVector<f64, N> {
        let [joints] = &joints.data.0;
        self.sums(|part, value| part * value, joints, actuators)
    }

    /// Returns how much the positions of joints change at most, rad or m, if each measured position changes by so much to
    /// either side, rad or m.
    #[must_use]
    pub fn resolutions(&self, joints: &[f64; N], actuators: &[f64; A]) -> SVector<f64, N> {
        self.sums(|part, value| abs(part * value), joints, actuators)
    }

    /// Returns the part of the position of an actuator in that of a joint; 0 if the joint does not depend on it.
    pub(crate) fn part(&self, joint: usize, actuator: usize) -> f64 {
        let parts = self.by_actuators.get(joint);
        parts
            .and_then(|parts| parts.get(actuator).copied())
            .unwrap_or(0.0)
    }

    /// The sums over what each joint depends on.
    fn sums(
        &self,
        product: impl Fn(f64, f64) -> f64,
        joints: &[f64; N],
        actuators: &[f64; A],
    ) -> SVector<f64, N> {
        let mut sums = [0.0; N];
        let rows = self.by_joints.iter().zip(&self.by_actuators);
        for (sum, (by_joints, by_actuators)) in sums.iter_mut().zip(rows) {
            let joints = by_joints.iter().zip(joints);
            for (part, value) in joints.chain(by_actuators.iter().zip(actuators)) {
                // A reading that is not a number spoils only what depends on it.
                if *part != 0.0 {
                    *sum += product(*part, *value);
                }
            }
        }
        sums.into()
    }
}
