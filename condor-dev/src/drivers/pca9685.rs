//! [`Pca9685`]: a chip with 16 outputs of pulse-width modulation.

use crate::bus::{Bus, Registers, Width};
use crate::driver::{DeviceError, Driver};

/// The driver of the PCA9685: 16 outputs of pulse-width modulation for servos and LEDs, each with a duty of 12 bits,
/// all with one frequency. Its pins set its I2C address, from 0x40 to 0x77. Registers and bits are those of section 7.3
/// of NXP's data sheet, revision 4 of 2015.
///
/// The chip has no identification. The probe only reads. It takes a part for a PCA9685 if reserved bits read as 0, the
/// registers that set all channels at once read as 0, the prescaler is in its range, and a read of two bytes goes on to
/// the next register only if the bit for that is set. It cannot tell a PCA9685 from a part that reads the same in all
/// of this.
///
/// All chips of a bus answer at 0x70 after power-on, so that address is refused as a location. A chip may also answer
/// at addresses that a former program set. `init` ends that; a board that was found only by such an address is
/// [`Failed`](crate::Presence::Failed) afterwards, because it no longer answers there.
///
/// `init` switches all outputs off and lets the chip sleep. Outputs are then not inverted, have totem-pole drivers, and
/// change at the end of a transfer. The chip answers only at its own address, and has the prescaler of power-on (200
/// Hz). One setting remains: an external clock, which only power-on or a software reset ends.
/// [`set_frequency`](Self::set_frequency) reports it. The driver never sends that reset (0x06 to address 0), since it
/// resets every chip of the bus that knows the call, also chips that other programs use. A program may send it before
/// it starts its switch.
///
/// Opening the chip wakes it; closing it switches all outputs off and lets it sleep. `write` sets the duties of the
/// first channels, two bytes each, in the byte order of the processor, as [`set_duties`](Self::set_duties) does.
/// Outputs change at the end of the transfer.
///
/// The oscillator needs 500 µs to start after the open; no timing of an output that is set before is
/// guaranteed (data sheet, section 7.3.1).
#[derive(Debug)]
pub struct Pca9685;

/// The clock that a PCA9685 runs on, with the frequency of the clock in hertz.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChipClock {
    /// The internal oscillator. Chips differ by several percent from [`NOMINAL`](Self::NOMINAL). To measure the clock
    /// of a chip, set a frequency with the nominal clock, and measure the frequency of an output: that of the clock is
    /// 4096 · (`PRE_SCALE` + 1) times as high.
    Internal(u32),
    /// A clock at the pin EXTCLK, of at most 50 MHz.
    External(u32),
}

impl ChipClock {
    /// The internal oscillator, with its nominal frequency of 25 MHz from the data sheet.
    pub const NOMINAL: Self = Self::Internal(25_000_000);
}

/// The reason why [`Pca9685::set_frequency`] did not set the frequency.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ClockError<E> {
    /// The call named the internal oscillator, but the chip runs on its external clock.
    #[error(
        "the PCA9685 runs on its external clock, which an earlier program selected; switch its power off and on, or \
         pass `ChipClock::External` with the frequency of that clock"
    )]
    External,
    /// The bus returned this error.
    #[error("{0}")]
    Bus(E),
}

impl<E> From<E> for ClockError<E> {
    fn from(error: E) -> Self {
        Self::Bus(error)
    }
}

/// The register summary of section 7.3.
mod register {
    pub(super) const MODE1: usize = 0x00;
    pub(super) const MODE2: usize = 0x01;
    /// The first of the four other addresses of the chip.
    pub(super) const SUBADR1: usize = 0x02;
    /// On and off counts of the first channel, four registers each: low and high byte.
    pub(super) const LED0: usize = 0x06;
    /// The same for all channels at once: four registers that read as 0.
    pub(super) const ALL_LED: usize = 0xfa;
    /// A bit of FULL in it is the orderly shutdown of 7.3.1.1.
    pub(super) const ALL_LED_OFF_H: usize = 0xfd;
    pub(super) const PRE_SCALE: usize = 0xfe;
}

/// Bits of MODE1 (section 7.3.1).
mod mode1 {
    pub(super) const RESTART: u8 = 1 << 7;
    /// Sticky: a zero does not clear it.
    pub(super) const EXTERNAL_CLOCK: u8 = 1 << 6;
    pub(super) const AUTO_INCREMENT: u8 = 1 << 5;
    pub(super) const SLEEP: u8 = 1 << 4;
    /// The mode of a chip that this driver uses: it has no other addresses.
    pub(super) const AWAKE: u8 = AUTO_INCREMENT;
}

/// The bit of a high byte that has the output be on, or off, all the time; off goes before on
/// (section 7.3.3).
const FULL: u16 = 1 << 12;
/// MODE2 after power-on (section 7.3.2): totem-pole drivers, not inverted, changed by the end of a
/// transfer.
const MODE2: u8 = 1 << 2;
/// Bits of MODE2 that are reserved.
const MODE2_RESERVED: u8 = 0xe0;
/// Bits of the high bytes of counts that are reserved.
const COUNT_RESERVED: u8 = 0xe0;
/// SUBADR1 to ALLCALLADR after power-on; their lowest bits read as 0.
const OTHER_ADDRESSES: [u8; 4] = [0xe2, 0xe4, 0xe8, 0xe0];
/// The prescaler after power-on.
const PRE_SCALE: u8 = 0x1e;

impl Pca9685 {
    /// The number of outputs of a chip.
    pub const CHANNELS: usize = 16;
    /// The number of counts in a cycle of the outputs. An output with this duty is on all the time.
    pub const CYCLE: u16 = 4096;

    /// Sets the frequency of all outputs to the possible frequency that is nearest to `hertz`, and returns it in hertz.
    /// `clock` is the clock that the chip must use, with its frequency.
    ///
    /// A possible frequency is that of the clock divided by 4096 · (`PRE_SCALE` + 1), with a prescaler from 3 to 255:
    /// with 25 MHz, from 24 Hz to 1526 Hz (data sheet, section 7.3.5). The chip sleeps while the prescaler is set, so
    /// outputs are off for that long, and then go on as they were. Its oscillator needs 500 µs to start, in which the
    /// outputs are not right yet.
    ///
    /// After [`ChipClock::External`] the chip uses its external clock until its power is switched off.
    ///
    /// # Errors
    /// [`ClockError::External`] if `clock` is internal, but the chip runs on its external clock; nothing has changed
    /// then. [`ClockError::Bus`] if an access fails; the chip may sleep then, so set the frequency again.
    pub fn set_frequency<B: Bus>(
        &self,
        registers: Registers<'_, B>,
        clock: ChipClock,
        hertz: u16,
    ) -> Result<u16, ClockError<B::Error>> {
        let asleep = mode1::AWAKE | mode1::SLEEP;
        let is_external = registers.read8(register::MODE1)? & mode1::EXTERNAL_CLOCK != 0;
        let clock = match clock {
            ChipClock::Internal(_) if is_external => return Err(ClockError::External),
            ChipClock::Internal(clock) => {
                registers.write8(register::MODE1, asleep)?;
                clock
            }
            ChipClock::External(clock) => {
                // The chip changes its clock only if it slept before.
                registers.write8(register::MODE1, asleep)?;
                registers.write8(register::MODE1, asleep | mode1::EXTERNAL_CLOCK)?;
                clock
            }
        };
        let cycle = u32::from(Self::CYCLE);
        let rounded = |divisor| clock.saturating_add(divisor / 2) / divisor;
        let steps = rounded(cycle * u32::from(hertz.max(1))).clamp(4, 256);
        registers.write8(register::PRE_SCALE, (steps - 1) as u8)?;
        Self::wake(registers)?;
        Ok(rounded(cycle * steps).min(u16::MAX.into()) as u16)
    }

    /// Reads whether all bits are as those of a chip must be; see [`Pca9685`].
    fn looks_like_it<B: Bus>(registers: Registers<'_, B>) -> Result<bool, B::Error> {
        let is = |register, bits: u8| Ok(registers.read8(register)? & bits == 0);
        if registers.read8(register::PRE_SCALE)? < 3 || !is(register::MODE2, MODE2_RESERVED)? {
            return Ok(false);
        }
        // One at a time: a chip that does not advance its register number returns one of them again.
        for other in 0..OTHER_ADDRESSES.len() {
            if !is(register::SUBADR1 + other, 1)? || !is(register::ALL_LED + other, 0xff)? {
                return Ok(false);
            }
        }
        for high in (register::LED0..)
            .skip(1)
            .step_by(2)
            .take(2 * Self::CHANNELS)
        {
            if !is(high, COUNT_RESERVED)? {
                return Ok(false);
            }
        }
        let mut block = [0; 2];
        registers.read_block(register::MODE1, &mut block)?;
        let [mode1, next] = block;
        let second = if mode1 & mode1::AUTO_INCREMENT == 0 {
            register::MODE1
        } else {
            register::MODE2
        };
        Ok(next == registers.read8(second)?)
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

    /// Sets the duties of the channels from number `first` on, in order. A duty is the number of counts, of the 4096 in
    /// a cycle, for which the output is on: 0 is off, and [`CYCLE`](Self::CYCLE) or more is on all the time. All duties
    /// are sent in one transfer.
    ///
    /// # Errors
    /// [`DeviceError::Length`] if there are more duties than channels from `first` on, [`DeviceError::Bus`] if the bus
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

    /// 0x40 to 0x77, but for the address of all chips after power-on.
    const I2C_ADDRESSES: u128 = (1 << 0x78) - (1 << 0x40) - (1 << 0x70);

    fn probe<B: Bus>(registers: Registers<'_, B>) -> bool {
        registers.answers(register::MODE1, Width::Bits8)
            && Self::looks_like_it(registers).unwrap_or(false)
    }

    fn init<B: Bus>(&self, registers: Registers<'_, B>) -> Result<(), B::Error> {
        registers.write8(register::MODE2, MODE2)?;
        // The chip advances its register number and forgets its other addresses from here on.
        self.close(registers)?;
        registers.write_block(register::SUBADR1, &OTHER_ADDRESSES)?;
        let [low, high] = FULL.to_le_bytes();
        registers.write_block(register::ALL_LED, &[0, 0, low, high])?;
        registers.write8(register::PRE_SCALE, PRE_SCALE)
    }

    /// Also ends a restart that a former program left due; all outputs are off.
    fn open<B: Bus>(&self, registers: Registers<'_, B>) -> Result<(), B::Error> {
        Self::wake(registers)
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
