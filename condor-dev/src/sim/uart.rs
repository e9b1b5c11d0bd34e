//! [`UartModel`]: the registers of a 16550.

use std::collections::VecDeque;

use uart_16550::spec::registers::{FCR, IER, ISR, LCR, LSR, MCR, offsets};

use super::Model;
use crate::bus::Width;

/// Bytes of each FIFO.
const FIFO: usize = 16;

/// A simulated 16550 whose registers are `STRIDE` bytes apart (PC16550D data sheet), for tests of
/// the driver [`Uart16550`](crate::drivers::Uart16550), and as the registers of a port whose line is something else,
/// such as a terminal device.
/// Whoever has the model plays the other end of the serial line. Accesses do not allocate.
///
/// Time does not pass by itself: characters come and go when the other end calls for it, and a received
/// character has always waited long enough to interrupt.
// Each is a bit of the chip, or a way in which it is built.
#[allow(clippy::struct_excessive_bools)]
#[derive(Debug)]
pub struct UartModel<const STRIDE: usize = 1> {
    /// Whether the board asks for its interrupt regardless of its registers.
    pub stuck: bool,
    /// Whether the board has FIFOs; an 8250 has none.
    pub has_fifos: bool,
    received: VecDeque<(u8, LSR)>,
    to_send: VecDeque<u8>,
    enabled: IER,
    line: LCR,
    modem: MCR,
    divisor: [u8; 2],
    scratch: u8,
    fifos: bool,
    overrun: LSR,
    /// The interrupt for an empty transmitter, which reading the reason withdraws.
    can_send: bool,
}

impl<const STRIDE: usize> Default for UartModel<STRIDE> {
    fn default() -> Self {
        Self {
            stuck: false,
            has_fifos: true,
            received: VecDeque::with_capacity(FIFO),
            to_send: VecDeque::with_capacity(FIFO),
            enabled: IER::empty(),
            line: LCR::empty(),
            modem: MCR::empty(),
            divisor: [0; 2],
            scratch: 0,
            fifos: false,
            overrun: LSR::empty(),
            can_send: false,
        }
    }
}

impl<const STRIDE: usize> UartModel<STRIDE> {
    /// Lets the board receive the character `byte` from the line, with the error `errors`. Returns
    /// false if the board has no room: it then drops the character and reports an overrun.
    pub fn receive(&mut self, byte: u8, errors: LineFault) -> bool {
        let has_room = self.has_room();
        if has_room {
            self.received.push_back((byte, errors.status()));
        } else {
            self.overrun = LSR::OVERRUN_ERROR;
        }
        has_room
    }

    /// Returns true if the board has room for a character from the line.
    #[must_use]
    pub fn has_room(&self) -> bool {
        self.room() > 0
    }

    /// Returns the number of characters from the line for which the board has room.
    #[must_use]
    pub fn room(&self) -> usize {
        self.depth().saturating_sub(self.received.len())
    }

    /// Takes the next character that the board sends to the line; returns `None` if it has none to
    /// send.
    pub fn transmit(&mut self) -> Option<u8> {
        let byte = self.to_send.pop_front()?;
        self.can_send |= self.to_send.is_empty();
        if self.modem.contains(MCR::LOOP_BACK) {
            self.receive(byte, LineFault::None);
        }
        Some(byte)
    }

    /// Returns the divisor that the driver set. The speed in baud is the frequency of the clock
    /// divided by 16 times this.
    #[must_use]
    pub fn divisor(&self) -> u16 {
        u16::from_le_bytes(self.divisor)
    }

    /// Returns the line control register: the format of the characters that the driver set, and in bit 7 whether the
    /// divisor stands in the place of other registers.
    #[must_use]
    pub fn line_control(&self) -> u8 {
        self.line.bits()
    }

    fn depth(&self) -> usize {
        if self.fifos { FIFO } else { 1 }
    }

    fn reason(&self) -> ISR {
        let wants_send = self.can_send && self.enabled.contains(IER::THR_EMPTY);
        if self.enabled.contains(IER::DATA_READY) && !self.received.is_empty() {
            ISR::IIC_1
        } else if wants_send {
            ISR::IIC_0
        } else {
            ISR::INTERRUPT_STATUS
        }
    }

    fn line_status(&mut self) -> LSR {
        let mut status = std::mem::replace(&mut self.overrun, LSR::empty());
        if let Some((_, errors)) = self.received.front_mut() {
            status |= LSR::DATA_READY | std::mem::replace(errors, LSR::empty());
        }
        if self.to_send.is_empty() {
            status |= LSR::THR_EMPTY | LSR::TRANSMITTER_EMPTY;
        }
        status
    }

    fn register(offset: usize, width: Width) -> Option<usize> {
        let fits = width == Width::Bits8 && offset.is_multiple_of(STRIDE);
        fits.then_some(offset / STRIDE)
    }
}

/// The error with which a [`UartModel`] receives a character from the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineFault {
    /// No error.
    None,
    /// The parity is wrong.
    Parity,
    /// The stop bit is missing.
    Framing,
    /// The line is held low; there is no character.
    Break,
}

impl LineFault {
    fn status(self) -> LSR {
        match self {
            Self::None => LSR::empty(),
            Self::Parity => LSR::PARITY_ERROR,
            Self::Framing => LSR::FRAMING_ERROR,
            Self::Break => LSR::BREAK_INTERRUPT,
        }
    }
}

impl<const STRIDE: usize> Model for UartModel<STRIDE> {
    fn size(&self) -> usize {
        8 * STRIDE
    }

    fn read(&mut self, offset: usize, width: Width) -> Option<u32> {
        let divisor = self.line.contains(LCR::DLAB);
        let value = match Self::register(offset, width)? {
            offsets::DLL if divisor => self.divisor[0],
            offsets::DLM if divisor => self.divisor[1],
            offsets::DATA => self.received.pop_front().map_or(0, |(byte, _)| byte),
            offsets::IER => self.enabled.bits(),
            offsets::ISR => {
                let reason = self.reason();
                self.can_send &= reason != ISR::IIC_0;
                let fifos = if self.fifos { 0xc0 } else { 0 };
                reason.bits() | fifos
            }
            offsets::LCR => self.line.bits(),
            offsets::MCR => self.modem.bits(),
            offsets::LSR => self.line_status().bits(),
            offsets::SPR => self.scratch,
            _ => 0,
        };
        Some(value.into())
    }

    fn write(&mut self, offset: usize, width: Width, value: u32) -> Option<()> {
        let value = value as u8;
        let divisor = self.line.contains(LCR::DLAB);
        match Self::register(offset, width)? {
            offsets::DLL if divisor => self.divisor[0] = value,
            offsets::DLM if divisor => self.divisor[1] = value,
            offsets::DATA => {
                // A byte that comes on top of a full FIFO is lost.
                if self.to_send.len() < self.depth() {
                    self.to_send.push_back(value);
                }
                self.can_send = false;
            }
            offsets::IER => {
                let before = self.enabled;
                self.enabled = IER::from_bits_truncate(value & 0x0f);
                if (self.enabled - before).contains(IER::THR_EMPTY) {
                    self.can_send = self.to_send.is_empty();
                }
            }
            offsets::FCR => {
                let control = FCR::from_bits_retain(value);
                let fifos = self.has_fifos && control.contains(FCR::FIFO_ENABLE);
                let changed = fifos != self.fifos;
                self.fifos = fifos;
                if changed || control.contains(FCR::RX_FIFO_RESET) {
                    self.received.clear();
                }
                if changed || control.contains(FCR::TX_FIFO_RESET) {
                    self.to_send.clear();
                    self.can_send = true;
                }
            }
            offsets::LCR => self.line = LCR::from_bits_retain(value),
            offsets::MCR => self.modem = MCR::from_bits_truncate(value & 0x1f),
            offsets::SPR => self.scratch = value,
            _ => {}
        }
        Some(())
    }

    fn interrupts(&self) -> bool {
        let asks = !self.reason().contains(ISR::INTERRUPT_STATUS);
        self.stuck || (asks && self.modem.contains(MCR::OUT_2_INT_ENABLE))
    }
}
