//! The boards as models of their registers, for a [`condor_dev::sim::SimBus`].

mod adc;
mod dac;
mod encoder;
mod mpp;

pub use adc::AdcModel;
pub use dac::DacModel;
pub use encoder::EncoderModel;
pub use mpp::MppModel;
