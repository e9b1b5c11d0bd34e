//! Filters, servo laws and small linear algebra that need no hand.
//!
//! Everything runs at one sample rate, allocates nothing, and keeps values that are not finite out
//! of its state.

pub(crate) mod bank;
mod filter;
mod limit;
pub mod linear;
mod pid;

pub use filter::{Biquad, Derivative, OnePole};
pub use limit::{MotionLimiter, RateLimiter};
pub use pid::{Integrator, Pid, PidGains, PidLimits};
