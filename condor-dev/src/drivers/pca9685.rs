//! [`Pca9685`]: a chip with 16 outputs of pulse-width modulation.

use crate::bus::{Bus, Registers, Width};
use crate::driver::{DeviceError, Driver};

/// A PCA9685, on I2C at 0x40 to 0x7f as its pins say: 16 outputs of 12 bits and one frequency, for
/// servos and LEDs. Registers and bits are those of section 7.3 of NXP's data sheet, revision 4 of 2015.
///
/// Opening the chip wakes it; closing it switches all outputs off and lets it sleep. `write` sets the
/// duties of the first channels, two bytes each, in the byte order of the processor, as
/// [`set_duties`](Self::set_duties) does. Outputs change with the end of the transfer.
///
/// The oscillator needs 500 µs to start after the open; no timing of an output that is set before is
/// guaranteed (data sheet, section 7.3.1).
///
/// Frequencies are those of the internal oscillator, nominally 25 MHz; see
/// [`set_frequency`](Self::set_frequency).
#[derive(Debug)]
pub struct Pca9685;

/// The register summary of section 7.3.
mod register {
    pub(super) const MODE1: usize = 0x00;
    /// On and off counts of the first channel, four registers each: low and high byte.
    pub(super) const LED0: usize = 0x06;
    /// The same for all channels at once: a bit of FULL in it is the orderly shutdown of 7.3.1.1.
    pub(super) const ALL_LED_OFF_H: usize = 0xfd;
    pub(super) const PRE_SCALE: usize = 0xfe;
}

/// Bits of MODE1 (section 7.3.1).
mod mode1 {
    pub(super) const RESTART: u8 = 1 << 7;
    pub(super) const AUTO_INCREMENT: u8 = 1 << 5;
    pub(super) const SLEEP: u8 = 1 << 4;
    /// What a chip that this driver uses does: no external clock, no other addresses.
    pub(super) const AWAKE: u8 = AUTO_INCREMENT;
}

/// The bit of a high byte that has the output be on, or off, all the time; off goes before on
/// (section 7.3.3).
const FULL: u16 = 1 << 12;
/// Hertz of the internal oscillator.
const OSCILLATOR: u32 = 25_000_000;

impl Pca9685 {
    /// The number of outputs of a chip.
    pub const CHANNELS: usize = 16;
    /// The number of counts in a cycle: an output with this duty is on all the time.
    pub const CYCLE: u16 = 4096;

    /// Sets the frequency of all outputs to the nearest possible one to `hertz`, and returns it in
    /// hertz.
    ///
    /// It is 25 MHz / (4096 · (`PRE_SCALE` + 1)), where the prescaler is from 3 to 255: from 24 Hz to
    /// 1526 Hz (data sheet, section 7.3.5). The chip sleeps while the prescaler is set, so outputs are
    /// off for that long, and then go on as they were. Its oscillator needs 500 µs to start, in
    /// which the outputs are not right yet.
    ///
    /// # Errors
    /// The bus's error if an access fails; the chip may sleep then, so set the frequency again.
    pub fn set_frequency<B: Bus>(
        &self,
        registers: Registers<'_, B>,
        hertz: u16,
    ) -> Result<u16, B::Error> {
        let cycle = u32::from(Self::CYCLE);
        let divisor = cycle * u32::from(hertz.max(1));
        let steps = ((OSCILLATOR + divisor / 2) / divisor).clamp(4, 256);
        registers.write8(register::MODE1, mode1::AWAKE | mode1::SLEEP)?;
        registers.write8(register::PRE_SCALE, (steps - 1) as u8)?;
        Self::wake(registers)?;
        let exactly = cycle * steps;
        Ok(((OSCILLATOR + exactly / 2) / exactly) as u16)
    }

    /// Ends the sleep, in which the chip keeps its counts, and has outputs go on that were on.
    ///
    /// A restart is due 500 µs after the end of the sleep (data sheet, section 7.3.1.1), for which
    /// nobody waits here: a chip that does not take it so early has its outputs go on with the next
    /// write to a channel. A one in RESTART clears it.
    fn wake<B: Bus>(registers: Registers<'_, B>) -> Result<(), B::Error> {
        registers.write8(register::MODE1, mode1::AWAKE)?;
        registers.write8(register::MODE1, mode1::AWAKE | mode1::RESTART)
    }

    /// Sets for how many counts of a cycle of 4096 each channel from `first` on is on; 0 is off,
    /// and [`CYCLE`](Self::CYCLE) or more is on all the time. All values are sent in one transfer.
    ///
    /// # Errors
    /// [`DeviceError::Length`] if the chip has fewer channels, [`DeviceError::Bus`] if the bus
    /// fails.
    pub fn set_duties<B: Bus>(
        &self,
        registers: Registers<'_, B>,
        first: usize,
        duties: &[u16],
    ) -> Result<(), DeviceError<B::Error>> {
        if first > Self::CHANNELS || duties.len() > Self::CHANNELS - first {
            let bytes = 2 * duties.len();
            return Err(DeviceError::Length { bytes, unit: 2 });
        }
        let mut block = [0; 4 * Self::CHANNELS];
        let (channels, _) = block.as_chunks_mut::<4>();
        for (channel, &duty) in channels.iter_mut().zip(duties) {
            let (on, off) = match duty {
                0 => (0, FULL),
                Self::CYCLE.. => (FULL, 0),
                counts => (0, counts),
            };
            let ([a, b], [c, d]) = (u16::to_le_bytes(on), u16::to_le_bytes(off));
            *channel = [a, b, c, d];
        }
        let bytes = block.get(..4 * duties.len()).unwrap_or_default();
        Ok(registers.write_block(register::LED0 + 4 * first, bytes)?)
    }
}

impl Driver for Pca9685 {
    const NEW: Self = Self;
    const READS: bool = false;

    /// A chip has a prescaler in its range.
    fn probe<B: Bus>(registers: Registers<'_, B>) -> bool {
        registers.answers(register::MODE1, Width::Bits8)
            && registers
                .read8(register::PRE_SCALE)
                .is_ok_and(|steps| steps >= 3)
    }

    /// Outputs are off and the chip sleeps.
    fn init<B: Bus>(&self, registers: Registers<'_, B>) -> Result<(), B::Error> {
        self.close(registers)
    }

    fn open<B: Bus>(&self, registers: Registers<'_, B>) -> Result<(), B::Error> {
        registers.write8(register::MODE1, mode1::AWAKE)
    }

    fn close<B: Bus>(&self, registers: Registers<'_, B>) -> Result<(), B::Error> {
        let [_, off] = FULL.to_le_bytes();
        registers.write8(register::ALL_LED_OFF_H, off)?;
        registers.write8(register::MODE1, mode1::AWAKE | mode1::SLEEP)
    }

    fn write<B: Bus>(
        &self,
        registers: Registers<'_, B>,
        from: &[u8],
    ) -> Result<usize, DeviceError<B::Error>> {
        let (pairs, _) = from.as_chunks::<2>();
        if pairs.is_empty() {
            let bytes = from.len();
            return Err(DeviceError::Length { bytes, unit: 2 });
        }
        let mut duties = [0; Self::CHANNELS];
        let mut count = 0;
        for (duty, pair) in duties.iter_mut().zip(pairs) {
            *duty = u16::from_ne_bytes(*pair);
            count += 1;
        }
        let duties = duties.get(..count).unwrap_or_default();
        self.set_duties(registers, 0, duties)?;
        Ok(2 * count)
    }

    fn write_ready<B: Bus>(&self, _: Registers<'_, B>) -> Result<bool, B::Error> {
        Ok(true)
    }
}
