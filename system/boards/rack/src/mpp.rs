//! [`Mpp`]: a parallel port board, the example of the memo (section 3.1).

use core::sync::atomic::{AtomicBool, Ordering::Relaxed};

use crate::identifies_as;
use condor_dev::{Attention, Bus, Count, DeviceError, Driver, Registers, Ring, ShadowRegister};

/// The driver of a parallel port board with sixteen input and sixteen output lines. It transfers
/// either bytes with a handshake, or the states of all lines at once.
///
/// | offset | width | access | register |
/// |---|---|---|---|
/// | 0x00 | 16 | read | identification, 0x3b70 |
/// | 0x02 | 16 | both | control: bit 0 interrupt on input, bit 1 raw 16-bit mode, bit 15 resets the board and clears itself |
/// | 0x04 | 16 | both | status: bit 0 input, bit 1 output ready, bit 2 overrun (a one clears it), bit 3 interrupting |
/// | 0x07 | 8 | both | 8-bit mode: reading takes a byte from the 16 that the board keeps, writing strobes one out |
/// | 0x08 | 16 | both | the lines: reading returns the input lines at this moment, writing drives the output lines |
///
/// In 8-bit mode, which is the mode after a reset, the input strobe latches a byte and interrupts.
/// The interrupt handler moves bytes to a buffer of 256 bytes, from which `read` takes them. While
/// the buffer is full, the board keeps its bytes and does not interrupt; bytes for which the board
/// has no room are lost, and the board reports an overrun. `write` strobes out as many bytes as the
/// board is ready for. Only `write_16bits` drives the upper eight lines.
///
/// In raw 16-bit mode `read` and `write` transfer words, two bytes each in the byte order of the
/// processor, and always succeed at once; nothing interrupts and nothing is buffered.
///
/// For a board without an interrupt in its location, call [`poll`](Self::poll) regularly.
#[derive(Debug)]
pub struct Mpp {
    input: Ring<256>,
    control: ShadowRegister,
    open: AtomicBool,
    raw: AtomicBool,
    overruns: Count,
}

const IDENTIFICATION: u16 = 0x3b70;

mod offset {
    pub(super) const CONTROL: usize = 0x02;
    pub(super) const STATUS: usize = 0x04;
    pub(super) const BYTE: usize = 0x07;
    pub(super) const LINES: usize = 0x08;
}

mod control {
    pub(super) const INTERRUPT: u16 = 1 << 0;
    pub(super) const RAW: u16 = 1 << 1;
    pub(super) const RESET: u16 = 1 << 15;
}

mod status {
    pub(super) const INPUT: u16 = 1 << 0;
    pub(super) const OUTPUT_READY: u16 = 1 << 1;
    pub(super) const OVERRUN: u16 = 1 << 2;
    pub(super) const INTERRUPTING: u16 = 1 << 3;
}

/// Bytes that one interrupt takes from the board; it interrupts again for more.
const AT_ONCE: usize = 32;

impl Mpp {
    /// Brings the control register in line with the driver's state; says whether it was not.
    fn settle<B: Bus>(&self, registers: Registers<'_, B>) -> Result<bool, B::Error> {
        let wanted = || {
            let raw = self.raw.load(Relaxed);
            let listens = self.open.load(Relaxed) && !raw && !self.input.is_full();
            let mode = if raw { control::RAW } else { 0 };
            mode | if listens { control::INTERRUPT } else { 0 }
        };
        let write = |value| registers.write16(offset::CONTROL, value);
        self.control.update(wanted, write)
    }

    /// Resets the board to 8-bit mode with all outputs low. Input that was not read is lost.
    ///
    /// # Errors
    /// Returns the bus's error if an access fails.
    pub fn reset<B: Bus>(&self, registers: Registers<'_, B>) -> Result<(), B::Error> {
        critical_section::with(|_| {
            self.control.forget();
            registers.write16(offset::CONTROL, control::RESET)?;
            self.raw.store(false, Relaxed);
            if let Some(mut reader) = self.input.reader() {
                reader.clear();
            }
            self.settle(registers).map(drop)
        })
    }

    fn set_raw<B: Bus>(&self, registers: Registers<'_, B>, raw: bool) -> Result<(), B::Error> {
        critical_section::with(|_| {
            let before = self.raw.load(Relaxed);
            self.raw.store(raw, Relaxed);
            let settled = self.settle(registers).map(drop);
            if settled.is_err() {
                self.raw.store(before, Relaxed);
            }
            settled
        })
    }

    /// Serves the board, and says whether it wanted something: one that goes on interrupting with
    /// nothing to give, and though it has been told not to, does not get attention.
    fn serve<B: Bus>(&self, registers: Registers<'_, B>) -> Result<bool, B::Error> {
        let collected = self.collect(registers);
        let settled = self.settle(registers);
        Ok(collected? | settled?)
    }

    /// Takes what the board has, and says whether it had something.
    fn collect<B: Bus>(&self, registers: Registers<'_, B>) -> Result<bool, B::Error> {
        let Some(mut writer) = self.input.writer() else {
            // The context that this one interrupted is about to take it.
            return Ok(false);
        };
        let mut collected = false;
        let mut status = registers.read16(offset::STATUS)?;
        if status & status::OVERRUN != 0 {
            registers.write16(offset::STATUS, status::OVERRUN)?;
            self.overruns.add();
            collected = true;
        }
        for _ in 0..writer.room().min(AT_ONCE) {
            if status & status::INPUT == 0 {
                break;
            }
            writer.push(registers.read8(offset::BYTE)?);
            collected = true;
            status = registers.read16(offset::STATUS)?;
        }
        Ok(collected)
    }

    fn write_words<B: Bus>(
        registers: Registers<'_, B>,
        from: &[u8],
    ) -> Result<usize, DeviceError<B::Error>> {
        let (words, _) = from.as_chunks::<2>();
        each(words, 2, from.len(), |word| {
            registers.write16(offset::LINES, u16::from_ne_bytes(*word))?;
            Ok(true)
        })
    }
}

/// Transfers items of `unit` bytes until `transfer` fails or has no more items, and returns the
/// number of bytes that were transferred; bytes transferred before a failure count.
fn each<T, E>(
    items: impl IntoIterator<Item = T>,
    unit: usize,
    bytes: usize,
    mut transfer: impl FnMut(T) -> Result<bool, E>,
) -> Result<usize, DeviceError<E>> {
    if bytes < unit {
        return Err(DeviceError::Length { bytes, unit });
    }
    let mut transferred = 0;
    for item in items {
        match transfer(item) {
            Ok(true) => transferred += unit,
            Err(error) if transferred == 0 => return Err(DeviceError::Bus(error)),
            Ok(false) | Err(_) => break,
        }
    }
    if transferred == 0 {
        return Err(DeviceError::WouldBlock);
    }
    Ok(transferred)
}

impl Driver for Mpp {
    const NEW: Self = Self {
        input: Ring::new(),
        control: ShadowRegister::new(),
        open: AtomicBool::new(false),
        raw: AtomicBool::new(false),
        overruns: Count::new(),
    };

    fn probe<B: Bus>(registers: Registers<'_, B>) -> bool {
        identifies_as(registers, IDENTIFICATION)
    }

    fn init<B: Bus>(&self, registers: Registers<'_, B>) -> Result<(), B::Error> {
        self.open.store(false, Relaxed);
        self.reset(registers)
    }

    fn open<B: Bus>(&self, registers: Registers<'_, B>) -> Result<(), B::Error> {
        self.open.store(true, Relaxed);
        let reset = self.reset(registers);
        if reset.is_err() {
            self.open.store(false, Relaxed);
        }
        reset
    }

    fn close<B: Bus>(&self, registers: Registers<'_, B>) -> Result<(), B::Error> {
        self.open.store(false, Relaxed);
        self.settle(registers).map(drop)
    }

    fn read<B: Bus>(
        &self,
        registers: Registers<'_, B>,
        into: &mut [u8],
    ) -> Result<usize, DeviceError<B::Error>> {
        if self.raw.load(Relaxed) {
            let bytes = into.len();
            let (words, _) = into.as_chunks_mut::<2>();
            return each(words, 2, bytes, |word| {
                *word = registers.read16(offset::LINES)?.to_ne_bytes();
                Ok(true)
            });
        }
        let mut reader = self.input.reader().ok_or(DeviceError::WouldBlock)?;
        DeviceError::unless_moved(reader.read(into), self.settle(registers))
    }

    fn write<B: Bus>(
        &self,
        registers: Registers<'_, B>,
        from: &[u8],
    ) -> Result<usize, DeviceError<B::Error>> {
        if self.raw.load(Relaxed) {
            return Self::write_words(registers, from);
        }
        each(from, 1, from.len(), |byte| {
            // Another context that writes here would find the same place free.
            critical_section::with(|_| {
                let ready = registers.read16(offset::STATUS)? & status::OUTPUT_READY != 0;
                if ready {
                    registers.write8(offset::BYTE, *byte)?;
                }
                Ok(ready)
            })
        })
    }

    fn is_flushed<B: Bus>(&self, registers: Registers<'_, B>) -> Result<bool, B::Error> {
        self.write_ready(registers)
    }

    fn read_ready<B: Bus>(&self, registers: Registers<'_, B>) -> Result<bool, B::Error> {
        if self.raw.load(Relaxed) || !self.input.is_empty() {
            return Ok(true);
        }
        self.settle(registers)?;
        Ok(false)
    }

    fn write_ready<B: Bus>(&self, registers: Registers<'_, B>) -> Result<bool, B::Error> {
        if self.raw.load(Relaxed) {
            return Ok(true);
        }
        Ok(registers.read16(offset::STATUS)? & status::OUTPUT_READY != 0)
    }

    fn interrupt<B: Bus>(&self, registers: Registers<'_, B>) -> Result<Attention, B::Error> {
        if registers.read16(offset::STATUS)? & status::INTERRUPTING == 0 {
            return Ok(Attention::NotMine);
        }
        Ok(if self.serve(registers)? {
            Attention::Mine
        } else {
            Attention::NotMine
        })
    }
}

impl Mpp {
    /// Sets the 8-bit mode, in which `read` and `write` transfer bytes with a handshake.
    ///
    /// # Errors
    /// Returns the bus's error if the access fails; the board stays in its mode then.
    pub fn config_8bit<B: Bus>(&self, registers: Registers<'_, B>) -> Result<(), B::Error> {
        self.set_raw(registers, false)
    }

    /// Sets the raw 16-bit mode, in which `read` and `write` transfer the states of all sixteen
    /// lines at once.
    ///
    /// # Errors
    /// Returns the bus's error if the access fails; the board stays in its mode then.
    pub fn config_16bit_raw<B: Bus>(&self, registers: Registers<'_, B>) -> Result<(), B::Error> {
        self.set_raw(registers, true)
    }

    /// Returns the state of the sixteen input lines at this moment, in either mode; bit *n* is line
    /// *n*.
    ///
    /// # Errors
    /// Returns the bus's error if the access fails.
    #[inline]
    pub fn read_16bits<B: Bus>(&self, registers: Registers<'_, B>) -> Result<u16, B::Error> {
        registers.read16(offset::LINES)
    }

    /// Drives the output lines: bit *n* of `lines` is line *n*. In 8-bit mode only the upper eight
    /// lines change.
    ///
    /// # Errors
    /// Returns the bus's error if the access fails.
    #[inline]
    pub fn write_16bits<B: Bus>(
        &self,
        registers: Registers<'_, B>,
        lines: u16,
    ) -> Result<(), B::Error> {
        registers.write16(offset::LINES, lines)
    }

    /// Returns how many times the board reported an overrun, which is input for which it had no
    /// room; wraps.
    #[must_use]
    pub fn overruns(&self) -> u32 {
        self.overruns.get()
    }

    /// Does the work of the interrupt handler. Call it regularly for a board that does not
    /// interrupt.
    ///
    /// # Errors
    /// Returns the bus's error if an access fails.
    pub fn poll<B: Bus>(&self, registers: Registers<'_, B>) -> Result<(), B::Error> {
        critical_section::with(|_| self.serve(registers)).map(drop)
    }
}
