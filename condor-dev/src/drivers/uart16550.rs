//! [`Uart16550`]: the serial port of PCs and of most boards since.

use core::num::NonZeroU16;

use uart_16550::spec::registers::{FCR, FifoTriggerLevel, IER, ISR, LCR, LSR, MCR, offsets};

use super::register::{Count, ShadowRegister};
use crate::bus::{Bus, Registers, Width};
use crate::driver::{Attention, DeviceError, Driver};
use crate::ring::Ring;
use crate::sync::{AtomicBool, AtomicU8, Ordering::Relaxed, masked};

/// The driver of a 16550, the serial port of PCs and of many boards.
///
/// `STRIDE` is the distance of its registers in bytes, 1 or 4; they are accessed as bytes. `BUFFER`
/// is the size in bytes of each of the driver's two buffers, one for each direction; it is a power
/// of two. `DIVISOR` sets the speed after `init`, in baud: the frequency of the port's clock in Hz
/// divided by 16 × `DIVISOR`.
///
/// The registers are those of the National Semiconductor PC16550D (data sheet of 1995).
///
/// `read` and `write` move bytes from and to the buffers. The interrupt handler empties one buffer
/// into the board and fills the other from it, a FIFO of 16 bytes at a time; on an 8250 without
/// FIFOs, byte by byte. While the receive buffer is full, the driver leaves bytes in the FIFO and
/// disables the interrupt for them. A byte that `write` accepted is sent, even across errors of the
/// bus and across a close. If it cannot be passed to the board now, the next call of any kind tries
/// again; [`is_flushed`](crate::Switch::is_flushed) returns the error, if there is one. A byte that
/// the board received is read once, whatever its errors, which are counted: see
/// [`line_errors`](Self::line_errors). Opening the port discards bytes that were not read.
///
/// `init` sets 8 bits, no parity, one stop bit and the speed. The default divisor of 1 is 115 200
/// baud with the 1.8432 MHz of a PC. It also clears and enables the FIFOs, disables all interrupts,
/// ends a loop-back, and raises DTR, RTS and OUT2; so nothing that a former program set is left, but
/// the scratch register. [`configure`](Self::configure) sets another speed and format.
///
/// The probe only reads. It takes a board for a 16550 if the bits that are always 0 read as 0, and
/// if the reported interrupt is an enabled one. So memory that reads as zeros or as ones is not
/// taken for a 16550. It cannot tell the members of the family apart; `init` finds out whether
/// there are FIFOs.
#[derive(Debug)]
pub struct Uart16550<const STRIDE: usize = 1, const BUFFER: usize = 256, const DIVISOR: u16 = 1> {
    received: Ring<BUFFER>,
    to_send: Ring<BUFFER>,
    interrupts: ShadowRegister,
    line: ShadowRegister,
    format: AtomicU8,
    open: AtomicBool,
    /// The board may have forgotten that it was to tell when it can send: told so, it says it again.
    stalled: AtomicBool,
    /// Bytes that an empty transmitter takes.
    fifo: AtomicU8,
    overruns: Count,
    parity: Count,
    framing: Count,
    breaks: Count,
}

/// The format of the characters on a serial line: numbers of data and stop bits, and parity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Format(LCR);

impl Format {
    /// Eight data bits, no parity, one stop bit.
    pub const EIGHT_BITS: Self = Self(LCR::WORD_LENGTH0.union(LCR::WORD_LENGTH1));
    /// Seven data bits, no parity, one stop bit.
    pub const SEVEN_BITS: Self = Self(LCR::WORD_LENGTH1);

    /// Returns this format with odd parity.
    #[must_use]
    pub const fn odd(self) -> Self {
        Self(self.0.difference(LCR::PARITY1).union(LCR::PARITY0))
    }

    /// Returns this format with even parity.
    #[must_use]
    pub const fn even(self) -> Self {
        Self(self.0.union(LCR::PARITY0).union(LCR::PARITY1))
    }

    /// Returns this format with two stop bits.
    #[must_use]
    pub const fn two_stop_bits(self) -> Self {
        Self(self.0.union(LCR::MORE_STOP_BITS))
    }
}

/// Counts of the errors that a [`Uart16550`] has met on its serial line. The counts wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LineErrors {
    /// The number of times (not of bytes) that the board had no room for a received byte.
    pub overruns: u32,
    /// The number of bytes with wrong parity.
    pub parity: u32,
    /// The number of bytes without a stop bit.
    pub framing: u32,
    /// The number of times that the line was held low; each also reads as a zero.
    pub breaks: u32,
}

/// Bytes that one interrupt takes from the board; it interrupts again for more.
const AT_ONCE: usize = 64;
/// Reasons that one interrupt is served for; the board interrupts again for more.
const ROUNDS: u32 = 4;

/// The way in which the FIFOs are run: an interrupt for 8 received bytes, or for fewer that wait for 4
/// characters.
const FIFOS: FCR = FCR::FIFO_ENABLE.set_fifo_trigger_level(FifoTriggerLevel::Eight);

impl<const STRIDE: usize, const BUFFER: usize, const DIVISOR: u16>
    Uart16550<STRIDE, BUFFER, DIVISOR>
{
    const SPEED: NonZeroU16 = NonZeroU16::new(DIVISOR).expect("the divisor is 1 or more");
    const STRIDE_IS_KNOWN: () = assert!(STRIDE == 1 || STRIDE == 4, "the stride is 1 or 4 bytes");

    #[inline(always)]
    fn get<B: Bus>(registers: Registers<'_, B>, register: usize) -> Result<u8, B::Error> {
        let () = Self::STRIDE_IS_KNOWN;
        registers.read8(register * STRIDE)
    }

    #[inline(always)]
    fn put<B: Bus>(
        registers: Registers<'_, B>,
        register: usize,
        value: u8,
    ) -> Result<(), B::Error> {
        registers.write8(register * STRIDE, value)
    }

    /// Restores the meaning of the first two registers, if setting the speed was broken off.
    fn restore_line<B: Bus>(&self, registers: Registers<'_, B>) -> Result<(), B::Error> {
        let write = |value: u16| Self::put(registers, offsets::LCR, value as u8);
        let wanted = || self.format.load(Relaxed).into();
        self.line.update(wanted, write).map(drop)
    }

    /// Brings the enabled interrupts in line with the buffers; says whether they were not.
    fn settle<B: Bus>(&self, registers: Registers<'_, B>) -> Result<bool, B::Error> {
        let wanted = |sends: bool| {
            let mut wanted = IER::empty();
            let open = self.open.load(Relaxed);
            wanted.set(IER::DATA_READY, open && !self.received.is_full());
            wanted.set(IER::THR_EMPTY, open && sends && !self.to_send.is_empty());
            u16::from(wanted.bits())
        };
        let write = |value: u16| Self::put(registers, offsets::IER, value as u8);
        self.restore_line(registers)?;
        masked(|| {
            if self.stalled.load(Relaxed) {
                self.interrupts.update(|| wanted(false), write)?;
                self.stalled.store(false, Relaxed);
            }
            self.interrupts.update(|| wanted(true), write)
        })
    }

    /// Reads the line status, which forgets its errors: they are counted here.
    fn line_status<B: Bus>(&self, registers: Registers<'_, B>) -> Result<LSR, B::Error> {
        let status = LSR::from_bits_retain(Self::get(registers, offsets::LSR)?);
        for (error, count) in [
            (LSR::OVERRUN_ERROR, &self.overruns),
            (LSR::PARITY_ERROR, &self.parity),
            (LSR::FRAMING_ERROR, &self.framing),
            (LSR::BREAK_INTERRUPT, &self.breaks),
        ] {
            if status.contains(error) {
                count.add();
            }
        }
        Ok(status)
    }

    /// Moves bytes both ways, and says whether there was anything to do.
    fn serve<B: Bus>(&self, registers: Registers<'_, B>) -> Result<bool, B::Error> {
        self.restore_line(registers)?;
        let received = self.receive(registers);
        let sent = self.send(registers);
        let settled = self.settle(registers);
        Ok(received? | sent? | settled?)
    }

    /// Serves the board for as long as it says that it interrupts.
    fn attend<B: Bus>(&self, registers: Registers<'_, B>) -> Result<Attention, B::Error> {
        let mut attention = Attention::NotMine;
        for _ in 0..ROUNDS {
            let reason = ISR::from_bits_retain(Self::get(registers, offsets::ISR)?);
            // A board that goes on interrupting though nothing is to be done does not get attention.
            if !reason.has_pending_interrupt() || !self.serve(registers)? {
                break;
            }
            attention = Attention::Mine;
        }
        Ok(attention)
    }

    fn receive<B: Bus>(&self, registers: Registers<'_, B>) -> Result<bool, B::Error> {
        let Some(mut writer) = self.received.writer() else {
            // The context that this one interrupted is about to do it.
            return Ok(false);
        };
        let mut some = false;
        for _ in 0..writer.room().min(AT_ONCE) {
            if !self.line_status(registers)?.contains(LSR::DATA_READY) {
                break;
            }
            writer.push(Self::get(registers, offsets::DATA)?);
            some = true;
        }
        Ok(some)
    }

    fn send<B: Bus>(&self, registers: Registers<'_, B>) -> Result<bool, B::Error> {
        let Some(mut reader) = self.to_send.reader() else {
            return Ok(false);
        };
        if reader.peek().is_none() || !self.line_status(registers)?.contains(LSR::THR_EMPTY) {
            return Ok(false);
        }
        let mut some = false;
        for _ in 0..self.fifo.load(Relaxed) {
            let Some(byte) = reader.peek() else {
                break;
            };
            Self::put(registers, offsets::DATA, byte)?;
            reader.skip();
            some = true;
        }
        Ok(some)
    }

    /// Sets the speed and the format. The speed in baud is the frequency of the board's clock in Hz
    /// divided by 16 × `divisor`. Characters that are sent or received meanwhile are garbled.
    ///
    /// # Errors
    /// Returns the bus's error if an access fails; the speed is unknown then, so set it again.
    pub fn configure<B: Bus>(
        &self,
        registers: Registers<'_, B>,
        divisor: NonZeroU16,
        format: Format,
    ) -> Result<(), B::Error> {
        let [low, high] = divisor.get().to_le_bytes();
        let with_divisor = format.0 | LCR::DLAB;
        // While the divisor is reached, received bytes are not.
        masked(|| {
            self.format.store(format.0.bits(), Relaxed);
            self.line.forget();
            let set = Self::put(registers, offsets::LCR, with_divisor.bits())
                .and_then(|()| Self::put(registers, offsets::DLL, low))
                .and_then(|()| Self::put(registers, offsets::DLM, high));
            let restored = self.restore_line(registers);
            set.and(restored)
        })
    }
}

impl<const STRIDE: usize, const BUFFER: usize, const DIVISOR: u16> Driver
    for Uart16550<STRIDE, BUFFER, DIVISOR>
{
    const NEW: Self = Self {
        received: Ring::new(),
        to_send: Ring::new(),
        interrupts: ShadowRegister::new(),
        line: ShadowRegister::new(),
        format: AtomicU8::new(Format::EIGHT_BITS.0.bits()),
        open: AtomicBool::new(false),
        stalled: AtomicBool::new(false),
        fifo: AtomicU8::new(1),
        overruns: Count::new(),
        parity: Count::new(),
        framing: Count::new(),
        breaks: Count::new(),
    };

    fn probe<B: Bus>(registers: Registers<'_, B>) -> bool {
        let looks_like_it = || {
            let modem = Self::get(registers, offsets::MCR)?;
            let line = LCR::from_bits_retain(Self::get(registers, offsets::LCR)?);
            let enabled = Self::get(registers, offsets::IER)?;
            let reason = ISR::from_bits_retain(Self::get(registers, offsets::ISR)?);
            let status = LSR::from_bits_retain(Self::get(registers, offsets::LSR)?);
            // A transmitter that has sent all has an empty register; FIFOs are enabled by two bits.
            let agrees = (!status.contains(LSR::TRANSMITTER_EMPTY)
                || status.contains(LSR::THR_EMPTY))
                && (reason.contains(ISR::FIFOS_ENABLED1) || !reason.contains(ISR::FIFOS_ENABLED0));
            // None, or the busy line of some makers; modem, transmitter, receiver, line status.
            let interrupt = match reason.bits() & 0x0f {
                0x1 | 0x7 => true,
                0x0 => enabled & 8 != 0,
                0x2 => enabled & 2 != 0,
                0x4 | 0xc => enabled & 1 != 0,
                0x6 => enabled & 4 != 0,
                _ => false,
            };
            // Behind the divisor, the enabled interrupts cannot be read.
            let known = line.contains(LCR::DLAB) || enabled & 0xf0 == 0 && interrupt;
            Ok::<bool, B::Error>(modem & 0xc0 == 0 && agrees && known)
        };
        registers.answers(offsets::LSR * STRIDE, Width::Bits8) && looks_like_it().unwrap_or(false)
    }

    fn init<B: Bus>(&self, registers: Registers<'_, B>) -> Result<(), B::Error> {
        self.open.store(false, Relaxed);
        self.format.store(Format::EIGHT_BITS.0.bits(), Relaxed);
        self.line.forget();
        self.interrupts.forget();
        self.settle(registers)?;
        self.configure(registers, Self::SPEED, Format::EIGHT_BITS)?;
        let clear = FIFOS | FCR::RX_FIFO_RESET | FCR::TX_FIFO_RESET;
        Self::put(registers, offsets::FCR, clear.bits())?;
        let found = ISR::from_bits_retain(Self::get(registers, offsets::ISR)?);
        let has_fifos = found.contains(ISR::FIFOS_ENABLED0 | ISR::FIFOS_ENABLED1);
        self.fifo.store(if has_fifos { 16 } else { 1 }, Relaxed);
        // The last of these lets the interrupt out of the board, where it is wired as in a PC.
        let ready = MCR::DTR | MCR::RTS | MCR::OUT_2_INT_ENABLE;
        Self::put(registers, offsets::MCR, ready.bits())
    }

    fn open<B: Bus>(&self, registers: Registers<'_, B>) -> Result<(), B::Error> {
        Self::put(registers, offsets::FCR, (FIFOS | FCR::RX_FIFO_RESET).bits())?;
        if let Some(mut reader) = self.received.reader() {
            reader.clear();
        }
        self.open.store(true, Relaxed);
        let settled = self.settle(registers);
        if settled.is_err() {
            self.open.store(false, Relaxed);
        }
        settled.map(drop)
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
        let mut reader = self.received.reader().ok_or(DeviceError::WouldBlock)?;
        DeviceError::unless_moved(reader.read(into), self.settle(registers))
    }

    fn write<B: Bus>(
        &self,
        registers: Registers<'_, B>,
        from: &[u8],
    ) -> Result<usize, DeviceError<B::Error>> {
        let mut writer = self.to_send.writer().ok_or(DeviceError::WouldBlock)?;
        DeviceError::unless_moved(writer.write(from), self.settle(registers))
    }

    fn is_flushed<B: Bus>(&self, registers: Registers<'_, B>) -> Result<bool, B::Error> {
        self.settle(registers)?;
        Ok(self.to_send.is_empty()
            && self
                .line_status(registers)?
                .contains(LSR::TRANSMITTER_EMPTY))
    }

    fn read_ready<B: Bus>(&self, registers: Registers<'_, B>) -> Result<bool, B::Error> {
        self.settle(registers)?;
        Ok(!self.received.is_empty())
    }

    fn write_ready<B: Bus>(&self, registers: Registers<'_, B>) -> Result<bool, B::Error> {
        self.settle(registers)?;
        Ok(!self.to_send.is_full())
    }

    fn interrupt<B: Bus>(&self, registers: Registers<'_, B>) -> Result<Attention, B::Error> {
        let attention = self.attend(registers);
        if attention.is_err() {
            // The board said that it can send, and does not say so twice.
            self.stalled.store(true, Relaxed);
            // If this fails, too, the next call of any kind tries again.
            let _ = self.settle(registers);
        }
        attention
    }
}

impl<const STRIDE: usize, const BUFFER: usize, const DIVISOR: u16>
    Uart16550<STRIDE, BUFFER, DIVISOR>
{
    /// Returns the counts of the errors on the serial line since the program started.
    #[must_use]
    pub fn line_errors(&self) -> LineErrors {
        LineErrors {
            overruns: self.overruns.get(),
            parity: self.parity.get(),
            framing: self.framing.get(),
            breaks: self.breaks.get(),
        }
    }

    /// Moves received bytes and bytes to send between the board and the buffers, as the interrupt
    /// handler does. Call it for a board that does not interrupt, or whose vector has been
    /// disabled.
    ///
    /// # Errors
    /// Returns the bus's error if an access fails.
    pub fn poll<B: Bus>(&self, registers: Registers<'_, B>) -> Result<(), B::Error> {
        masked(|| self.serve(registers)).map(drop)
    }
}
