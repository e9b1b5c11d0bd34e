//! [`EncoderModel`]: the registers of [`Encoder8`](crate::Encoder8)'s board.

use condor_dev::Width;
use condor_dev::sim::Model;

/// A simulated board with eight quadrature counters, for tests of the driver
/// [`Encoder8`](crate::Encoder8). The test turns the encoders.
#[derive(Debug, Default)]
pub struct EncoderModel {
    counts: [i32; 8],
    latches: [i32; 8],
    zero_at_index: u16,
    index: u16,
    missed: u16,
}

impl EncoderModel {
    /// Turns encoder `number` by `pulses`, which may be negative. Does nothing if `number` is 8 or
    /// more.
    pub fn turn(&mut self, number: usize, pulses: i32) {
        if let Some(count) = self.counts.get_mut(number) {
            *count = count.wrapping_add(pulses);
        }
    }

    /// Simulates an index pulse of encoder `number`. Does nothing if `number` is 8 or more.
    pub fn index(&mut self, number: usize) {
        let Some(count) = self.counts.get_mut(number) else {
            return;
        };
        let bit = 1 << number;
        self.index |= bit;
        if self.zero_at_index & bit != 0 {
            *count = 0;
            self.zero_at_index &= !bit;
        }
    }

    /// Simulates that both phases of encoder `number` change at once: the board then reports that
    /// its counter missed pulses. Does nothing if `number` is 8 or more.
    pub fn miss(&mut self, number: usize) {
        if number < self.counts.len() {
            self.missed |= 1 << number;
        }
    }
}

/// The numbers of the bits that are set.
fn named(bits: u32) -> impl Iterator<Item = usize> {
    (0..8).filter(move |number| bits >> number & 1 != 0)
}

impl Model for EncoderModel {
    fn size(&self) -> usize {
        0x40
    }

    fn read(&mut self, offset: usize, width: Width) -> Option<u32> {
        match (offset, width) {
            (0, Width::Bits16) => Some(0xe4c0),
            (6, Width::Bits16) => Some(self.zero_at_index.into()),
            (8, Width::Bits16) => Some(self.index.into()),
            (0x0a, Width::Bits16) => Some(self.missed.into()),
            (0x20..0x40, Width::Bits32) => {
                let latch = self.latches.get((offset - 0x20) / 4)?;
                Some(latch.cast_unsigned())
            }
            _ => None,
        }
    }

    fn write(&mut self, offset: usize, width: Width, value: u32) -> Option<()> {
        match (offset, width) {
            (2, Width::Bits16) => {
                for number in named(value) {
                    self.latches[number] = self.counts[number];
                }
            }
            (4, Width::Bits16) => {
                for number in named(value) {
                    self.counts[number] = 0;
                }
            }
            (6, Width::Bits16) => self.zero_at_index = value as u16 & 0xff,
            (8, Width::Bits16) => self.index &= !(value as u16),
            (0x0a, Width::Bits16) => self.missed &= !(value as u16),
            _ => return None,
        }
        Some(())
    }
}
