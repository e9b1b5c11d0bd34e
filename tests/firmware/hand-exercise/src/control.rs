use condor_hand::Real;
use condor_hand::control::{Derivative, LowPass};
use condor_hand::math::real;

use crate::Shipped;
use crate::corpus::{Between, any};
use crate::digest::Digest;

/// Filters signals with jumps, and values that are not numbers.
pub(crate) fn control(digest: &mut Digest, _: &Shipped) -> Option<()> {
    each::<f64>(digest)?;
    each::<f32>(digest)
}

fn each<T: Real>(digest: &mut Digest) -> Option<()> {
    let hz = real(400.0);
    let mut one_pole = LowPass::<T, 1>::new([Some(real(20.0))], hz).ok()?;
    let mut derivative = Derivative::<T, 1>::new([real(60.0)], hz).ok()?;
    let mut between = Between::seeded(4);
    let mut update = |digest: &mut Digest, x: T| {
        digest.numbers(&one_pole.update(&[x]));
        digest.numbers(&derivative.update(&[x]));
    };
    for x in any::<T>() {
        update(digest, x);
        for _ in 0..8 {
            update(digest, between.one(-2.0, 2.0));
        }
    }
    // Into the subnormal numbers, and to zero if that is where it ends.
    for _ in 0..4000 {
        update(digest, T::zero());
    }
    Some(())
}
