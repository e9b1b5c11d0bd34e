//! [`As5600`]: a magnetic angle sensor.

use crate::bus::{Bus, Registers, Width};
use crate::driver::{DeviceError, Driver};

/// The driver of the AS5600, a chip on I2C at 0x36 that measures the angle of a magnet above it in
/// 4096 steps of a turn.
///
/// Address, registers and bits are those of figures 21 and 23, pages 18 to 20, of ams's data sheet,
/// version 1-06 of 2018. Bits without a name may have any value ("factory settings"; chips were
/// seen with 0x67 in STATUS). The driver ignores them and writes them back unchanged.
///
/// The chip has no identification. The probe reads, and takes a part for an AS5600 if the upper four
/// bits of RAW ANGLE, ANGLE and MAGNITUDE are 0 (so every chip is known to read, and common drivers
/// rely on it) and STATUS does not call the magnet too weak and too strong at once. It cannot tell
/// an AS5600 from a part that reads the same there, such as one that reads as 0 everywhere.
///
/// `init` sets the whole turn as range and 0 in all named bits of CONF: always on, no hysteresis, an
/// analog output, the slowest filter, no watchdog. So the settings of a former program are gone;
/// positions that were burned into the chip hold again after the next power-on.
///
/// `read` reads [`angle`](Self::angle) as two bytes in the byte order of the processor.
///
/// The driver never burns the chip's memory: settings are lost when the power is off.
#[derive(Debug)]
pub struct As5600;

/// The state of the magnet above an AS5600, as the chip sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Magnet {
    /// Whether there is a magnet that is strong enough (STATUS, MD).
    pub is_detected: bool,
    /// Whether the magnet is too weak: the gain is at its maximum (STATUS, ML).
    pub is_too_weak: bool,
    /// Whether the magnet is too strong: the gain is at its minimum (STATUS, MH).
    pub is_too_strong: bool,
    /// The automatic gain, from 0 to 255 with a supply of 5 V and to 128 with 3.3 V; at the best
    /// distance of the magnet it is in the middle.
    pub gain: u8,
    /// The magnitude that the chip's CORDIC computes, of 12 bits.
    pub magnitude: u16,
}

/// Figure 21, "Register Map".
mod register {
    /// ZPOS, MPOS, MANG and CONF follow each other, two bytes each.
    pub(super) const ZPOS: usize = 0x01;
    pub(super) const MPOS: usize = 0x03;
    pub(super) const STATUS: usize = 0x0b;
    pub(super) const RAW_ANGLE: usize = 0x0c;
    pub(super) const ANGLE: usize = 0x0e;
    pub(super) const AGC: usize = 0x1a;
    pub(super) const MAGNITUDE: usize = 0x1b;
}

/// Bits of STATUS (figures 21 and 23).
mod status {
    pub(super) const TOO_STRONG: u8 = 1 << 3;
    pub(super) const TOO_WEAK: u8 = 1 << 4;
    pub(super) const DETECTED: u8 = 1 << 5;
}

const TWELVE_BITS: u16 = 0xfff;
/// The bits of CONF that have a name (figure 22).
const CONF: u16 = 0x3fff;

impl As5600 {
    /// The 7-bit I2C address of the chip, which is the same for all AS5600.
    pub const ADDRESS: u8 = 0x36;
    /// The number of steps in which the chip measures a turn.
    pub const TURN: u16 = 4096;

    /// Returns the angle after the chip's filter and hysteresis: 0 at the start position, 4095 at
    /// the stop position. These positions are one turn apart unless [`set_range`](Self::set_range)
    /// changed them.
    ///
    /// # Errors
    /// Returns the bus's error if an access fails. A chip without a magnet returns an angle, too;
    /// see [`magnet`](Self::magnet).
    pub fn angle<B: Bus>(&self, registers: Registers<'_, B>) -> Result<u16, B::Error> {
        Self::word(registers, register::ANGLE)
    }

    /// Returns the angle in 4096ths of a turn, before the range of [`set_range`](Self::set_range)
    /// is applied.
    ///
    /// # Errors
    /// Returns the bus's error if an access fails.
    pub fn raw_angle<B: Bus>(&self, registers: Registers<'_, B>) -> Result<u16, B::Error> {
        Self::word(registers, register::RAW_ANGLE)
    }

    /// Sets the range of [`angle`](Self::angle), which is 0 at `start` and 4095 at `stop`. Both are
    /// raw angles, in 4096ths of a turn; 0 for both selects the whole turn. The range must be more
    /// than 18°; a change takes 1 ms (data sheet, pages 21 and 22, "Angle Programming").
    ///
    /// # Errors
    /// Returns the bus's error if an access fails.
    pub fn set_range<B: Bus>(
        &self,
        registers: Registers<'_, B>,
        start: u16,
        stop: u16,
    ) -> Result<(), B::Error> {
        for (register, position) in [(register::ZPOS, start), (register::MPOS, stop)] {
            let mut bytes = [0; 2];
            registers.read_block(register, &mut bytes)?;
            let unnamed = u16::from_be_bytes(bytes) & !TWELVE_BITS;
            let word = unnamed | position & TWELVE_BITS;
            registers.write_block(register, &word.to_be_bytes())?;
        }
        Ok(())
    }

    /// Returns the state of the magnet above the chip: whether it is there, and whether its field
    /// is too weak or too strong.
    ///
    /// # Errors
    /// Returns the bus's error if an access fails.
    pub fn magnet<B: Bus>(&self, registers: Registers<'_, B>) -> Result<Magnet, B::Error> {
        let status = registers.read8(register::STATUS)?;
        Ok(Magnet {
            is_detected: status & status::DETECTED != 0,
            is_too_weak: status & status::TOO_WEAK != 0,
            is_too_strong: status & status::TOO_STRONG != 0,
            gain: registers.read8(register::AGC)?,
            magnitude: Self::word(registers, register::MAGNITUDE)?,
        })
    }

    /// A register of 12 bits, high byte first; both bytes are of one instant in one transfer.
    fn word<B: Bus>(registers: Registers<'_, B>, register: usize) -> Result<u16, B::Error> {
        let mut bytes = [0; 2];
        registers.read_block(register, &mut bytes)?;
        Ok(u16::from_be_bytes(bytes) & TWELVE_BITS)
    }
}

impl Driver for As5600 {
    const NEW: Self = Self;
    const WRITES: bool = false;

    fn probe<B: Bus>(registers: Registers<'_, B>) -> bool {
        let looks_like_it = || {
            let both = status::TOO_WEAK | status::TOO_STRONG;
            let mut fits = registers.read8(register::STATUS)? & both != both;
            for word in [register::RAW_ANGLE, register::ANGLE, register::MAGNITUDE] {
                let mut bytes = [0; 2];
                registers.read_block(word, &mut bytes)?;
                fits &= u16::from_be_bytes(bytes) <= TWELVE_BITS;
            }
            Ok::<bool, B::Error>(fits)
        };
        registers.answers(register::STATUS, Width::Bits8) && looks_like_it().unwrap_or(false)
    }

    fn init<B: Bus>(&self, registers: Registers<'_, B>) -> Result<(), B::Error> {
        let mut bytes = [0; 8];
        registers.read_block(register::ZPOS, &mut bytes)?;
        let (words, _) = bytes.as_chunks_mut::<2>();
        let named = [TWELVE_BITS, TWELVE_BITS, TWELVE_BITS, CONF];
        for (word, named) in words.iter_mut().zip(named) {
            *word = (u16::from_be_bytes(*word) & !named).to_be_bytes();
        }
        registers.write_block(register::ZPOS, &bytes)
    }

    fn read<B: Bus>(
        &self,
        registers: Registers<'_, B>,
        into: &mut [u8],
    ) -> Result<usize, DeviceError<B::Error>> {
        let bytes = into.len();
        let place = into.first_chunk_mut();
        let place = place.ok_or(DeviceError::Length { bytes, unit: 2 })?;
        *place = self.angle(registers)?.to_ne_bytes();
        Ok(2)
    }

    fn read_ready<B: Bus>(&self, _: Registers<'_, B>) -> Result<bool, B::Error> {
        Ok(true)
    }
}
