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
    rate_and_ahead: [u16; 2],
    count: u16,
    asks: bool,
    converting: bool,
    completed: bool,
}

impl AdcModel {
    /// Simulates a pulse on the board's trigger line.
    pub fn trigger(&mut self) {
        if self.trigger_source() == 2 {
            self.begin();
        }
    }

    /// Has the timer start and complete a conversion.
    pub fn tick(&mut self) {
        if self.trigger_source() == 3 {
            self.begin();
            self.complete();
        }
    }

    /// Completes the conversion that was started, if there is one.
    pub fn complete(&mut self) {
        if self.converting {
            self.converted = self.channels;
            self.completed = true;
            self.converting = false;
            self.count = self.count.wrapping_add(1);
            self.asks = self.control & 1 << 4 != 0;
        }
    }

    fn trigger_source(&self) -> u16 {
        self.control % 4
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
            (6, Width::Bits16) => Some((self.completed || self.trigger_source() == 0).into()),
            (8, Width::Bits16) => Some(self.rate_and_ahead[0].into()),
            (10, Width::Bits16) => Some(self.rate_and_ahead[1].into()),
            (12, Width::Bits16) => Some(self.count.into()),
            (0x20..0x40, Width::Bits16) => {
                self.asks = false;
                let latest = if self.trigger_source() == 0 {
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
                self.control = value as u16 & 0x13;
                self.asks = false;
                self.converting = false;
                self.completed = false;
            }
            (8, Width::Bits16) => self.rate_and_ahead[0] = value as u16,
            (10, Width::Bits16) => self.rate_and_ahead[1] = value as u16,
            (4, Width::Bits16) if self.trigger_source() == 1 => self.begin(),
            (4, Width::Bits16) => {}
            _ => return None,
        }
        Some(())
    }

    /// Until a channel of the conversion is read.
    fn interrupts(&self) -> bool {
        self.asks
    }
}
