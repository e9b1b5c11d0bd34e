//! The simulated robot's side of the boards, as their drivers describe the registers.

use condor_dev::{Bus, BusError};
use condor_hand::config::{Channel, OutputChannel};
use condor_robot::boards::{BoardEvent, BusFault, SimBoards};

use super::{Board, Rack, Socket, address, input_register, output_counts, socket, zero_of};
use crate::{Adc16, Encoder8};

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

impl SimBoards for Rack {
    fn plug<B: Bus>(bus: &B, is_present: bool) -> Result<(), BusFault> {
        let adc = address::ADC.map(|base| (base, ADC));
        let dac = address::DAC.map(|base| (base, DAC));
        let boards = adc
            .into_iter()
            .chain(dac)
            .chain([(address::ENCODER, ENCODER)]);
        for (base, identification) in boards {
            let shown = if is_present { identification } else { 0 };
            write16(bus, base + offset::IDENTIFICATION, shown)?;
        }
        if !is_present {
            for base in address::DAC {
                write16(bus, base + offset::STROBE, 0)?;
            }
        }
        Ok(())
    }

    fn set_input<B: Bus>(bus: &B, input: Channel, counts: u32) -> Result<(), BusFault> {
        let Some(Socket { board, line }) = socket(input) else {
            return Ok(());
        };
        let line = usize::from(line);
        let (Some(base), false) = (board.address(), matches!(board, Board::Dac(_))) else {
            return Ok(());
        };
        let first = base + offset::CHANNELS;
        if board == Board::Encoder {
            let at = first + 4 * (line % Encoder8::COUNTERS);
            return bus
                .write32(at, counts)
                .map_err(|error| fault::<B>(at, &error));
        }
        let at = first + 2 * (line % Adc16::CHANNELS);
        write16(bus, at, input_register(counts).cast_unsigned())
    }

    fn output_board(output: Channel) -> Option<u8> {
        match socket(output)?.board {
            Board::Dac(board) => Some(board),
            Board::Adc(_) | Board::Encoder => None,
        }
    }

    fn look<B: Bus>(bus: &B, board: u8) -> Result<BoardEvent, BusFault> {
        let Some(base) = Board::Dac(board).address() else {
            return Ok(BoardEvent::Closed);
        };
        if read16(bus, base + offset::CONTROL)? & CONNECTED == 0 {
            return Ok(BoardEvent::Closed);
        }
        if read16(bus, base + offset::STROBE)? == 0 {
            return Ok(BoardEvent::Nothing);
        }
        // Before the channels: what is strobed while they are read, is read again.
        write16(bus, base + offset::STROBE, 0)?;
        Ok(BoardEvent::Written)
    }

    fn output<B: Bus>(bus: &B, output: &OutputChannel) -> Result<Option<u32>, BusFault> {
        let Some(Socket { board, line }) = socket(output.channel()) else {
            return Ok(None);
        };
        let Some(base) = board.address() else {
            return Ok(None);
        };
        let at = base + offset::CHANNELS + 2 * usize::from(line);
        let register = read16(bus, at)?.cast_signed();
        Ok((register != 0).then(|| output_counts(zero_of(output), register)))
    }
}

fn read16<B: Bus>(bus: &B, address: usize) -> Result<u16, BusFault> {
    let read = bus.read16(address);
    read.map_err(|error| fault::<B>(address, &error))
}

fn write16<B: Bus>(bus: &B, address: usize, value: u16) -> Result<(), BusFault> {
    let written = bus.write16(address, value);
    written.map_err(|error| fault::<B>(address, &error))
}

fn fault<B: Bus>(address: usize, error: &B::Error) -> BusFault {
    let kind = error.kind();
    BusFault { address, kind }
}
