//! [`Silent`]: a bus without boards.

use condor_dev::{Bus, BusError, BusErrorKind};

/// A bus on which nothing answers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Silent;

/// The error of every access of [`Silent`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("nothing answers at {address:#x}: this processor has no bus")]
pub struct NobodyAnswers {
    /// Where.
    pub address: usize,
}

impl BusError for NobodyAnswers {
    fn kind(&self) -> BusErrorKind {
        BusErrorKind::NoAnswer
    }
}

impl Bus for Silent {
    type Error = NobodyAnswers;

    fn read8(&self, address: usize) -> Result<u8, NobodyAnswers> {
        Err(NobodyAnswers { address })
    }

    fn read16(&self, address: usize) -> Result<u16, NobodyAnswers> {
        Err(NobodyAnswers { address })
    }

    fn read32(&self, address: usize) -> Result<u32, NobodyAnswers> {
        Err(NobodyAnswers { address })
    }

    fn write8(&self, address: usize, _: u8) -> Result<(), NobodyAnswers> {
        Err(NobodyAnswers { address })
    }

    fn write16(&self, address: usize, _: u16) -> Result<(), NobodyAnswers> {
        Err(NobodyAnswers { address })
    }

    fn write32(&self, address: usize, _: u32) -> Result<(), NobodyAnswers> {
        Err(NobodyAnswers { address })
    }
}
