use condor_hand::math;

use crate::Shipped;
use crate::corpus::{FINITE, any};
use crate::digest::Digest;

/// Computes every function of `math`.
pub(crate) fn functions(digest: &mut Digest, _: &Shipped) -> Option<()> {
    for x in FINITE {
        let (sine, cosine) = math::sin_cos(x);
        digest.numbers(&[sine, cosine]);
        for function in [math::sqrt, math::exp, math::tanh, math::round, math::abs] {
            digest.number(function(x));
        }
        for y in FINITE {
            digest.numbers(&[math::atan2(x, y), math::min(x, y), math::max(x, y)]);
        }
    }
    for x in any() {
        for (low, high) in [
            (-1.0, 1.0),
            (0.0, 0.0),
            (-0.0, 0.0),
            (0.0, -0.0),
            (2.0, 1.0),
        ] {
            digest.number(math::clamp(x, low, high));
        }
        digest.bits(u64::from(math::is_finite(x)));
    }
    Some(())
}
