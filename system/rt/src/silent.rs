//! [`Silent`]: a bus without boards.

use condor_dev::{Bus, BusAccessError, BusErrorKind, Width};

/// A bus without boards: each read and each write fails with [`BusErrorKind::NoAnswer`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Silent;

impl Bus for Silent {
    type Error = BusAccessError;

    fn read(&self, address: usize, _: Width) -> Result<u32, BusAccessError> {
        let kind = BusErrorKind::NoAnswer;
        Err(BusAccessError { address, kind })
    }

    fn write(&self, address: usize, width: Width, _: u32) -> Result<(), BusAccessError> {
        self.read(address, width).map(drop)
    }
}
