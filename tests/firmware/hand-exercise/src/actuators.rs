use condor_hand::servo::{EffortGains, EffortServos};
use condor_hand::transmission::{EffortLimits, Linear};
use nalgebra::SVector;

use crate::Shipped;
use crate::corpus::{Between, any};
use crate::digest::Digest;

/// Converts torques to efforts: within the limits of the actuators, beyond them, and for values that are not
/// torques.
pub(crate) fn allocation(digest: &mut Digest, hand: &Shipped) -> Option<()> {
    let arms = *hand.fingers.first()?.transmission().ok()?.arms();
    let mut between = Between::seeded(5);
    for bias in [4.0, 7.0, 20.0] {
        let limits = EffortLimits {
            low: 4.0,
            high: 130.0,
            bias,
        };
        let linear = Linear::new(arms, [limits; 8]).ok()?;
        let mut allocate = |torque: &SVector<f64, 4>| {
            let allocated = linear.efforts(torque);
            digest.numbers(&allocated.effort);
            digest.numbers(&allocated.torque);
            digest.bits(u64::from(allocated.saturated));
            digest.bits(u64::from(allocated.not_finite));
            digest.numbers(&linear.actuators(&allocated.torque));
        };
        for size in [0.05, 0.5, 5.0] {
            for _ in 0..40 {
                allocate(&between.vector(-size, size));
            }
        }
        for torque in any() {
            allocate(&SVector::repeat(torque));
            let mut one = between.vector::<4>(-0.5, 0.5);
            if let Some(joint) = one.iter_mut().nth(1) {
                *joint = torque;
            }
            allocate(&one);
        }
    }
    Some(())
}

/// Converts efforts to commands.
pub(crate) fn servos(digest: &mut Digest, _: &Shipped) -> Option<()> {
    let mut between = Between::seeded(6);
    let limits = EffortLimits {
        low: 4.0,
        high: 130.0,
        bias: 7.0,
    };
    for (kp, ki, kd, kv) in [(1.0, 0.0, 0.0, 0.0), (0.5, 20.0, 0.001, 30.0)] {
        let gains = EffortGains { kp, ki, kd, kv };
        let mut servos = EffortServos::new([gains], &[limits], 400.0).ok()?;
        let mut update = |digest: &mut Digest, desired: f64, measured: f64, rate: f64| {
            digest.numbers(&servos.update(&[desired], &[measured], &[rate]));
        };
        for hostile in any() {
            for _ in 0..10 {
                let (desired, measured) = (between.one(-5.0, 140.0), between.one(0.0, 200.0));
                let rate = between.one(-0.2, 0.2);
                update(digest, desired, measured, rate);
            }
            update(digest, hostile, 1.0, 0.0);
            update(digest, 1.0, hostile, 0.0);
            update(digest, 1.0, 1.0, hostile);
            update(digest, hostile, hostile, hostile);
        }
    }
    Some(())
}
