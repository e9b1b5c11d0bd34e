use condor_hand::Real;
use condor_hand::math::real;
use condor_hand::tendon::{
    MomentArms, Rectification, TensionAllocation, TensionGains, TensionServos,
};
use nalgebra::SVector;

use crate::Shipped;
use crate::corpus::{Between, any};
use crate::digest::Digest;

/// Converts torques to tensions: within the range of the tendons, beyond it, and for values that are not
/// torques.
pub(crate) fn allocation(digest: &mut Digest, hand: &Shipped) -> Option<()> {
    tensions::<f64>(digest, hand)?;
    tensions::<f32>(digest, hand)
}

fn tensions<T: Real>(digest: &mut Digest, hand: &Shipped) -> Option<()> {
    let rows = *hand.fingers.first()?.moment_arms().ok()?.rows();
    let arms = MomentArms::<T, 4>::new(rows.map(|row| row.map(|pair| pair.map(real)))).ok()?;
    let mut between = Between::seeded(5);
    for rectification in [
        Rectification::Hard,
        Rectification::Mean {
            co_contraction_n: real(20.0),
        },
        Rectification::Smooth {
            softness_n: real(3.0),
        },
    ] {
        let allocation = [TensionAllocation {
            rectification,
            min_n: real(4.0),
            max_n: real(130.0),
        }; 4];
        let mut allocate = |torque: &SVector<T, 4>| {
            let allocated = arms.allocate(torque, &allocation);
            digest.pairs(&allocated.tensions);
            digest.numbers(&allocated.torque);
            digest.bits(u64::from(allocated.saturated));
            digest.bits(u64::from(allocated.not_finite));
            digest.pairs(&arms.length_rates(&allocated.torque));
        };
        for size in [0.05, 0.5, 5.0] {
            for _ in 0..40 {
                allocate(&between.vector(-size, size));
            }
        }
        for torque in any::<T>() {
            allocate(&SVector::repeat(torque));
            let mut one = between.vector::<T, 4>(-0.5, 0.5);
            if let Some(joint) = one.iter_mut().nth(1) {
                *joint = torque;
            }
            allocate(&one);
        }
    }
    Some(())
}

/// Converts tensions to commands.
pub(crate) fn servos(digest: &mut Digest, _: &Shipped) -> Option<()> {
    commands::<f64>(digest)?;
    commands::<f32>(digest)
}

fn commands<T: Real>(digest: &mut Digest) -> Option<()> {
    let mut between = Between::seeded(6);
    for (kt, ki, kd, kv) in [(1.0, 0.0, 0.0, 0.0), (0.5, 20.0, 0.001, 30.0)] {
        let gains = TensionGains {
            kt: real(kt),
            ki: real(ki),
            kd: real(kd),
            kv: real(kv),
        };
        let mut servos = TensionServos::new([gains], real(130.0), real(400.0)).ok()?;
        let mut update = |digest: &mut Digest, desired: T, measured: T, rate: T| {
            digest.numbers(&servos.update(&[desired], &[measured], &[rate]));
        };
        for hostile in any::<T>() {
            for _ in 0..10 {
                let (desired, measured) = (between.one(-5.0, 140.0), between.one(0.0, 200.0));
                let rate = between.one(-0.2, 0.2);
                update(digest, desired, measured, rate);
            }
            update(digest, hostile, T::one(), T::zero());
            update(digest, T::one(), hostile, T::zero());
            update(digest, T::one(), T::one(), hostile);
            update(digest, hostile, hostile, hostile);
        }
    }
    Some(())
}
