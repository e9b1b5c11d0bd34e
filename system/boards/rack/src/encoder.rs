//! [`Encoder8`]: a board that counts the pulses of quadrature encoders.

use crate::identifies_as;
use condor_dev::{Bus, Count, DeviceError, Driver, Registers};

/// The driver of a board with eight quadrature counters of 32 bits, which wrap.
///
/// | offset | width | access | register |
/// |---|---|---|---|
/// | 0x00 | 16 | read | identification, 0xe4c0 |
/// | 0x02 | 16 | write | latch: copies the counters named by bits to their latches, at the same instant |
/// | 0x04 | 16 | write | zero: sets the counters named by bits to zero |
/// | 0x06 | 16 | both | counters named by bits are set to zero by their next index pulse, which clears the bit |
/// | 0x08 | 16 | both | index pulses seen since cleared by a one, a bit for each counter |
/// | 0x0a | 16 | both | both phases changed at once, pulses were missed; as the index pulses |
/// | 0x20 + 4·*n* | 32 | read | latch of counter *n* |
///
/// `read` latches all counters and returns them in order, four bytes each in the byte order of the
/// processor. The counts of one call are of the same instant.
#[derive(Debug)]
pub struct Encoder8 {
    /// Scans begun: one that another interrupted notices.
    scans: Count,
}

const IDENTIFICATION: u16 = 0xe4c0;
const ALL: u16 = 0xff;
/// The number of times that a scan is begun that others interrupt.
const ATTEMPTS: u32 = 4;

mod offset {
    pub(super) const LATCH: usize = 0x02;
    pub(super) const ZERO: usize = 0x04;
    pub(super) const ZERO_AT_INDEX: usize = 0x06;
    pub(super) const INDEX: usize = 0x08;
    pub(super) const MISSED: usize = 0x0a;
    pub(super) const COUNTS: usize = 0x20;
}

impl Encoder8 {
    /// The number of counters of a board.
    pub const COUNTERS: usize = 8;

    /// Latches, and shows the first `count` counters to `see`, perhaps more than once.
    #[inline(always)]
    fn scan_each<B: Bus>(
        &self,
        registers: Registers<'_, B>,
        count: usize,
        mut see: impl FnMut(usize, i32),
    ) -> Result<(), DeviceError<B::Error>> {
        for _ in 0..ATTEMPTS {
            let scan = self.scans.add();
            registers.write16(offset::LATCH, ALL)?;
            for counter in 0..count.min(Self::COUNTERS) {
                let value = registers.read32(offset::COUNTS + 4 * counter)?;
                see(counter, value.cast_signed());
            }
            // An interrupting scan latched other counts, which some of these may be.
            if self.scans.get() == scan {
                return Ok(());
            }
        }
        Err(DeviceError::WouldBlock)
    }

    /// Reads bits that a one clears, and clears those that were read.
    fn take<B: Bus>(registers: Registers<'_, B>, offset: usize) -> Result<u8, B::Error> {
        let bits = registers.read16(offset)?;
        if bits != 0 {
            registers.write16(offset, bits)?;
        }
        Ok(bits as u8)
    }
}

impl Driver for Encoder8 {
    const NEW: Self = Self {
        scans: Count::new(),
    };
    const WRITES: bool = false;

    fn probe<B: Bus>(registers: Registers<'_, B>) -> bool {
        identifies_as(registers, IDENTIFICATION)
    }

    /// Counters keep their counts: a robot may have been homed before the program began.
    fn init<B: Bus>(&self, registers: Registers<'_, B>) -> Result<(), B::Error> {
        registers.write16(offset::ZERO_AT_INDEX, 0)?;
        registers.write16(offset::INDEX, ALL)?;
        registers.write16(offset::MISSED, ALL)
    }

    fn close<B: Bus>(&self, registers: Registers<'_, B>) -> Result<(), B::Error> {
        registers.write16(offset::ZERO_AT_INDEX, 0)
    }

    fn read<B: Bus>(
        &self,
        registers: Registers<'_, B>,
        into: &mut [u8],
    ) -> Result<usize, DeviceError<B::Error>> {
        let bytes = into.len();
        let (counts, _) = into.as_chunks_mut::<4>();
        if counts.is_empty() {
            return Err(DeviceError::Length { bytes, unit: 4 });
        }
        let count = counts.len().min(Self::COUNTERS);
        self.scan_each(registers, count, |counter, value| {
            if let Some(place) = counts.get_mut(counter) {
                *place = value.to_ne_bytes();
            }
        })?;
        Ok(4 * count)
    }

    fn read_ready<B: Bus>(&self, _: Registers<'_, B>) -> Result<bool, B::Error> {
        Ok(true)
    }
}

impl Encoder8 {
    /// Reads the counters from 0 on into `into`, until `into` is full or all counters are read. All counts are of the
    /// same instant. Returns the number of counts.
    ///
    /// # Errors
    /// [`DeviceError::Bus`] if an access fails; [`DeviceError::WouldBlock`] if faster loops interrupted
    /// this scan by scans of their own four times in a row. `into` may have been written in part.
    #[inline]
    pub fn scan<B: Bus>(
        &self,
        registers: Registers<'_, B>,
        into: &mut [i32],
    ) -> Result<usize, DeviceError<B::Error>> {
        let count = into.len().min(Encoder8::COUNTERS);
        self.scan_each(registers, count, |counter, value| {
            if let Some(place) = into.get_mut(counter) {
                *place = value;
            }
        })?;
        Ok(count)
    }

    /// Returns the number of pulses by which each counter has moved since its count in `last`, and sets `last` to the
    /// present counts.
    ///
    /// A counter may have wrapped meanwhile, but must not have moved by 2³¹ pulses or more.
    ///
    /// # Errors
    /// [`DeviceError::Bus`] if an access fails; [`DeviceError::WouldBlock`] if faster loops interrupted the
    /// scan by scans of their own four times in a row. `last` is unchanged then.
    #[inline]
    pub fn scan_differences<B: Bus>(
        &self,
        registers: Registers<'_, B>,
        last: &mut [i32; Encoder8::COUNTERS],
    ) -> Result<[i32; Encoder8::COUNTERS], DeviceError<B::Error>> {
        let mut now = [0; Encoder8::COUNTERS];
        self.scan(registers, &mut now)?;
        let mut moved = [0; Encoder8::COUNTERS];
        for ((moved, now), last) in moved.iter_mut().zip(now).zip(last) {
            *moved = now.wrapping_sub(*last);
            *last = now;
        }
        Ok(moved)
    }

    /// Sets counters to zero at once: bit *n* of `counters` stands for counter *n*.
    ///
    /// # Errors
    /// Returns the bus's error if the access fails.
    pub fn zero<B: Bus>(&self, registers: Registers<'_, B>, counters: u8) -> Result<(), B::Error> {
        registers.write16(offset::ZERO, counters.into())
    }

    /// Selects the counters that their next index pulse sets to zero: bit *n* of `counters` stands for counter *n*.
    /// Each counter does so once. The call replaces the previous selection.
    ///
    /// # Errors
    /// Returns the bus's error if the access fails.
    pub fn zero_at_index<B: Bus>(
        &self,
        registers: Registers<'_, B>,
        counters: u8,
    ) -> Result<(), B::Error> {
        registers.write16(offset::ZERO_AT_INDEX, counters.into())
    }

    /// Returns the counters whose index pulse came since the last call: bit *n* stands for counter *n*.
    ///
    /// # Errors
    /// Returns the bus's error if an access fails; the next call reports these pulses, too.
    pub fn take_index<B: Bus>(&self, registers: Registers<'_, B>) -> Result<u8, B::Error> {
        Encoder8::take(registers, offset::INDEX)
    }

    /// Returns the counters that missed pulses since the last call: bit *n* stands for counter *n*. Their counts are
    /// wrong until they are set to zero.
    ///
    /// # Errors
    /// Returns the bus's error if an access fails; the next call reports these counters, too.
    pub fn take_missed<B: Bus>(&self, registers: Registers<'_, B>) -> Result<u8, B::Error> {
        Encoder8::take(registers, offset::MISSED)
    }
}
