//! Between A actuators and N joints: torques and positions of joints, efforts and positions of actuators.
//!
//! An actuator has an arm at each joint that it moves: the torque of the joint for a unit of its effort. A motor that
//! drives a joint has its gear ratio there, or 1; a tendon has its moment arm, m, and its effort is its tension.
//! Tendons that cross joints, differentials and coupled drives have arms at several joints. By the same arms an
//! actuator moves when joints move, since no power is lost.
//!
//! [`Linear`] has arms that are the same in every posture. [`Transmission`] is for others.

mod linear;
mod search;
mod sensing;

pub use linear::{Efforts, Linear};
pub use sensing::PositionSensing;

use nalgebra::SVector;

use crate::math::{clamp, max, min};
use crate::number::{NumberError, Requirement, check, finite};

/// The transmission between A actuators and N joints.
pub trait Transmission<const N: usize, const A: usize> {
    /// Tells the transmission the positions of the joints, rad, or m for a sliding joint. A servo calls it once in each
    /// tick, before anything else. A transmission whose arms do not depend on the posture has nothing to do.
    #[inline(always)]
    fn set_position(&mut self, position: &SVector<f64, N>) {
        let _ = position;
    }

    /// Returns false if the arms are the same in every posture, so that a servo need not ask again for the torques that
    /// they permit.
    #[inline(always)]
    fn changes(&self) -> bool {
        true
    }

    /// Returns the arms at the present positions. The limits must always be the same. An actuator belongs to the last
    /// [joint](Linear::joint_of) at which it has an arm in the beginning.
    fn linear(&self) -> &Linear<N, A>;
}

impl<const N: usize, const A: usize> Transmission<N, A> for Linear<N, A> {
    #[inline(always)]
    fn changes(&self) -> bool {
        false
    }

    #[inline(always)]
    fn linear(&self) -> &Self {
        self
    }
}

/// The limits of an actuator's effort, and the effort that is preferred: N for an actuator that pulls or slides, N m for
/// one that turns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EffortLimits {
    /// The least effort; zero or more for an actuator that can only pull.
    pub low: f64,
    /// The greatest effort.
    pub high: f64,
    /// The preferred effort, such as the tension of an idle tendon. Of all efforts that give the torques the nearest to
    /// the preferred ones are used.
    pub bias: f64,
}

impl EffortLimits {
    /// Checks that the limits are in order, with the preferred effort between them.
    ///
    /// # Errors
    /// [`NumberError`] for the first number that is not possible.
    pub fn check(&self) -> Result<(), NumberError> {
        finite("the least effort", self.low)?;
        let above = Requirement::AtLeast(self.low);
        check("the greatest effort", self.high, above)?;
        let within = Requirement::Within(self.low, self.high);
        check("the preferred effort", self.bias, within)
    }

    /// Returns the effort of an actuator from which nothing is asked: the one nearest to zero.
    #[inline(always)]
    #[must_use]
    pub fn at_rest(&self) -> f64 {
        self.clamp(0.0)
    }

    /// Returns the least and the greatest command of the actuator. A servo may command any effort between zero and the
    /// limits, such as less than the least tension of a tendon that is too tight.
    #[inline(always)]
    #[must_use]
    pub fn command_range(&self) -> (f64, f64) {
        (min(self.low, 0.0), max(self.high, 0.0))
    }

    /// Returns `effort` within the limits; the least effort for a NaN.
    #[inline(always)]
    #[must_use]
    pub fn clamp(&self, effort: f64) -> f64 {
        clamp(effort, self.low, self.high)
    }

    /// Returns limits between which there is only this effort.
    #[inline(always)]
    #[must_use]
    pub const fn fixed(effort: f64) -> Self {
        Self {
            low: effort,
            high: effort,
            bias: effort,
        }
    }
}
