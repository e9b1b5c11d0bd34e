//! [`Registers`]: the robot's side of the boards, as the drivers of condor-dev describe their registers.

use condor_dev::{Bus, BusError};
use utah_mit_boards::{Adc16, Dac16, Encoder8};

use crate::boards::address;
use crate::failure::Failure;

mod offset {
    pub(super) const IDENTIFICATION: usize = 0x00;
    pub(super) const CONTROL: usize = 0x02;
    pub(super) const STROBE: usize = 0x04;
    pub(super) const CHANNELS: usize = 0x20;
}

const ADC: u16 = 0xadc0;
const DAC: u16 = 0xdac0;
const ENCODER: u16 = 0xe4c0;
const CONNECTED: u16 = 1 << 0;

/// The boards as the robot has them.
#[derive(Debug)]
pub(super) struct Registers<B> {
    bus: B,
}

/// The output of a D/A board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Output {
    /// No program has the board open.
    Disconnected,
    /// The board has not been strobed since the last look.
    Same,
    /// These registers have been strobed.
    Strobed([i16; Dac16::CHANNELS]),
}

impl<B: Bus> Registers<B> {
    pub(super) const fn new(bus: B) -> Self {
        Self { bus }
    }

    /// No board answers any more.
    pub(super) fn unplug(&self) -> Result<(), Failure> {
        for base in address::ADC.into_iter().chain(address::DAC) {
            self.write16(base + offset::IDENTIFICATION, 0)?;
        }
        self.write16(address::ENCODER + offset::IDENTIFICATION, 0)?;
        for base in address::DAC {
            self.write16(base + offset::STROBE, 0)?;
        }
        Ok(())
    }

    /// All boards answer.
    pub(super) fn plug(&self) -> Result<(), Failure> {
        for base in address::ADC {
            self.write16(base + offset::IDENTIFICATION, ADC)?;
        }
        for base in address::DAC {
            self.write16(base + offset::IDENTIFICATION, DAC)?;
        }
        self.write16(address::ENCODER + offset::IDENTIFICATION, ENCODER)
    }

    /// Sets the result of an A/D board's conversion.
    pub(super) fn set_input(&self, board: u8, line: u8, value: i16) -> Result<(), Failure> {
        let Some(base) = address::ADC.get(usize::from(board)) else {
            return Ok(());
        };
        let at = base + offset::CHANNELS + 2 * usize::from(line) % (2 * Adc16::CHANNELS);
        self.write16(at, value.cast_unsigned())
    }

    /// Sets a counter of the encoder board.
    pub(super) fn set_counter(&self, line: u8, value: u32) -> Result<(), Failure> {
        let counter = usize::from(line) % Encoder8::COUNTERS;
        let at = address::ENCODER + offset::CHANNELS + 4 * counter;
        let written = self.bus.write32(at, value);
        written.map_err(|error| failure::<B>(at, &error))
    }

    /// Returns the output of a D/A board since the last look.
    pub(super) fn output(&self, board: usize) -> Result<Output, Failure> {
        let Some(&base) = address::DAC.get(board) else {
            return Ok(Output::Disconnected);
        };
        if self.read16(base + offset::CONTROL)? & CONNECTED == 0 {
            return Ok(Output::Disconnected);
        }
        if self.read16(base + offset::STROBE)? == 0 {
            return Ok(Output::Same);
        }
        // Before the channels: what is strobed while they are read, is read again.
        self.write16(base + offset::STROBE, 0)?;
        let mut channels = [0; Dac16::CHANNELS];
        for (line, channel) in channels.iter_mut().enumerate() {
            let value = self.read16(base + offset::CHANNELS + 2 * line)?;
            *channel = value.cast_signed();
        }
        Ok(Output::Strobed(channels))
    }

    fn read16(&self, address: usize) -> Result<u16, Failure> {
        let read = self.bus.read16(address);
        read.map_err(|error| failure::<B>(address, &error))
    }

    fn write16(&self, address: usize, value: u16) -> Result<(), Failure> {
        let written = self.bus.write16(address, value);
        written.map_err(|error| failure::<B>(address, &error))
    }
}

fn failure<B: Bus>(address: usize, error: &B::Error) -> Failure {
    let kind = error.kind();
    Failure::Bus { address, kind }
}
