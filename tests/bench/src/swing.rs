//! A motion for ticks of the hand: all joints swing about the middle of their ranges.

use std::array;
use std::f64::consts::TAU;

use condor_hand::config::{Hand, MotionLimits};
use condor_hand::trajectory::SetPoint;

const JOINTS: usize = 4;
/// Ticks after which the motion begins anew.
pub(crate) const TICKS: usize = 512;
/// Cutoffs of all filters, Hz.
const CUTOFF_HZ: f64 = 100.0;

/// Has every sensor filtered.
pub(crate) fn filter_all<const F: usize>(hand: &mut Hand<F, JOINTS>) {
    for joint in hand
        .fingers
        .iter_mut()
        .flat_map(|finger| &mut finger.joints)
    {
        joint.servo.position_cutoff_hz = Some(CUTOFF_HZ);
        joint.flexor.cutoff_hz = Some(CUTOFF_HZ);
        joint.extensor.cutoff_hz = Some(CUTOFF_HZ);
    }
}

/// Returns the positions of the joints in each tick, and their velocities and accelerations, when joints
/// with these limits swing by `swing` of their ranges to either side of the middle.
pub(crate) fn motion<const F: usize>(
    limits: &[MotionLimits<JOINTS>; F],
    swing: f64,
    servo_hz: f64,
) -> Vec<[[SetPoint<f64>; JOINTS]; F]> {
    (0..TICKS)
        .map(|tick| {
            array::from_fn(|finger| {
                array::from_fn(|joint| {
                    let (low, high) = (limits[finger].low[joint], limits[finger].high[joint]);
                    // Whole swings in all ticks.
                    let swings = (1 + (finger + joint) % 3) as f64;
                    let angle = TAU * (swings * tick as f64 / TICKS as f64 + 0.1 * joint as f64);
                    let rate = TAU * swings * servo_hz / TICKS as f64;
                    let size = swing * (high - low);
                    SetPoint {
                        position: f64::midpoint(low, high) + size * angle.sin(),
                        velocity: size * rate * angle.cos(),
                        acceleration: -size * rate * rate * angle.sin(),
                    }
                })
            })
        })
        .collect()
}
