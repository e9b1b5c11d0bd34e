//! The drivers that ship, each with the table of its registers; `sim` has their models.

mod adc;
mod dac;
mod encoder;
mod mpp;
mod register;
mod uart16550;

#[cfg(all(test, feature = "sim"))]
mod interrupted_tests;

pub use adc::{Adc16, Trigger};
pub use dac::Dac16;
pub use encoder::Encoder8;
pub use mpp::Mpp;
pub use uart16550::{Format, LineErrors, Uart16550};
