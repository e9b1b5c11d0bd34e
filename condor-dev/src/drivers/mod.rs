//! The drivers that ship.

mod adc;

pub use adc::Adc16;
