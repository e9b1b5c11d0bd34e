//! [`Silent`]: a bus without boards.

use condor_dev::{AccessError, Bus, BusErrorKind, Width};

/// A bus on which nothing answers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Silent;

impl Bus for Silent {
    type Error = AccessError;

    fn read(&self, address: usize, _: Width) -> Result<u32, AccessError> {
        let kind = BusErrorKind::NoAnswer;
        Err(AccessError { address, kind })
    }

    fn write(&self, address: usize, width: Width, _: u32) -> Result<(), AccessError> {
        self.read(address, width).map(drop)
    }
}
