//! [`Adc16`]: a 16-channel analog-to-digital board.

use core::sync::atomic::{
    AtomicI16, AtomicU8, AtomicU32,
    Ordering::{Acquire, Relaxed, Release},
    fence,
};

use crate::identifies_as;
use condor_dev::{Attention, Bus, DeviceError, Driver, Registers};

/// The driver of a board with sixteen analog inputs, each converted to 16 bits.
///
/// | offset | width | access | register |
/// |---|---|---|---|
/// | 0x00 | 16 | read | identification, 0xadc0 |
/// | 0x02 | 16 | both | control: bits 0 and 1 the event that starts a conversion of all channels: 0 all the time, 1 a write to 0x04, 2 the trigger line, 3 the timer; bit 4 an interrupt after each conversion |
/// | 0x04 | 16 | write | any value starts a conversion, if a write to this register does |
/// | 0x06 | 16 | read | status: bit 0 a conversion has been completed since the last one was started |
/// | 0x08 | 16 | both | rate of the timer, Hz |
/// | 0x0a | 16 | both | how much earlier than the middle of each of its periods the timer starts a conversion, µs; periods are counted from the beginning of the time of the bus |
/// | 0x0c | 16 | read | the number of conversions; wraps |
/// | 0x20 + 2·*n* | 16 | read | the latest conversion of channel *n*, two's complement |
///
/// `read` returns the channels in order, two bytes each, in the byte order of the processor; it returns
/// [`DeviceError::WouldBlock`] between the start of a conversion and its end. An open board converts all the time,
/// until [`set_trigger`](Self::set_trigger) or [`set_timer`](Self::set_timer) changes that.
///
/// While the timer starts conversions, each of them interrupts, and the driver takes the channels then;
/// [`scan`](Self::scan) returns these. Several processors may read a board by its timer, if they set the same. So the
/// driver does not touch the board when it takes a conversion, and the board goes on when one of them closes it. While
/// one of them opens the board, it converts all the time, and the others get its channels from the board.
#[derive(Debug)]
pub struct Adc16 {
    trigger: AtomicU8,
    /// The number of the conversion that was taken last, in the lower 16 bits; bit 16 is the buffer that has it.
    taken: AtomicU32,
    buffers: [[AtomicI16; Adc16::CHANNELS]; 2],
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
    /// The board's timer: see [`Adc16::set_timer`].
    Timer = 3,
}

const IDENTIFICATION: u16 = 0xadc0;
const COMPLETED: u16 = 1 << 0;
const INTERRUPTS: u16 = 1 << 4;

mod offset {
    pub(super) const CONTROL: usize = 0x02;
    pub(super) const START: usize = 0x04;
    pub(super) const STATUS: usize = 0x06;
    pub(super) const RATE: usize = 0x08;
    pub(super) const AHEAD: usize = 0x0a;
    pub(super) const COUNT: usize = 0x0c;
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
        taken: AtomicU32::new(0),
        buffers: [const { [const { AtomicI16::new(0) }; Adc16::CHANNELS] }; 2],
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

    fn interrupt<B: Bus>(&self, registers: Registers<'_, B>) -> Result<Attention, B::Error> {
        let taken = self.taken.load(Relaxed);
        let count = registers.read16(offset::COUNT)?;
        if count == taken as u16 || !self.is_timed() {
            return Ok(Attention::NotMine);
        }
        // A loop may still be reading what it found before: it sees the store of `taken` before those below.
        fence(Release);
        let next = (taken >> 16 & 1) ^ 1;
        let buffer = self.buffers.get(next as usize);
        for (channel, place) in buffer.into_iter().flatten().enumerate() {
            let value = registers.read16(Self::channel(channel))?;
            place.store(value.cast_signed(), Relaxed);
        }
        self.taken.store(next << 16 | u32::from(count), Release);
        Ok(Attention::Mine)
    }
}

impl Adc16 {
    fn is_timed(&self) -> bool {
        self.trigger.load(Relaxed) == ConversionTrigger::Timer as u8
    }

    /// Copies what the interrupt has taken; `None` if the board has converted since.
    fn copy_taken<B: Bus>(
        &self,
        registers: Registers<'_, B>,
        into: &mut [i16],
    ) -> Result<Option<usize>, B::Error> {
        // Pairs with the Release in `interrupt`.
        let taken = self.taken.load(Acquire);
        if registers.read16(offset::COUNT)? != taken as u16 {
            return Ok(None);
        }
        let buffer = self.buffers.get((taken >> 16) as usize);
        let mut copied = 0;
        for (value, place) in into.iter_mut().zip(buffer.into_iter().flatten()) {
            *value = place.load(Relaxed);
            copied += 1;
        }
        fence(Acquire);
        Ok((self.taken.load(Relaxed) == taken).then_some(copied))
    }

    /// Reads the latest conversions of the channels from 0 on into `into`, one value per channel, until `into` is full
    /// or all channels are read. Returns the number of values. If the board's interrupt has taken the latest conversion,
    /// the values come from memory; otherwise from the board.
    ///
    /// # Errors
    /// Returns the bus's error if an access fails; `into` may have been written in part.
    #[inline]
    pub fn scan<B: Bus>(
        &self,
        registers: Registers<'_, B>,
        into: &mut [i16],
    ) -> Result<usize, B::Error> {
        if self.is_timed()
            && let Some(copied) = self.copy_taken(registers, into)?
        {
            return Ok(copied);
        }
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

    /// Has the board's timer start a conversion `rate_hz` times per second, each `ahead_us` before the middle of a
    /// period, and has each conversion interrupt.
    ///
    /// # Errors
    /// Returns the bus's error if an access fails; the board may then still have its previous trigger.
    pub fn set_timer<B: Bus>(
        &self,
        registers: Registers<'_, B>,
        rate_hz: u16,
        ahead_us: u16,
    ) -> Result<(), B::Error> {
        critical_section::with(|_| {
            registers.write16(offset::RATE, rate_hz)?;
            registers.write16(offset::AHEAD, ahead_us)?;
            registers.write16(
                offset::CONTROL,
                ConversionTrigger::Timer as u16 | INTERRUPTS,
            )?;
            // None was taken yet.
            let before = registers.read16(offset::COUNT)?.wrapping_sub(1);
            self.taken.store(before.into(), Relaxed);
            self.trigger.store(ConversionTrigger::Timer as u8, Relaxed);
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
