use condor_hand::Real;
use condor_hand::control::{
    Biquad, Derivative, MotionLimiter, OnePole, Pid, PidGains, PidLimits, RateLimiter,
};
use condor_hand::math::real;

use crate::Shipped;
use crate::corpus::{Between, any};
use crate::digest::Digest;

/// Filters, limiters and a controller, on signals with jumps and with what is no number.
pub(crate) fn control(digest: &mut Digest, _: &Shipped) -> Option<()> {
    each::<f64>(digest)?;
    each::<f32>(digest)
}

fn each<T: Real>(digest: &mut Digest) -> Option<()> {
    let hz = real(400.0);
    let mut one_pole = OnePole::<T>::low_pass(real(20.0), hz).ok()?;
    let mut biquad = Biquad::<T>::low_pass(real(37.0), hz).ok()?;
    let mut derivative = Derivative::<T>::new(real(60.0), hz).ok()?;
    let mut rate_limiter = RateLimiter::<T>::new(real(3.0), hz).ok()?;
    let mut motion_limiter = MotionLimiter::<T>::new(real(3.0), real(50.0), hz).ok()?;
    let gains = PidGains {
        kp: real(2.0),
        ki: real(5.0),
        kd: real(0.01),
    };
    let limits = PidLimits {
        output: (real(-4.0), real(3.0)),
        integral: real(1.0),
    };
    let mut pid = Pid::<T>::new(gains, limits, hz).ok()?;
    let mut between = Between::seeded(4);
    let mut update = |digest: &mut Digest, x: T| {
        digest.number(one_pole.update(x));
        digest.number(biquad.update(x));
        digest.number(derivative.update(x));
        digest.number(rate_limiter.update(x));
        digest.number(motion_limiter.update(x));
        digest.number(pid.update(x, x));
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
