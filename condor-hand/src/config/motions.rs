//! Motions of a hand as text.

use std::format;
use std::vec::Vec;

use super::{Finger, Hand, TextError};
use crate::trajectory::motion::{MotionFinger, load_with};
use crate::trajectory::{Primitive, ProfileLimits};

impl<const FINGERS: usize, const JOINTS: usize, const ACTUATORS: usize>
    Hand<FINGERS, JOINTS, ACTUATORS>
{
    /// Reads a sequence of motions of the hand from TOML [text](crate::trajectory::motion). The text calls joints
    /// `FINGER.JOINT`, and may take the tip of a finger along lines and arcs, within the limits at which its joints can
    /// rest.
    ///
    /// `file` is the name to show in error messages; no file is opened. The limits of joints that a step names are not
    /// checked here, but when a motion is enqueued. Motions have room for J joints: first those of finger 0.
    ///
    /// # Errors
    /// [`TextError`] for the first mistake, with its place and the remedy. A path that no joints take the tip along, or
    /// not in the time that the text says, is a mistake, too.
    pub fn motions<const J: usize>(
        &self,
        text: &str,
        file: &str,
    ) -> Result<Vec<Primitive<J>>, TextError> {
        let mut names = Vec::new();
        let mut fingers = Vec::new();
        let mut limits = self.trajectory_limits();
        for finger in &self.fingers {
            let first = names.len();
            let own = finger.joints.iter();
            names.extend(own.map(|joint| format!("{}.{}", finger.name, joint.name)));
            fingers.push(MotionFinger {
                name: finger.name.as_str().into(),
                joints: first..names.len(),
                chain: finger.chain(),
                limits: resting(finger, &mut limits),
            });
        }
        load_with(text, file, &names, &fingers)
    }
}

/// The limits of a finger's joints, with the ranges in which they can rest. Places without a joint have any that are
/// possible.
fn resting<const JOINTS: usize, const ACTUATORS: usize>(
    finger: &Finger<JOINTS, ACTUATORS>,
    limits: &mut impl Iterator<Item = ProfileLimits>,
) -> [ProfileLimits; JOINTS] {
    let mut resting = [ProfileLimits {
        low: -1.0,
        high: 1.0,
        velocity: 1.0,
        acceleration: 1.0,
        jerk: 1.0,
    }; JOINTS];
    for ((place, joint), own) in resting.iter_mut().zip(&finger.joints).zip(limits) {
        let (low, high) = joint.rest_range();
        *place = ProfileLimits { low, high, ..own };
    }
    resting
}
