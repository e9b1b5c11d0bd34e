//! The simulated robot's side of the boards, as their drivers describe the registers.

use condor_dev::{Bus, BusError, InterruptVector};
use condor_hand::config::{Channel, OutputChannel};
use condor_robot::boards::{BoardEvent, BusFault, SimBoards};

use super::{Board, Rack, Socket, VECTORS, address, input_register, output_counts};
use super::{socket, zero_of};
use crate::{Adc16, Encoder8};

mod offset {
    pub(super) const IDENTIFICATION: usize = 0x00;
    pub(super) const CONTROL: usize = 0x02;
    pub(super) const STROBE: usize = 0x04;
    pub(super) const STATUS: usize = 0x06;
    pub(super) const RATE: usize = 0x08;
    pub(super) const AHEAD: usize = 0x0a;
    pub(super) const COUNT: usize = 0x0c;
    pub(super) const CHANNELS: usize = 0x20;
}

const ADC: u16 = 0xadc0;
const DAC: u16 = 0xdac0;
const ENCODER: u16 = 0xe4c0;
const CONNECTED: u16 = 1 << 0;
/// The trigger of an A/D board in its control register, and whether conversions interrupt.
const TRIGGER: u16 = 3;
const TIMER: u16 = 3;
const INTERRUPTS: u16 = 1 << 4;
const COMPLETED: u16 = 1 << 0;
/// The number of the encoder board among the boards of inputs.
const ENCODERS: u8 = address::ADC.len() as u8;

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

    fn input_board(input: Channel) -> Option<u8> {
        match socket(input)?.board {
            Board::Adc(board) => Some(board),
            Board::Encoder => Some(ENCODERS),
            Board::Dac(_) => None,
        }
    }

    fn is_due<B: Bus>(bus: &B, board: u8, since_ns: u64, now_ns: u64) -> Result<bool, BusFault> {
        let Some(base) = Board::Adc(board).address() else {
            return Ok(true);
        };
        if read16(bus, base + offset::CONTROL)? & TRIGGER != TIMER {
            return Ok(true);
        }
        let rate_hz = read16(bus, base + offset::RATE)?;
        let ahead_us = read16(bus, base + offset::AHEAD)?;
        let begun = |at_ns| conversions(at_ns, rate_hz, ahead_us);
        Ok(begun(now_ns) > begun(since_ns))
    }

    fn converted<B: Bus>(bus: &B, board: u8) -> Result<Option<InterruptVector>, BusFault> {
        let Some(base) = Board::Adc(board).address() else {
            return Ok(None);
        };
        let count = read16(bus, base + offset::COUNT)?.wrapping_add(1);
        write16(bus, base + offset::COUNT, count)?;
        write16(bus, base + offset::STATUS, COMPLETED)?;
        let interrupts = read16(bus, base + offset::CONTROL)? & INTERRUPTS != 0;
        let vector = VECTORS.get(usize::from(board)).filter(|_| interrupts);
        Ok(vector.copied().map(InterruptVector))
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

/// The number of conversions, from the beginning of time to an instant, of a timer that starts them so much earlier
/// than the middles of its periods.
fn conversions(at_ns: u64, rate_hz: u16, ahead_us: u16) -> u64 {
    const SECOND: u64 = 1_000_000_000;
    let at = at_ns.saturating_add(1000 * u64::from(ahead_us));
    let rate = u64::from(rate_hz);
    // Middles in whole seconds, and in the rest: the first is after half a period.
    let whole = (at / SECOND).saturating_mul(rate);
    whole + (at % SECOND * rate * 2 + SECOND) / (2 * SECOND)
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
