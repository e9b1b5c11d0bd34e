//! [`Silent`]: a bus without boards.

use condor_dev::{Bus, BusErrorKind, MmioError};

/// A bus on which nothing answers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Silent;

const fn silence<T>(address: usize) -> Result<T, MmioError> {
    Err(MmioError {
        address,
        kind: BusErrorKind::NoAnswer,
    })
}

impl Bus for Silent {
    type Error = MmioError;

    fn read8(&self, address: usize) -> Result<u8, MmioError> {
        silence(address)
    }

    fn read16(&self, address: usize) -> Result<u16, MmioError> {
        silence(address)
    }

    fn read32(&self, address: usize) -> Result<u32, MmioError> {
        silence(address)
    }

    fn write8(&self, address: usize, _: u8) -> Result<(), MmioError> {
        silence(address)
    }

    fn write16(&self, address: usize, _: u16) -> Result<(), MmioError> {
        silence(address)
    }

    fn write32(&self, address: usize, _: u32) -> Result<(), MmioError> {
        silence(address)
    }
}
