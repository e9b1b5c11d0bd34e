//! [`Wires`]: the channels of one processor, transferred board by board.

use condor_dev::{Bus, Device, NoInterrupts, OpenError, OpenMode, Switch};
use condor_hand::config::{Channel, Hand};
use thiserror::Error;
use utah_mit_boards::{Adc16, Dac16, Encoder8};

use super::rack::{Boards, Rack};
use super::{
    Board, HandBoards, Socket, address, encoder_counts, input_counts, output_register, processor,
    socket, zero_of,
};

/// Boards that a processor can have open: all of them.
const OPEN: usize = address::ADC.len() + address::DAC.len() + 1;

/// The device switch of a processor of the hand, with which its program opens boards. [`open`] makes it.
pub type Panel<B> = Switch<Rack<B>, NoInterrupts, HandBoards, OPEN>;

type Open<'s, B, D> = Option<Device<'s, Rack<B>, D, OPEN>>;

/// The channels of the rack at which one processor has a wire, on boards that are open.
///
/// [`scan`](Self::scan) reads each board of inputs once, and [`put`](Self::put) writes each board of outputs once.
/// [`read`](Self::read) and [`write`](Self::write) only access memory in between. If several processors have wires at
/// one board of inputs, each of them reads the board.
#[derive(Debug)]
pub struct Wires<'s, B: Bus> {
    adc: [Converters<Open<'s, B, Adc16>, Option<i16>>; address::ADC.len()],
    dac: [Converters<Open<'s, B, Dac16>, (i16, u32)>; address::DAC.len()],
    encoder: Open<'s, B, Encoder8>,
    counters: Option<[i32; Encoder8::COUNTERS]>,
    /// Transfers of a board that failed; wraps.
    failures: u32,
}

/// A board and what goes through its lines; for outputs, register and counts of zero.
#[derive(Debug)]
struct Converters<D, L> {
    device: D,
    lines: [L; Adc16::CHANNELS],
    /// The number of the lines, from 0, that may have a wire.
    used: usize,
}

/// The reason why a processor cannot use the boards at which it has a wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum WiresError {
    /// A board cannot be opened.
    #[error(transparent)]
    Open(#[from] OpenError<'static>),
}

/// Makes the device switch of the processor `number`. `bus` is the bus of the whole rack, of which the switch sees only
/// the boards at which this processor has a wire, as the configuration `hand` says.
pub fn open<B: Bus, const F: usize, const N: usize>(
    bus: B,
    hand: &Hand<F, N>,
    number: u8,
) -> Panel<B> {
    let mut boards = Boards::default();
    for socket in sockets(hand, number) {
        boards.insert(socket.board);
    }
    Switch::new(Rack::new(bus, boards), NoInterrupts, HandBoards::new())
}

/// The sockets of a processor.
fn sockets<const F: usize, const N: usize>(
    hand: &Hand<F, N>,
    number: u8,
) -> impl Iterator<Item = Socket> + '_ {
    hand.wires()
        .filter(move |(_, wire)| processor(hand, *wire) == Some(number))
        .filter_map(|(channel, _)| socket(channel))
}

impl<'s, B: Bus> Wires<'s, B> {
    /// Opens the boards at which the processor `number` has a wire, as the configuration `hand` says. Sets each of its
    /// outputs to the counts that `rest` returns for the output's channel.
    ///
    /// # Errors
    /// Returns [`WiresError::Open`] if a board cannot be opened. If the board is only not there yet, the call can be
    /// repeated.
    pub fn new<const F: usize, const N: usize>(
        panel: &'s Panel<B>,
        hand: &Hand<F, N>,
        number: u8,
        mut rest: impl FnMut(Channel) -> u32,
    ) -> Result<Self, WiresError> {
        panel.start();
        let mut wires = Self {
            adc: [const {
                Converters {
                    device: None,
                    lines: [None; Adc16::CHANNELS],
                    used: 0,
                }
            }; address::ADC.len()],
            dac: [const {
                Converters {
                    device: None,
                    lines: [(0, 0); Dac16::CHANNELS],
                    used: 0,
                }
            }; address::DAC.len()],
            encoder: None,
            counters: None,
            failures: 0,
        };
        for (channel, wire) in hand.wires() {
            if processor(hand, wire) != Some(number) {
                continue;
            }
            let Some(Socket { board, line }) = socket(channel) else {
                continue;
            };
            let line = usize::from(line);
            match board {
                Board::Adc(number) => {
                    if let Some(adc) = wires.adc.get_mut(usize::from(number)) {
                        if adc.device.is_none() {
                            let open = panel.open_typed(HandBoards::adc, number, OpenMode::READ)?;
                            adc.device = Some(open);
                        }
                        adc.used = adc.used.max(line + 1);
                    }
                }
                Board::Dac(number) => {
                    let zero = hand.output(wire).map_or(0, zero_of);
                    if let Some(dac) = wires.dac.get_mut(usize::from(number)) {
                        if dac.device.is_none() {
                            let open =
                                panel.open_typed(HandBoards::dac, number, OpenMode::WRITE)?;
                            dac.device = Some(open);
                        }
                        if let Some(place) = dac.lines.get_mut(line) {
                            *place = (output_register(zero, rest(channel)), zero);
                        }
                    }
                }
                Board::Encoder => {
                    if wires.encoder.is_none() {
                        let open = panel.open_typed(HandBoards::encoder, 0, OpenMode::READ)?;
                        wires.encoder = Some(open);
                    }
                }
            }
        }
        wires.put();
        Ok(wires)
    }

    /// Reads every open board of inputs once. [`read`](Self::read) returns the values.
    pub fn scan(&mut self) {
        for adc in &mut self.adc {
            let Some(device) = &adc.device else { continue };
            let mut registers = [0; Adc16::CHANNELS];
            let used = registers.split_at_mut(adc.used.min(Adc16::CHANNELS)).0;
            let is_read = device.scan(device.registers, used).is_ok();
            if !is_read {
                self.failures = self.failures.wrapping_add(1);
            }
            for (line, register) in adc.lines.iter_mut().zip(registers) {
                *line = is_read.then_some(register);
            }
        }
        if let Some(device) = &self.encoder {
            let mut counters = [0; Encoder8::COUNTERS];
            self.counters = device
                .scan(device.registers, &mut counters)
                .ok()
                .map(|_| counters);
            if self.counters.is_none() {
                self.failures = self.failures.wrapping_add(1);
            }
        }
    }

    /// Returns the counts of the input `channel` at the last [`scan`](Self::scan). Returns `None` if the board of the
    /// input did not answer then, if the counts are beyond the input's range, or if `channel` is not an open input.
    pub fn read<const F: usize, const N: usize>(
        &self,
        hand: &Hand<F, N>,
        channel: Channel,
    ) -> Option<u32> {
        let Socket { board, line } = socket(channel)?;
        let line = usize::from(line);
        match board {
            Board::Adc(number) => {
                let adc = self.adc.get(usize::from(number))?;
                adc.lines.get(line).copied().flatten().map(input_counts)
            }
            Board::Encoder => {
                // There are three axes at most, and this is asked for them alone.
                let table = hand.table.as_ref()?;
                let mut inputs = table.axes.iter().map(|axis| &axis.adc);
                let input = inputs.find(|input| input.channel() == channel)?;
                encoder_counts(input, *self.counters?.get(line)?)
            }
            Board::Dac(_) => None,
        }
    }

    /// Sets the counts that the next [`put`](Self::put) writes to the output `channel`. A channel that the rack does
    /// not have is ignored.
    pub fn write(&mut self, channel: Channel, counts: u32) {
        if let Some(Socket {
            board: Board::Dac(number),
            line,
        }) = socket(channel)
            && let Some(dac) = self.dac.get_mut(usize::from(number))
            && let Some((register, zero)) = dac.lines.get_mut(usize::from(line))
        {
            *register = output_register(*zero, counts);
        }
    }

    /// Writes every open board of outputs once; all channels of a board change at the same instant. Failed transfers
    /// are counted in [`failures`](Self::failures).
    pub fn put(&mut self) {
        for dac in &self.dac {
            let Some(device) = &dac.device else { continue };
            let values = dac.lines.map(|(register, _)| register);
            if device.write_all(device.registers, &values).is_err() {
                self.failures = self.failures.wrapping_add(1);
            }
        }
    }

    /// Returns the number of transfers from or to a board that have failed so far; the number wraps.
    #[must_use]
    pub const fn failures(&self) -> u32 {
        self.failures
    }
}
