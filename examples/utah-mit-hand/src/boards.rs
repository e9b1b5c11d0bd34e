//! The boards on the bus: where they are, which socket a channel of the hand's configuration is, and
//! how a processor reads and writes all of its channels in one transfer for each board.
//!
//! A board number of the configuration is a slot of the rack. A slot of converters has two boards of
//! 16 channels side by side, so that its channels count from 0 to 31; slot 2 of the inputs has the
//! encoder board, whose 8 counters are the positions of the table's axes. A converter of *n* bits puts
//! its counts into the lowest *n* bits of its register. A register of an output counts from 0 V,
//! the voltage that a drive gets while no program has its board open. 0 V corresponds to the counts
//! of 0 N.

use condor_dev::{Location, device_switch};
use condor_hand::config::{Channel, Converter, Hand, InputChannel, OutputChannel, Wire};
use thiserror::Error;
use utah_mit_boards::{Adc16, Dac16, Encoder8};

mod rack;
mod wires;

pub use rack::{Boards as SeenBoards, Rack, RackError};
pub use wires::{Panel, Wires, WiresError, open};

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

/// The input slot of the encoder board.
const ENCODER_SLOT: u8 = 2;
/// Converter boards in a slot.
const IN_SLOT: u8 = 2;

device_switch! {
    /// The drivers of all boards of the rack, each with its address. A processor opens those that it needs.
    #[derive(Debug)]
    pub struct HandBoards {
        adc: Adc16 = [
            Location::at(address::ADC[0]),
            Location::at(address::ADC[1]),
            Location::at(address::ADC[2]),
            Location::at(address::ADC[3]),
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

/// The reason why the boards of the rack cannot serve a hand with this configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum BoardError {
    /// A channel without a socket.
    #[error(
        "the rack has no {} board {} that has a channel {}; correct the channel in the configuration",
        channel.converter, channel.board, channel.channel
    )]
    NoSocket {
        /// The channel that the rack does not have.
        channel: Channel,
    },
    /// Counts that do not fit into a register.
    #[error(
        "{} board {} channel {} has {bits} bits from {zero} counts at zero, but a register has 16 bits",
        channel.converter, channel.board, channel.channel
    )]
    Bits {
        /// The channel whose counts do not fit.
        channel: Channel,
        /// The width of the channel's converter, in bits.
        bits: u8,
        /// The counts at which its register is 0.
        zero: u32,
    },
    /// A board of outputs that two processors write; opening it rests the outputs of both.
    #[error(
        "processors {first} and {second} both write D/A board {board}, but a board must have one owner"
    )]
    Shared {
        /// The board of the rack, from 0.
        board: u8,
        /// The processor of its first wire.
        first: u8,
        /// Another one.
        second: u8,
    },
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

/// Checks whether the boards of the rack can serve a hand with the configuration `hand`.
///
/// # Errors
/// Returns [`BoardError::NoSocket`] if the rack does not have a channel; [`BoardError::Bits`] if the counts of
/// a channel do not fit into its register; [`BoardError::Shared`] if two processors write the same board.
pub fn check<const F: usize, const N: usize>(hand: &Hand<F, N>) -> Result<(), BoardError> {
    let mut owners = [None; address::DAC.len()];
    for (channel, wire) in hand.wires() {
        let socket = socket(channel).ok_or(BoardError::NoSocket { channel })?;
        let (bits, zero, most) = match socket.board {
            Board::Adc(_) => (hand.input(wire).map(|input| input.bits), 0, 16),
            Board::Encoder => (hand.input(wire).map(|input| input.bits), 0, 31),
            Board::Dac(_) => {
                let output = hand.output(wire);
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
            (owners.get_mut(usize::from(board)), processor(hand, wire))
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

/// Returns the number of the processor that serves the joint, finger or axis at the end of `wire`; `None` if `hand`
/// does not have that joint, finger or axis.
#[must_use]
pub fn processor<const F: usize, const N: usize>(hand: &Hand<F, N>, wire: Wire) -> Option<u8> {
    match wire {
        Wire::Position { finger, joint }
        | Wire::Flexor { finger, joint }
        | Wire::Extensor { finger, joint } => {
            hand.joint(finger, joint).map(|joint| joint.processor)
        }
        Wire::Touch { finger } => hand.fingers.get(finger)?.processor(),
        Wire::Axis { axis } => {
            let axes = &hand.table.as_ref()?.axes;
            axes.get(axis).map(|axis| axis.processor)
        }
    }
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

/// Converts a counter of the encoder board to the counts of `input`; returns `None` if the counter is negative or above
/// the full scale of the input.
#[must_use]
pub fn encoder_counts(input: &InputChannel, counter: i32) -> Option<u32> {
    u32::try_from(counter)
        .ok()
        .filter(|&counts| counts <= input.full_scale())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn channel(converter: Converter, board: u8, channel: u8) -> Channel {
        Channel {
            converter,
            board,
            channel,
        }
    }

    #[test]
    fn a_slot_has_two_boards_side_by_side() {
        let adc = |board, line| socket(channel(Converter::Adc, board, line));
        let at = |board, line| Some(Socket { board, line });
        assert_eq!(adc(0, 15), at(Board::Adc(0), 15));
        assert_eq!(adc(0, 16), at(Board::Adc(1), 0));
        assert_eq!(adc(1, 31), at(Board::Adc(3), 15));
        assert_eq!(adc(0, 32), None);
        assert_eq!(adc(2, 7), at(Board::Encoder, 7));
        assert_eq!(adc(2, 8), None);
        assert_eq!(adc(3, 0), None);
        let dac = |board, line| socket(channel(Converter::Dac, board, line));
        assert_eq!(dac(1, 2), at(Board::Dac(2), 2));
        assert_eq!(dac(255, 0), None);
    }

    #[test]
    fn two_processors_that_write_one_board_are_named() {
        let text = include_str!("../../../condor-hand/hands/utah-mit.toml");
        let mut hand = Hand::<4, 4>::from_toml(text, "utah-mit.toml").unwrap();
        assert_eq!(check(&hand), Ok(()));
        // The first tendon of the third finger, on the board of the second.
        hand.fingers[2].joints[0].flexor.dac.board = 0;
        hand.fingers[2].joints[0].flexor.dac.channel = 31;
        let refused = check(&hand).unwrap_err();
        assert!(matches!(refused, BoardError::Shared { board: 0 | 1, .. }));
        let text = refused.to_string();
        assert!(text.contains("processors 1 and 2"), "{text}");
        hand.fingers[0].joints[0].adc.channel = 40;
        assert!(matches!(check(&hand), Err(BoardError::NoSocket { .. })));
        hand.fingers[0].joints[0].adc.channel = 0;
        hand.fingers[0].joints[0].flexor.dac.bits = 16;
        assert!(matches!(
            check(&hand),
            Err(BoardError::Bits { bits: 16, .. })
        ));
    }

    #[test]
    fn registers_and_counts_agree() {
        for zero in [0, 2048, 1 << 15] {
            for counts in [0, 1, zero, zero + 77, 2 * zero.max(1) - 1] {
                assert_eq!(output_counts(zero, output_register(zero, counts)), counts);
            }
            assert_eq!(output_register(zero, zero), 0);
        }
        for counts in [0, 4095, 65_535] {
            assert_eq!(input_counts(input_register(counts)), counts);
        }
    }
}
