//! [`DacModel`]: the registers of [`Dac16`](crate::Dac16)'s board.

use condor_dev::Width;
use condor_dev::sim::Model;

/// A simulated digital-to-analog board with 16 channels, for tests of the driver
/// [`Dac16`](crate::Dac16). The test reads the outputs.
#[derive(Debug, Default)]
pub struct DacModel {
    written: [i16; 16],
    strobed: [i16; 16],
    connected: bool,
}

impl DacModel {
    /// Returns the present output of each channel; 0 while the outputs are disconnected.
    #[must_use]
    pub fn outputs(&self) -> [i16; 16] {
        if self.connected {
            self.strobed
        } else {
            [0; 16]
        }
    }

    /// Returns true if the driver has connected the outputs.
    #[must_use]
    pub fn is_connected(&self) -> bool {
        self.connected
    }
}

impl Model for DacModel {
    fn size(&self) -> usize {
        0x40
    }

    fn read(&mut self, offset: usize, width: Width) -> Option<u32> {
        match (offset, width) {
            (0, Width::Bits16) => Some(0xdac0),
            (2, Width::Bits16) => Some(self.connected.into()),
            (0x20..0x40, Width::Bits16) => {
                let written = self.written.get((offset - 0x20) / 2)?;
                Some(written.cast_unsigned().into())
            }
            _ => None,
        }
    }

    fn write(&mut self, offset: usize, width: Width, value: u32) -> Option<()> {
        match (offset, width) {
            (2, Width::Bits16) => self.connected = value & 1 != 0,
            (4, Width::Bits16) => self.strobed = self.written,
            (0x20..0x40, Width::Bits16) => {
                *self.written.get_mut((offset - 0x20) / 2)? = (value as u16).cast_signed();
            }
            _ => return None,
        }
        Some(())
    }
}
