//! [`Rack`]: the boards as a robot of condor-robot has them, and how a processor reads and writes all of its channels
//! in one transfer for each board.
//!
//! A board number of the description is a slot of the rack. A slot of converters has two boards of 16 channels side by
//! side, so that its channels count from 0 to 31; slot 2 of the inputs has the encoder board, whose 8 counters are the
//! positions of the table's axes. A converter of *n* bits puts its counts into the lowest *n* bits of its register. A
//! register of an output counts from 0 V, the voltage that a drive gets while no program has its board open. 0 V
//! corresponds to the counts of 0 N.

use condor_dev::{Bus, InterruptController, Location, Switch, device_switch};
use condor_hand::config::{Channel, Converter, OutputChannel};
use condor_robot::RobotDescription;
use condor_robot::boards::{BoardError, Boards, processor};

use crate::{Adc16, Dac16, Encoder8};

mod bus;
#[cfg(feature = "linux")]
mod processes;
mod registers;
mod wires;

pub use bus::{BoardSet, RackBus, RackBusError};
#[cfg(feature = "linux")]
pub use processes::PROCESSES;
pub use wires::RackWires;

use wires::{Panel, sockets};

/// The rack of the Utah/MIT hand: four A/D boards, six D/A boards and an encoder board.
#[derive(Clone, Copy, Debug, Default)]
pub struct Rack;

impl Boards for Rack {
    type Panel<B: Bus + Send + Sync, C: InterruptController + Send + Sync> = Panel<B, C>;
    type Wires<'p, B: Bus + Send + Sync + 'p> = RackWires<'p, B>;

    fn check(robot: &RobotDescription) -> Result<(), BoardError> {
        let mut owners = [None; address::DAC.len()];
        for (channel, wire) in robot.wires() {
            let socket = socket(channel).ok_or(BoardError::NoChannel { channel })?;
            let (bits, zero, most) = match socket.board {
                Board::Adc(_) => (robot.input(wire).map(|input| input.bits), 0, 16),
                Board::Encoder => (robot.input(wire).map(|input| input.bits), 0, 31),
                Board::Dac(_) => {
                    let output = robot.output(wire);
                    (
                        output.map(|output| output.bits),
                        output.map_or(0, zero_of),
                        15,
                    )
                }
            };
            let bits = bits.unwrap_or(0);
            // A channel as wide as the register fits if zero is in its middle.
            let fits = bits <= most || (bits == 16 && zero == 1 << 15);
            if !fits {
                return Err(BoardError::Bits {
                    channel,
                    bits,
                    zero,
                });
            }
            let Board::Dac(board) = socket.board else {
                continue;
            };
            if let (Some(owner), Some(second)) =
                (owners.get_mut(usize::from(board)), processor(robot, wire))
            {
                let first = *owner.get_or_insert(second);
                if first != second {
                    return Err(BoardError::Shared {
                        board,
                        first,
                        second,
                    });
                }
            }
        }
        Ok(())
    }

    fn panel<B: Bus + Send + Sync, C: InterruptController + Send + Sync>(
        bus: B,
        controller: C,
        robot: &RobotDescription,
        processor: u8,
    ) -> Panel<B, C> {
        let mut boards = BoardSet::default();
        for socket in sockets(robot, processor) {
            boards.insert(socket.board);
        }
        Switch::new(RackBus::new(bus, boards), controller, RackBoards::new())
    }

    fn open<'p, B: Bus + Send + Sync, C: InterruptController + Send + Sync>(
        panel: &'p Panel<B, C>,
        robot: &RobotDescription,
        processor: u8,
        rest: impl Fn(Channel) -> u32,
    ) -> Result<RackWires<'p, B>, BoardError> {
        RackWires::new(panel, robot, processor, rest)
    }
}

/// The addresses on the bus at which the boards begin, and the sizes of the bus and of a board's part of it.
pub mod address {
    /// The addresses of the analog-to-digital boards, by their numbers.
    pub const ADC: [usize; 4] = [0x0000, 0x0100, 0x0200, 0x0300];
    /// The addresses of the digital-to-analog boards, by their numbers.
    pub const DAC: [usize; 6] = [0x1000, 0x1100, 0x1200, 0x1300, 0x1400, 0x1500];
    /// The address of the encoder board.
    pub const ENCODER: usize = 0x2000;
    /// The size of the bus that the boards share, in bytes.
    pub const BUS_BYTES: usize = 0x4000;
    /// The size of the part of the bus that belongs to one board, in bytes.
    pub const BOARD_BYTES: usize = 0x100;
}

/// The interrupt vectors of the analog-to-digital boards, by their numbers: those of a slot share one.
const VECTORS: [u16; address::ADC.len()] = [128, 128, 129, 129];
/// Their level.
const LEVEL: u8 = 2;
/// The time from a conversion of the analog-to-digital boards to the release of the loop that reads it, µs.
const AHEAD_US: u16 = 100;

/// The input slot of the encoder board.
const ENCODER_SLOT: u8 = 2;
/// Converter boards in a slot.
const IN_SLOT: u8 = 2;

device_switch! {
    /// The drivers of all boards of the rack, each with its address. A processor opens those that it needs.
    #[derive(Debug)]
    pub struct RackBoards {
        adc: Adc16 = [
            Location::at(address::ADC[0]).interrupting(VECTORS[0], LEVEL),
            Location::at(address::ADC[1]).interrupting(VECTORS[1], LEVEL),
            Location::at(address::ADC[2]).interrupting(VECTORS[2], LEVEL),
            Location::at(address::ADC[3]).interrupting(VECTORS[3], LEVEL),
        ],
        dac: Dac16 = [
            Location::at(address::DAC[0]),
            Location::at(address::DAC[1]),
            Location::at(address::DAC[2]),
            Location::at(address::DAC[3]),
            Location::at(address::DAC[4]),
            Location::at(address::DAC[5]),
        ],
        encoder: Encoder8 = [Location::at(address::ENCODER)],
    }
}

/// A board of the rack: its kind, and its number among the boards of this kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Board {
    /// An analog-to-digital board, from 0.
    Adc(u8),
    /// A digital-to-analog board, from 0.
    Dac(u8),
    /// The encoder board.
    Encoder,
}

/// The place at which a wire of the hand is connected: a channel of a board of the rack.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Socket {
    /// The board that has the channel.
    pub board: Board,
    /// The channel, from 0.
    pub line: u8,
}

/// Returns the board of the rack, and the channel there, that `channel` of the configuration means; `None` if the rack
/// does not have it. A board number in the configuration is a slot of the rack, which may have two boards.
#[must_use]
pub fn socket(channel: Channel) -> Option<Socket> {
    let Channel {
        converter,
        board: slot,
        channel,
    } = channel;
    let number = || {
        let within = channel / Adc16::CHANNELS as u8;
        let number = slot.checked_mul(IN_SLOT)?.checked_add(within)?;
        (within < IN_SLOT).then_some(number)
    };
    let (board, line) = match converter {
        Converter::Adc if slot == ENCODER_SLOT => (Board::Encoder, channel),
        Converter::Adc => (Board::Adc(number()?), channel % Adc16::CHANNELS as u8),
        Converter::Dac => (Board::Dac(number()?), channel % Dac16::CHANNELS as u8),
    };
    let exists = match board {
        Board::Adc(number) => usize::from(number) < address::ADC.len(),
        Board::Dac(number) => usize::from(number) < address::DAC.len(),
        Board::Encoder => usize::from(line) < Encoder8::COUNTERS,
    };
    exists.then_some(Socket { board, line })
}

/// Returns the counts of an output for 0 N. The register of the output is 0 at these counts: see [`output_register`].
#[must_use]
pub fn zero_of(output: &OutputChannel) -> u32 {
    output.counts(0.0)
}

/// Converts the `counts` of an output to the content of its register. The register counts from `zero`: it is 0 at
/// `zero` counts.
#[must_use]
pub const fn output_register(zero: u32, counts: u32) -> i16 {
    (counts.wrapping_sub(zero) as u16).cast_signed()
}

/// Converts the content of an output's register to the counts of the output. The register counts from `zero`: it is 0
/// at `zero` counts.
#[must_use]
pub const fn output_counts(zero: u32, register: i16) -> u32 {
    zero.saturating_add_signed(register as i32)
}

/// Converts the `counts` of an input to the content of its register, which has the same 16 bits as a signed number.
#[must_use]
pub const fn input_register(counts: u32) -> i16 {
    (counts as u16).cast_signed()
}

/// Converts the content of an input's register to the counts of the input.
#[must_use]
pub const fn input_counts(register: i16) -> u32 {
    register.cast_unsigned() as u32
}
