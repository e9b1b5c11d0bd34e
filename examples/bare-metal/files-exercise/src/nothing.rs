//! [`Nothing`]: a bus at which no board answers. Terminals and files are behind none.

use condor_dev::{Bus, BusError, BusErrorKind};

#[derive(Clone, Copy)]
pub(crate) struct Nothing;

/// What every access meets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Silence;

impl BusError for Silence {
    fn kind(&self) -> BusErrorKind {
        BusErrorKind::NoAnswer
    }
}

impl Bus for Nothing {
    type Error = Silence;

    fn read8(&self, _: usize) -> Result<u8, Silence> {
        Err(Silence)
    }

    fn read16(&self, _: usize) -> Result<u16, Silence> {
        Err(Silence)
    }

    fn read32(&self, _: usize) -> Result<u32, Silence> {
        Err(Silence)
    }

    fn write8(&self, _: usize, _: u8) -> Result<(), Silence> {
        Err(Silence)
    }

    fn write16(&self, _: usize, _: u16) -> Result<(), Silence> {
        Err(Silence)
    }

    fn write32(&self, _: usize, _: u32) -> Result<(), Silence> {
        Err(Silence)
    }
}
