//! [`Pca9685Model`]: the registers of a [`Pca9685`](crate::drivers::Pca9685).

use super::Model;
use crate::bus::Width;

const MODE1: usize = 0x00;
const LED0: usize = 0x06;
const LED_END: usize = 0x46;
const ALL_LED: usize = 0xfa;
const PRE_SCALE: usize = 0xfe;

const RESTART: u8 = 1 << 7;
const SLEEP: u8 = 1 << 4;

/// The model of a chip; `default` is its state after power-on, and registers change as the data
/// sheet says.
#[derive(Debug)]
pub struct Pca9685Model([u8; 256]);

impl Default for Pca9685Model {
    fn default() -> Self {
        let mut registers = [0; 256];
        registers[MODE1] = SLEEP | 1;
        registers[0x01] = 0x04;
        registers[PRE_SCALE] = 0x1e;
        for channel in 0..16 {
            registers[LED0 + 4 * channel + 3] = 0x10;
        }
        Self(registers)
    }
}

impl Pca9685Model {
    /// Returns for how many counts of a cycle of 4096 a channel is on; `None` while the chip sleeps or
    /// waits for its restart.
    #[must_use]
    pub fn duty(&self, channel: usize) -> Option<u16> {
        let [a, b, c, d] = *self.0.get(LED0 + 4 * channel..)?.first_chunk()?;
        let (on, off) = (u16::from_le_bytes([a, b]), u16::from_le_bytes([c, d]));
        if self.0[MODE1] & (SLEEP | RESTART) != 0 || channel >= 16 {
            return None;
        }
        Some(match (on, off) {
            (_, 0x1000..) => 0,
            (0x1000.., _) => 4096,
            (on, off) => off.wrapping_sub(on) % 4096,
        })
    }

    /// Returns the prescaler, which sets the frequency of the outputs.
    #[must_use]
    pub fn prescaler(&self) -> u8 {
        self.0[PRE_SCALE]
    }
}

impl Model for Pca9685Model {
    fn size(&self) -> usize {
        self.0.len()
    }

    fn read(&mut self, offset: usize, width: Width) -> Option<u32> {
        let byte = *self.0.get(offset)?;
        (width == Width::Bits8).then_some(byte.into())
    }

    fn write(&mut self, offset: usize, width: Width, value: u32) -> Option<()> {
        let value = value as u8;
        match offset {
            MODE1 => {
                let running = self.0[MODE1] & SLEEP == 0 && (0..16).any(|n| self.duty(n) > Some(0));
                let kept = self.0[MODE1] & RESTART;
                // A one clears the bit; the chip sets it when it goes to sleep with outputs on.
                let cleared = value & RESTART != 0 && value & SLEEP == 0;
                let restart = if value & SLEEP != 0 && running {
                    RESTART
                } else if cleared {
                    0
                } else {
                    kept
                };
                self.0[MODE1] = value & !RESTART | restart;
            }
            // Blocked unless the chip sleeps; the least is 3.
            PRE_SCALE if self.0[MODE1] & SLEEP == 0 => {}
            PRE_SCALE => self.0[PRE_SCALE] = value.max(3),
            ALL_LED..PRE_SCALE => {
                let first = LED0 + offset - ALL_LED;
                for place in self.0.iter_mut().take(LED_END).skip(first).step_by(4) {
                    *place = value;
                }
            }
            LED0..LED_END => {
                *self.0.get_mut(offset)? = value;
                if self.0[MODE1] & SLEEP == 0 {
                    self.0[MODE1] &= !RESTART;
                }
            }
            _ => *self.0.get_mut(offset)? = value,
        }
        (width == Width::Bits8).then_some(())
    }
}
