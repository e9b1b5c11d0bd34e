//! [`Adc16`]: a 16-channel analog-to-digital board.

use core::sync::atomic::{AtomicU8, Ordering::Relaxed};

use crate::identifies_as;
use condor_dev::{Bus, DeviceError, Driver, Registers};

/// The driver of a board with sixteen analog inputs, each converted to 16 bits.
///
/// | offset | width | access | register |
/// |---|---|---|---|
/// | 0x00 | 16 | read | identification, 0xadc0 |
/// | 0x02 | 16 | both | control: the event that starts a conversion of all channels; 0 all the time, 1 a write to 0x04, 2 the trigger line |
/// | 0x04 | 16 | write | any value starts a conversion, if control is 1 |
/// | 0x06 | 16 | read | status: bit 0 a conversion has been completed since the last one was started |
/// | 0x20 + 2·*n* | 16 | read | the latest conversion of channel *n*, two's complement |
///
/// `read` returns the channels in order, two bytes each, in the byte order of the processor; it returns
/// [`DeviceError::WouldBlock`] between the start of a conversion and its end. An open board converts all the time,
/// until [`set_trigger`](Self::set_trigger) changes that.
#[derive(Debug)]
pub struct Adc16 {
    trigger: AtomicU8,
}

/// The event that makes an [`Adc16`] start a conversion of all its channels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum ConversionTrigger {
    /// The end of the previous conversion.
    Continuous = 0,
    /// A call of [`start`](Adc16::start).
    Command = 1,
    /// A pulse on the board's trigger line.
    External = 2,
}

const IDENTIFICATION: u16 = 0xadc0;
const COMPLETED: u16 = 1 << 0;

mod offset {
    pub(super) const CONTROL: usize = 0x02;
    pub(super) const START: usize = 0x04;
    pub(super) const STATUS: usize = 0x06;
    pub(super) const CHANNELS: usize = 0x20;
}

impl Adc16 {
    /// The number of channels of a board.
    pub const CHANNELS: usize = 16;

    const fn channel(number: usize) -> usize {
        offset::CHANNELS + 2 * number
    }

    fn completed<B: Bus>(registers: Registers<'_, B>) -> Result<bool, B::Error> {
        Ok(registers.read16(offset::STATUS)? & COMPLETED != 0)
    }
}

impl Driver for Adc16 {
    const NEW: Self = Self {
        trigger: AtomicU8::new(ConversionTrigger::Continuous as u8),
    };
    const WRITES: bool = false;

    fn probe<B: Bus>(registers: Registers<'_, B>) -> bool {
        identifies_as(registers, IDENTIFICATION)
    }

    fn init<B: Bus>(&self, registers: Registers<'_, B>) -> Result<(), B::Error> {
        self.set_trigger(registers, ConversionTrigger::Continuous)
    }

    fn open<B: Bus>(&self, registers: Registers<'_, B>) -> Result<(), B::Error> {
        self.set_trigger(registers, ConversionTrigger::Continuous)
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
        if !self.read_ready(registers)? {
            return Err(DeviceError::WouldBlock);
        }
        let mut read = 0;
        for (channel, pair) in pairs.iter_mut().take(Self::CHANNELS).enumerate() {
            *pair = registers.read16(Self::channel(channel))?.to_ne_bytes();
            read += 2;
        }
        Ok(read)
    }

    fn read_ready<B: Bus>(&self, registers: Registers<'_, B>) -> Result<bool, B::Error> {
        if self.trigger.load(Relaxed) == ConversionTrigger::Continuous as u8 {
            return Ok(true);
        }
        Self::completed(registers)
    }
}

impl Adc16 {
    /// Reads the latest conversions of the channels from 0 on into `into`, one value per channel, until `into` is full
    /// or all channels are read. Returns the number of values.
    ///
    /// # Errors
    /// Returns the bus's error if an access fails; `into` may have been written in part.
    #[inline]
    pub fn scan<B: Bus>(
        &self,
        registers: Registers<'_, B>,
        into: &mut [i16],
    ) -> Result<usize, B::Error> {
        let mut scanned = 0;
        for (channel, value) in into.iter_mut().take(Adc16::CHANNELS).enumerate() {
            *value = registers.read16(Adc16::channel(channel))?.cast_signed();
            scanned += 1;
        }
        Ok(scanned)
    }

    /// Sets the event that starts a conversion of all channels from now on.
    ///
    /// # Errors
    /// Returns the bus's error if the access fails; the previous trigger stays in force.
    pub fn set_trigger<B: Bus>(
        &self,
        registers: Registers<'_, B>,
        trigger: ConversionTrigger,
    ) -> Result<(), B::Error> {
        critical_section::with(|_| {
            registers.write16(offset::CONTROL, trigger as u16)?;
            self.trigger.store(trigger as u8, Relaxed);
            Ok(())
        })
    }

    /// Starts a conversion of all channels; has an effect only if the trigger is [`ConversionTrigger::Command`].
    ///
    /// # Errors
    /// Returns the bus's error if the access fails.
    #[inline]
    pub fn start<B: Bus>(&self, registers: Registers<'_, B>) -> Result<(), B::Error> {
        registers.write16(offset::START, 1)
    }

    /// Returns true if a conversion has been completed since the last one was started.
    ///
    /// # Errors
    /// Returns the bus's error if the access fails.
    #[inline]
    pub fn is_ready<B: Bus>(&self, registers: Registers<'_, B>) -> Result<bool, B::Error> {
        Self::completed(registers)
    }
}
