//! What the trajectories promise, and what SciPy and Ruckig say about them.

mod generator;
mod interpolator;
mod profiles;
mod reference;
#[cfg(feature = "text")]
mod text;
