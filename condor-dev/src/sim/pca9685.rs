//! [`Pca9685Model`]: the registers of a [`Pca9685`](crate::drivers::Pca9685).

use super::Model;
use crate::bus::Width;

const MODE1: usize = 0x00;
const MODE2: usize = 0x01;
const SUBADR1: usize = 0x02;
const ALLCALLADR: usize = 0x05;
const LED0: usize = 0x06;
const LED_END: usize = 0x46;
const ALL_LED: usize = 0xfa;
const PRE_SCALE: usize = 0xfe;

const RESTART: u8 = 1 << 7;
const EXTCLK: u8 = 1 << 6;
const AUTO_INCREMENT: u8 = 1 << 5;
const SLEEP: u8 = 1 << 4;
const INVERTED: u8 = 1 << 4;

/// A simulated PCA9685, for tests of the driver [`Pca9685`](crate::drivers::Pca9685). `default` is its state after
/// power-on, and its registers behave as the data sheet says.
#[derive(Debug)]
pub struct Pca9685Model([u8; 256]);

impl Default for Pca9685Model {
    fn default() -> Self {
        let mut registers = [0; 256];
        registers[MODE1] = SLEEP | 1;
        registers[MODE2] = 0x04;
        registers[SUBADR1..=ALLCALLADR].copy_from_slice(&[0xe2, 0xe4, 0xe8, 0xe0]);
        registers[PRE_SCALE] = 0x1e;
        for channel in 0..16 {
            registers[LED0 + 4 * channel + 3] = 0x10;
        }
        Self(registers)
    }
}

impl Pca9685Model {
    /// Returns for how many of the 4096 counts in a cycle the pin of output `channel` is high; `None` while the chip
    /// sleeps or waits for its restart, or if `channel` is 16 or more.
    #[must_use]
    pub fn duty(&self, channel: usize) -> Option<u16> {
        let [a, b, c, d] = *self.0.get(LED0 + 4 * channel..)?.first_chunk()?;
        let (on, off) = (u16::from_le_bytes([a, b]), u16::from_le_bytes([c, d]));
        if self.0[MODE1] & (SLEEP | RESTART) != 0 || channel >= 16 {
            return None;
        }
        let on = match (on, off) {
            (_, 0x1000..) => 0,
            (0x1000.., _) => 4096,
            (on, off) => off.wrapping_sub(on) % 4096,
        };
        let is_inverted = self.0[MODE2] & INVERTED != 0;
        Some(if is_inverted { 4096 - on } else { on })
    }

    /// Returns the value of the register `PRE_SCALE`, which sets the frequency of the outputs.
    #[must_use]
    pub fn prescaler(&self) -> u8 {
        self.0[PRE_SCALE]
    }

    /// MODE1 after a write.
    fn mode1(&self, value: u8) -> u8 {
        let before = self.0[MODE1];
        let running = before & SLEEP == 0 && (0..16).any(|n| self.duty(n) > Some(0));
        // A one clears the bit; the chip sets it when it goes to sleep with outputs on.
        let cleared = value & RESTART != 0 && value & SLEEP == 0;
        let restart = if value & SLEEP != 0 && running {
            RESTART
        } else if cleared {
            0
        } else {
            before & RESTART
        };
        // Set by a chip that slept and goes on sleeping, and never cleared.
        let external = if before & value & SLEEP != 0 {
            (before | value) & EXTCLK
        } else {
            before & EXTCLK
        };
        value & !(RESTART | EXTCLK) | restart | external
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
            MODE1 => self.0[MODE1] = self.mode1(value),
            MODE2 => self.0[MODE2] = value & 0x1f,
            SUBADR1..=ALLCALLADR => *self.0.get_mut(offset)? = value & 0xfe,
            // Blocked unless the chip sleeps; the least is 3.
            PRE_SCALE if self.0[MODE1] & SLEEP == 0 => {}
            PRE_SCALE => self.0[PRE_SCALE] = value.max(3),
            ALL_LED..PRE_SCALE => {
                let first = LED0 + offset - ALL_LED;
                for place in self.0.iter_mut().take(LED_END).skip(first).step_by(4) {
                    *place = if offset & 1 == 1 { value & 0x1f } else { value };
                }
            }
            LED0..LED_END => {
                let is_high = offset & 1 == 1;
                *self.0.get_mut(offset)? = if is_high { value & 0x1f } else { value };
                if self.0[MODE1] & SLEEP == 0 {
                    self.0[MODE1] &= !RESTART;
                }
            }
            // Reserved.
            _ => {}
        }
        (width == Width::Bits8).then_some(())
    }

    /// The register stays without the bit for it, and comes back to the first from both ends.
    fn next(&self, offset: usize) -> usize {
        match offset {
            _ if self.0[MODE1] & AUTO_INCREMENT == 0 => offset,
            0x45 | PRE_SCALE => MODE1,
            _ => offset + 1,
        }
    }

    /// The three sub-addresses and that of all chips, each with its bit of MODE1.
    fn also_at(&self, address: usize) -> Option<usize> {
        let others = (SUBADR1..=ALLCALLADR).zip([1 << 3, 1 << 2, 1 << 1, 1 << 0]);
        let mut enabled = others.filter(|(_, bit)| self.0[MODE1] & bit != 0);
        let is_one = enabled.any(|(other, _)| usize::from(self.0[other] >> 1) == address >> 8);
        is_one.then_some(address & 0xff)
    }
}
