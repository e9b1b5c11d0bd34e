//! [`AdcModel`]: the registers of [`Adc16`](crate::Adc16)'s board.

use condor_dev::Width;
use condor_dev::sim::Model;

/// A simulated analog-to-digital board with 16 channels, for tests of the driver
/// [`Adc16`](crate::Adc16). The test sets the voltages.
#[derive(Debug, Default)]
pub struct AdcModel {
    /// The value to which each channel would convert now.
    pub channels: [i16; 16],
    converted: [i16; 16],
    control: u16,
    converting: bool,
    completed: bool,
}

impl AdcModel {
    /// Simulates a pulse on the board's trigger line.
    pub fn trigger(&mut self) {
        if self.control == 2 {
            self.begin();
        }
    }

    /// Completes the conversion that was started, if there is one.
    pub fn complete(&mut self) {
        if self.converting {
            self.converted = self.channels;
            self.completed = true;
            self.converting = false;
        }
    }

    fn begin(&mut self) {
        self.converting = true;
        self.completed = false;
    }
}

impl Model for AdcModel {
    fn size(&self) -> usize {
        0x40
    }

    fn read(&mut self, offset: usize, width: Width) -> Option<u32> {
        match (offset, width) {
            (0, Width::Bits16) => Some(0xadc0),
            (2, Width::Bits16) => Some(self.control.into()),
            (6, Width::Bits16) => Some((self.completed || self.control == 0).into()),
            (0x20..0x40, Width::Bits16) => {
                let latest = if self.control == 0 {
                    &self.channels
                } else {
                    &self.converted
                };
                let channel = latest.get((offset - 0x20) / 2)?;
                Some(u32::from(channel.cast_unsigned()))
            }
            _ => None,
        }
    }

    fn write(&mut self, offset: usize, width: Width, value: u32) -> Option<()> {
        match (offset, width) {
            (2, Width::Bits16) => {
                self.converted = self.channels;
                self.control = value as u16 & 3;
                self.converting = false;
                self.completed = false;
            }
            (4, Width::Bits16) if self.control == 1 => self.begin(),
            (4, Width::Bits16) => {}
            _ => return None,
        }
        Some(())
    }
}
