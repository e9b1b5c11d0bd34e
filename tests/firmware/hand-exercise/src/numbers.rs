use condor_hand::Real;
use condor_hand::math;

use crate::Shipped;
use crate::corpus::{FINITE, any};
use crate::digest::Digest;

/// Computes every function of `math`.
pub(crate) fn functions(digest: &mut Digest, _: &Shipped) -> Option<()> {
    each::<f64>(digest);
    each::<f32>(digest);
    Some(())
}

fn each<T: Real>(digest: &mut Digest) {
    for x in FINITE.map(math::real::<T>) {
        let (sine, cosine) = math::sin_cos(x);
        digest.numbers(&[sine, cosine]);
        for function in [math::sqrt, math::exp, math::tanh, math::round, math::abs] {
            digest.number(function(x));
        }
        for y in FINITE.map(math::real::<T>) {
            digest.numbers(&[math::atan2(x, y), math::min(x, y), math::max(x, y)]);
        }
    }
    for x in any::<T>() {
        for (low, high) in [
            (-1.0, 1.0),
            (0.0, 0.0),
            (-0.0, 0.0),
            (0.0, -0.0),
            (2.0, 1.0),
        ] {
            digest.number(math::clamp(x, math::real(low), math::real(high)));
        }
        digest.bits(u64::from(math::is_finite(x)));
    }
}
