//! [`Adc16`]: a 16-channel analog-to-digital board.

use crate::bus::{Bus, Registers, Width};
use crate::device::Device;
use crate::driver::{DeviceError, Driver};

/// A board with sixteen analog inputs, each converted to 16 bits.
///
/// | offset | width | register |
/// |---|---|---|
/// | 0x00 | 16 | identification, 0xadc0 |
/// | 0x20 + 2·*n* | 16 | the latest conversion of channel *n*, two's complement |
///
/// `read` gives the channels in order, two bytes each, in the byte order of the processor.
#[derive(Debug)]
pub struct Adc16(());

impl Adc16 {
    const IDENTIFICATION: u16 = 0xadc0;
    /// Channels of a board.
    pub const CHANNELS: usize = 16;

    const fn channel(number: usize) -> usize {
        0x20 + 2 * number
    }
}

impl Driver for Adc16 {
    const NAME: &'static str = "adc";
    const NEW: Self = Self(());
    const READS: bool = true;
    const WRITES: bool = false;

    fn probe<B: Bus>(registers: Registers<'_, B>) -> bool {
        registers.answers(0, Width::Bits16)
            && registers
                .read16(0)
                .is_ok_and(|found| found == Self::IDENTIFICATION)
    }

    fn init<B: Bus>(&self, _: Registers<'_, B>) -> Result<(), B::Error> {
        Ok(())
    }

    fn read<B: Bus>(
        &self,
        registers: Registers<'_, B>,
        into: &mut [u8],
    ) -> Result<usize, DeviceError<B::Error>> {
        let (pairs, _) = into.as_chunks_mut::<2>();
        if pairs.is_empty() {
            return Err(DeviceError::Length {
                bytes: into.len(),
                unit: 2,
            });
        }
        let mut read = 0;
        for (channel, pair) in pairs.iter_mut().take(Self::CHANNELS).enumerate() {
            *pair = registers.read16(Self::channel(channel))?.to_ne_bytes();
            read += 2;
        }
        Ok(read)
    }

    fn write<B: Bus>(
        &self,
        _: Registers<'_, B>,
        from: &[u8],
    ) -> Result<usize, DeviceError<B::Error>> {
        Err(DeviceError::Length {
            bytes: from.len(),
            unit: 0,
        })
    }

    fn read_ready<B: Bus>(&self, _: Registers<'_, B>) -> Result<bool, B::Error> {
        Ok(true)
    }

    fn write_ready<B: Bus>(&self, _: Registers<'_, B>) -> Result<bool, B::Error> {
        Ok(false)
    }
}

impl<B: Bus, const F: usize> Device<'_, B, Adc16, F> {
    /// The latest conversions of the first channels, as many as `into` has room for; says how many.
    ///
    /// # Errors
    /// The bus's.
    #[inline]
    pub fn scan(&self, into: &mut [i16]) -> Result<usize, B::Error> {
        let mut scanned = 0;
        for (channel, value) in into.iter_mut().take(Adc16::CHANNELS).enumerate() {
            *value = self
                .registers
                .read16(Adc16::channel(channel))?
                .cast_signed();
            scanned += 1;
        }
        Ok(scanned)
    }
}
