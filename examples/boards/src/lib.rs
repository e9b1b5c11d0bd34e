#![doc = include_str!("../README.md")]
// Loom's atomics cannot be made in constants, as drivers are.
#![cfg(not(condor_loom))]
#![cfg_attr(not(feature = "sim"), no_std)]

mod adc;
mod dac;
mod encoder;
mod mpp;
#[cfg(feature = "sim")]
pub mod sim;

pub use adc::{Adc16, Trigger};
pub use dac::Dac16;
pub use encoder::Encoder8;
pub use mpp::Mpp;
