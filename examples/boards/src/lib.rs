#![doc = include_str!("../README.md")]
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
