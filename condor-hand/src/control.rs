//! Filters, an integral and small linear algebra that need no hand.
//!
//! Everything runs at one sample rate, allocates nothing, and keeps values that are not finite out
//! of its state.

pub(crate) mod elapsed;
mod filter;
mod integrator;
pub mod linear;

pub use filter::{Derivative, LowPass};
pub use integrator::Integrator;
