//! [`As5600Model`]: the registers of an [`As5600`](crate::drivers::As5600).

use super::Model;
use crate::bus::Width;

/// A simulated AS5600 with its magnet, for tests of the driver [`As5600`](crate::drivers::As5600).
/// Its registers behave as the data sheet says.
#[derive(Clone, Debug)]
pub struct As5600Model {
    /// The magnet's angle, in 4096ths of a turn.
    pub angle: u16,
    /// STATUS: 0x67 with a magnet; bit 0x20 means that there is one.
    pub status: u8,
    /// The automatic gain, which the register AGC shows.
    pub gain: u8,
    /// The magnitude, a number of 12 bits.
    pub magnitude: u16,
    /// ZMCO to CONF, as they were written.
    configuration: [u8; 9],
}

impl Default for As5600Model {
    fn default() -> Self {
        Self {
            angle: 0,
            status: 0x67,
            gain: 64,
            magnitude: 0x800,
            configuration: [0; 9],
        }
    }
}

impl As5600Model {
    /// ANGLE: of 12 bits, from the start to the stop position.
    fn scaled(&self) -> u16 {
        let [_, words @ ..] = self.configuration;
        let [start, stop, most, _] = [0, 2, 4, 6].map(|at| {
            let word = [words.get(at), words.get(at + 1)];
            u16::from_be_bytes(word.map(|byte| byte.copied().unwrap_or(0)))
        });
        let most = u32::from(most & 0xfff);
        let turned = |to: u16| u32::from(to.wrapping_sub(start) & 0xfff);
        let range = match (most, turned(stop)) {
            (0, 0) => 4096,
            (0, range) => range,
            (most, _) => most,
        };
        (turned(self.angle) * 4096 / range).min(4095) as u16
    }
}

impl Model for As5600Model {
    fn size(&self) -> usize {
        256
    }

    fn read(&mut self, offset: usize, width: Width) -> Option<u32> {
        let half = |word: u16, low: bool| word.to_be_bytes()[usize::from(low)];
        let byte = match offset {
            0x0b => self.status,
            0x0c | 0x0d => half(self.angle & 0xfff, offset == 0x0d),
            0x0e | 0x0f => half(self.scaled(), offset == 0x0f),
            0x1a => self.gain,
            0x1b | 0x1c => half(self.magnitude & 0xfff, offset == 0x1c),
            _ => self.configuration.get(offset).copied().unwrap_or(0),
        };
        (width == Width::Bits8).then_some(byte.into())
    }

    fn write(&mut self, offset: usize, width: Width, value: u32) -> Option<()> {
        // ZMCO counts what is burned.
        if let Some(place) = self.configuration.get_mut(offset).filter(|_| offset > 0) {
            *place = value as u8;
        }
        (width == Width::Bits8).then_some(())
    }

    /// The number of a register of 12 bits that cannot be written stays at it.
    fn next(&self, offset: usize) -> usize {
        match offset {
            0x0d | 0x0f | 0x1c => offset - 1,
            _ => offset + 1,
        }
    }
}
