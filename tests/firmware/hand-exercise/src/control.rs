use condor_hand::control::{Derivative, LowPass};

use crate::Shipped;
use crate::corpus::{Between, any};
use crate::digest::Digest;

/// Filters signals with jumps, and values that are not numbers.
pub(crate) fn control(digest: &mut Digest, _: &Shipped) -> Option<()> {
    let hz = 400.0;
    let mut one_pole = LowPass::new([Some(20.0)], hz).ok()?;
    let mut derivative = Derivative::new([60.0], hz).ok()?;
    let mut between = Between::seeded(4);
    let mut update = |digest: &mut Digest, x: f64| {
        digest.numbers(&one_pole.update(&[x]));
        digest.numbers(&derivative.update(&[x]));
    };
    for x in any() {
        update(digest, x);
        for _ in 0..8 {
            update(digest, between.one(-2.0, 2.0));
        }
    }
    // Into the subnormal numbers, and to zero if that is where it ends.
    for _ in 0..4000 {
        update(digest, 0.0);
    }
    Some(())
}
