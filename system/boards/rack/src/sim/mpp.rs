//! [`MppModel`]: the registers of [`Mpp`](crate::Mpp)'s board.

use std::collections::VecDeque;

use condor_dev::Width;
use condor_dev::sim::Model;

/// Bytes that the board keeps.
const FIFO: usize = 16;

const INTERRUPT: u16 = 1 << 0;
const RAW: u16 = 1 << 1;
const RESET: u16 = 1 << 15;

/// A simulated parallel port board, for tests of the driver [`Mpp`](crate::Mpp). The test plays the
/// device at the other end of the lines.
#[derive(Debug, Default)]
pub struct MppModel {
    /// The input lines, as `read_16bits` sees them.
    pub inputs: u16,
    /// The states that the next reads of the input lines return, one for each read; after them,
    /// reads return `inputs`.
    pub samples: VecDeque<u16>,
    /// Whether the output lines are connected to the input lines.
    pub loopback: bool,
    /// Whether the board asks for its interrupt, whatever its registers say.
    pub stuck: bool,
    /// The bytes that the board strobed out and the test has not yet acknowledged by removing them.
    pub strobed: VecDeque<u8>,
    outputs: u16,
    received: VecDeque<u8>,
    control: u16,
    overrun: bool,
}

impl MppModel {
    /// Lets the board receive `byte` with its strobe. Returns false if the byte is lost, because
    /// the board has no room, which it reports as an overrun, or because it is in raw 16-bit mode.
    pub fn strobe_in(&mut self, byte: u8) -> bool {
        if self.control & RAW != 0 {
            return false;
        }
        let has_room = self.received.len() < FIFO;
        if has_room {
            self.received.push_back(byte);
        } else {
            self.overrun = true;
        }
        has_room
    }

    /// Returns the state of the sixteen output lines; bit *n* is line *n*.
    #[must_use]
    pub fn outputs(&self) -> u16 {
        self.outputs
    }

    /// Returns true if the driver has set the board to raw 16-bit mode.
    #[must_use]
    pub fn is_raw(&self) -> bool {
        self.control & RAW != 0
    }

    fn status(&self) -> u16 {
        let input = !self.received.is_empty();
        u16::from(input)
            | u16::from(self.strobed.len() < FIFO) << 1
            | u16::from(self.overrun) << 2
            | u16::from(self.interrupts()) << 3
    }

    fn lines(&mut self) -> u16 {
        if self.loopback {
            return self.outputs;
        }
        self.samples.pop_front().unwrap_or(self.inputs)
    }
}

impl Model for MppModel {
    fn size(&self) -> usize {
        0x10
    }

    fn read(&mut self, offset: usize, width: Width) -> Option<u32> {
        match (offset, width) {
            (0, Width::Bits16) => Some(0x3b70),
            (2, Width::Bits16) => Some(self.control.into()),
            (4, Width::Bits16) => Some(self.status().into()),
            (7, Width::Bits8) => Some(self.received.pop_front().unwrap_or(0xff).into()),
            (8, Width::Bits16) => Some(self.lines().into()),
            _ => None,
        }
    }

    fn write(&mut self, offset: usize, width: Width, value: u32) -> Option<()> {
        let value = value as u16;
        match (offset, width) {
            (2, Width::Bits16) if value & RESET != 0 => {
                self.control = 0;
                self.outputs = 0;
                self.overrun = false;
                self.received.clear();
                self.strobed.clear();
            }
            (2, Width::Bits16) => self.control = value & (INTERRUPT | RAW),
            (4, Width::Bits16) => self.overrun &= value & 4 == 0,
            (7, Width::Bits8) if self.loopback => {
                self.strobe_in(value as u8);
            }
            (7, Width::Bits8) if self.strobed.len() < FIFO => self.strobed.push_back(value as u8),
            (7, Width::Bits8) => {}
            (8, Width::Bits16) if self.is_raw() => self.outputs = value,
            (8, Width::Bits16) => self.outputs = self.outputs & 0xff | value & 0xff00,
            _ => return None,
        }
        Some(())
    }

    fn interrupts(&self) -> bool {
        let wants = self.overrun || !self.received.is_empty();
        self.stuck || (self.control & INTERRUPT != 0 && wants)
    }
}
