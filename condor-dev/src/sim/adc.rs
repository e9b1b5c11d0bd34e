//! [`AdcModel`]: the registers of [`Adc16`](crate::drivers::Adc16)'s board.

use super::Model;
use crate::bus::Width;

/// A 16-channel analog-to-digital board, whose voltages a test sets.
#[derive(Debug, Default)]
pub struct AdcModel {
    /// What each channel converts to.
    pub channels: [i16; 16],
}

impl Model for AdcModel {
    fn size(&self) -> usize {
        0x40
    }

    fn read(&mut self, offset: usize, width: Width) -> Option<u32> {
        match (offset, width) {
            (0, Width::Bits16) => Some(0xadc0),
            (0x20..0x40, Width::Bits16) => {
                let channel = self.channels.get((offset - 0x20) / 2)?;
                Some(u32::from(channel.cast_unsigned()))
            }
            _ => None,
        }
    }

    fn write(&mut self, _: usize, _: Width, _: u32) -> Option<()> {
        None
    }
}
