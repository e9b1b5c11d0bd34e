//! What the trajectories promise, and what `SciPy` and Ruckig say about them.

#![allow(
    clippy::disallowed_methods,
    reason = "what is expected may differ in its last bits from one host to another"
)]
#![allow(
    clippy::float_cmp,
    reason = "ends are met to the last bit, and rest is zero"
)]
#![allow(clippy::similar_names, reason = "a hand can be hard")]

mod any_motion;
mod cartesian;
mod feed;
mod generator;
mod image;
mod interpolator;
mod profiles;
mod reference;
mod stopped;
mod stream;
#[cfg(feature = "text")]
mod text;
#[cfg(feature = "text")]
mod tip;
