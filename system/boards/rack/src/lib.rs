#![doc = include_str!("../README.md")]
// Loom's atomics cannot be made in constants, as drivers are.
#![cfg(not(condor_loom))]
#![cfg_attr(not(any(feature = "sim", feature = "linux", test)), no_std)]

mod adc;
mod dac;
mod encoder;
mod mpp;
// The boards as a robot has them.
#[cfg(feature = "robot")]
pub mod robot;
#[cfg(feature = "sim")]
pub mod sim;

// Functions that tests and fuzz targets call with arbitrary bytes.
#[cfg(feature = "hostile")]
#[doc(hidden)]
pub mod hostile;

pub use adc::{Adc16, ConversionTrigger};
pub use dac::Dac16;
pub use encoder::Encoder8;
pub use mpp::Mpp;

use condor_dev::{Bus, Registers, Width};

/// Whether the first register of 16 bits, which all of these boards have, reads as this.
fn identifies_as<B: Bus>(registers: Registers<'_, B>, identification: u16) -> bool {
    registers.answers(0, Width::Bits16)
        && registers
            .read16(0)
            .is_ok_and(|found| found == identification)
}
