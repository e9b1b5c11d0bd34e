//! The hand that all contestants have, and the states in which they see it.

use condor_hand::config;
use condor_hand::kinematics::PlanarFinger;
use fastrand::Rng;
use nalgebra::{SVector, Vector3};

use crate::Result;

pub(super) const FINGERS: usize = 4;
pub(super) const JOINTS: usize = 4;
pub(super) const ACTUATORS: usize = 8;

/// States that calls go through in turn, so that no branch is foretold by the last call.
pub(super) const STATES: usize = 64;

/// m/s².
pub(super) const GRAVITY: Vector3<f64> = Vector3::new(0.0, 0.0, -9.80665);

const TEXT: &str = include_str!("../../../../condor-hand/hands/utah-mit.toml");

/// A number for each joint of the hand, finger by finger.
pub(super) type Joints = [SVector<f64, JOINTS>; FINGERS];

/// A state of the hand, and what makes it go on.
#[derive(Clone, Copy, Debug)]
pub(super) struct State {
    /// Positions, rad.
    pub(super) q: Joints,
    /// Rates, rad/s.
    pub(super) qd: Joints,
    /// Accelerations, rad/s².
    pub(super) qdd: Joints,
    /// Torques, N m.
    pub(super) torque: Joints,
}

/// The shipped hand.
pub(super) struct Subject {
    /// The configuration of the hand.
    pub(super) config: config::Hand<FINGERS, JOINTS, ACTUATORS>,
    /// Its fingers in closed form.
    pub(super) planar: [PlanarFinger; FINGERS],
    /// The states in which the hand is computed.
    pub(super) states: [State; STATES],
}

impl Subject {
    /// Makes the shipped hand with states all over its range.
    ///
    /// # Errors
    /// Returns an error if its configuration has mistakes.
    pub(super) fn new() -> Result<Self> {
        let config = config::Hand::<FINGERS, JOINTS, ACTUATORS>::from_toml(TEXT, "utah-mit.toml")
            .map_err(|error| format!("{error}"))?;
        let planar = config
            .fingers
            .iter()
            .map(|finger| finger.planar().ok_or("a finger has another form"))
            .collect::<std::result::Result<Vec<_>, _>>()?;
        let planar: [PlanarFinger; FINGERS] = planar
            .try_into()
            .map_err(|_| "the hand has another number of fingers")?;
        let limits: Vec<_> = config.fingers.iter().map(config::Finger::limits).collect();
        let mut chance = Rng::with_seed(7);
        let states = std::array::from_fn(|_| {
            let mut each = |size: f64| -> Joints {
                std::array::from_fn(|_| SVector::from_fn(|_, _| size * (2.0 * chance.f64() - 1.0)))
            };
            let (qd, qdd, torque) = (each(3.0), each(50.0), each(0.2));
            let q = std::array::from_fn(|finger| {
                let limits = &limits[finger];
                limits
                    .low
                    .zip_map(&limits.high, |low, high| low + (high - low) * chance.f64())
            });
            State { q, qd, qdd, torque }
        });
        Ok(Self {
            config,
            planar,
            states,
        })
    }

    /// Returns the state of a call.
    #[inline]
    pub(super) fn state(&self, call: usize) -> &State {
        &self.states[call % STATES]
    }
}

/// Returns all joints of the hand in one list.
pub(super) fn flat(joints: &Joints) -> [f64; FINGERS * JOINTS] {
    std::array::from_fn(|index| joints[index / JOINTS][index % JOINTS])
}

/// Returns the distance of two results, relative to the largest number in them.
///
/// # Errors
/// Returns an error if the distance exceeds `limit`, or if the lengths differ.
pub(super) fn agree(what: &str, ours: &[f64], theirs: &[f64], limit: f64) -> Result<()> {
    if ours.len() != theirs.len() {
        return Err(format!("{what}: {} numbers, not {}", theirs.len(), ours.len()).into());
    }
    let largest = ours
        .iter()
        .fold(0.0, |most: f64, value| most.max(value.abs()));
    let apart = ours.iter().zip(theirs).fold(0.0, |most: f64, (a, b)| {
        let apart = (a - b).abs() / largest;
        // A NaN is the largest of all.
        if apart <= most { most } else { apart }
    });
    if apart <= limit {
        Ok(())
    } else {
        Err(format!("{what} is another: {apart:e} of the largest number, not {limit:e}").into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_numbers_do_not_agree() {
        assert!(agree("x", &[1.0, 2.0], &[1.0, 2.0 + 1e-13], 1e-12).is_ok());
        assert!(agree("x", &[1.0, 2.0], &[1.0, 2.1], 1e-12).is_err());
        assert!(agree("x", &[1.0, 2.0], &[1.0, f64::NAN], 1e-12).is_err());
        assert!(agree("x", &[1.0, 2.0], &[1.0], 1e-12).is_err());
    }
}
