//! [`Dac16`]: a 16-channel digital-to-analog board.

use crate::identifies_as;
use condor_dev::{Bus, DeviceError, Driver, Registers};

/// The driver of a board with sixteen analog outputs of 16 bits, double-buffered.
///
/// | offset | width | access | register |
/// |---|---|---|---|
/// | 0x00 | 16 | read | identification, 0xdac0 |
/// | 0x02 | 16 | both | control: bit 0 connects the outputs; without it all are at 0 V |
/// | 0x04 | 16 | write | strobe: any value brings all that was written to the outputs, at once |
/// | 0x20 + 2·*n* | 16 | both | the value that channel *n* puts out from the next strobe on, two's complement |
///
/// `write` takes channels in order from 0, two bytes each in the byte order of the processor. The
/// channels of one call change at the same instant, and if the call fails before its strobe, none
/// of them does. (A context that interrupts the call brings the part already written to the outputs
/// with its own strobe.)
///
/// The outputs are connected, at 0 V, when the board is opened, and disconnected when it is closed,
/// whatever else fails then.
#[derive(Debug)]
pub struct Dac16(());

const IDENTIFICATION: u16 = 0xdac0;
const CONNECTED: u16 = 1 << 0;

mod offset {
    pub(super) const CONTROL: usize = 0x02;
    pub(super) const STROBE: usize = 0x04;
    pub(super) const CHANNELS: usize = 0x20;
}

impl Dac16 {
    /// The number of channels of a board.
    pub const CHANNELS: usize = 16;

    #[inline(always)]
    fn put<B: Bus>(
        registers: Registers<'_, B>,
        first: usize,
        values: impl Iterator<Item = i16>,
    ) -> Result<(), B::Error> {
        for (channel, value) in (first..Self::CHANNELS).zip(values) {
            registers.write16(offset::CHANNELS + 2 * channel, value.cast_unsigned())?;
        }
        registers.write16(offset::STROBE, 1)
    }

    /// Brings the outputs to 0 V by every way there is, also if one fails.
    fn rest<B: Bus>(registers: Registers<'_, B>) -> Result<(), B::Error> {
        let disconnected = registers.write16(offset::CONTROL, 0);
        let zeroed = Self::put(registers, 0, core::iter::repeat(0));
        disconnected.and(zeroed)
    }
}

impl Driver for Dac16 {
    const NEW: Self = Self(());
    const READS: bool = false;

    fn probe<B: Bus>(registers: Registers<'_, B>) -> bool {
        identifies_as(registers, IDENTIFICATION)
    }

    fn init<B: Bus>(&self, registers: Registers<'_, B>) -> Result<(), B::Error> {
        Self::rest(registers)
    }

    fn open<B: Bus>(&self, registers: Registers<'_, B>) -> Result<(), B::Error> {
        Self::rest(registers)?;
        registers.write16(offset::CONTROL, CONNECTED)
    }

    fn close<B: Bus>(&self, registers: Registers<'_, B>) -> Result<(), B::Error> {
        Self::rest(registers)
    }

    fn write<B: Bus>(
        &self,
        registers: Registers<'_, B>,
        from: &[u8],
    ) -> Result<usize, DeviceError<B::Error>> {
        let (pairs, _) = from.as_chunks::<2>();
        if pairs.is_empty() {
            return Err(DeviceError::Length {
                bytes: from.len(),
                unit: 2,
            });
        }
        let values = pairs.iter().map(|pair| i16::from_ne_bytes(*pair));
        Self::put(registers, 0, values)?;
        Ok(2 * pairs.len().min(Self::CHANNELS))
    }

    fn write_ready<B: Bus>(&self, _: Registers<'_, B>) -> Result<bool, B::Error> {
        Ok(true)
    }
}

impl Dac16 {
    /// Sets the outputs of the channels from number `first` on to `values`, in order and all at the
    /// same instant.
    ///
    /// # Errors
    /// [`DeviceError::Length`] if there are more values than channels from `first` on;
    /// [`DeviceError::Bus`] if an access fails. No output has changed then.
    #[inline]
    pub fn write_channels<B: Bus>(
        &self,
        registers: Registers<'_, B>,
        first: usize,
        values: &[i16],
    ) -> Result<(), DeviceError<B::Error>> {
        if first > Dac16::CHANNELS || values.len() > Dac16::CHANNELS - first {
            return Err(DeviceError::Length {
                bytes: 2 * values.len(),
                unit: 2,
            });
        }
        Ok(Dac16::put(registers, first, values.iter().copied())?)
    }

    /// Sets the outputs of all channels to `values`, at the same instant.
    ///
    /// # Errors
    /// Returns the bus's error if an access fails; no output has changed then.
    #[inline]
    pub fn write_all<B: Bus>(
        &self,
        registers: Registers<'_, B>,
        values: &[i16; Dac16::CHANNELS],
    ) -> Result<(), B::Error> {
        Dac16::put(registers, 0, values.iter().copied())
    }
}
