//! [`RackWires`]: the channels of one processor, transferred board by board.

use condor_dev::{Bus, BusError, Device, InterruptController, OpenError, OpenMode, Switch};
use condor_hand::config::Channel;
use condor_robot::RobotDescription;
use condor_robot::boards::{BoardError, Wires, processor};

use super::bus::RackBus;
use super::{AHEAD_US, Board, RackBoards, Socket, address, input_counts, output_register};
use super::{socket, zero_of};
use crate::{Adc16, Dac16, Encoder8};

/// Boards that a processor can have open: all of them.
const OPEN: usize = address::ADC.len() + address::DAC.len() + 1;

/// The device switch of a processor.
pub(super) type Panel<B, C> = Switch<RackBus<B>, C, RackBoards, OPEN>;

type Open<'s, B, D> = Option<Device<'s, RackBus<B>, D, OPEN>>;

/// The channels of the rack at which one processor has a wire, on boards that are open.
///
/// [`scan`](Self::scan) reads each board of inputs once, and [`put`](Self::put) writes each board of outputs once.
/// [`read`](Self::read) and [`write`](Self::write) only access memory in between. If several processors have wires at
/// one board of inputs, each of them reads the board.
#[derive(Debug)]
pub struct RackWires<'s, B: Bus> {
    adc: [Converters<Open<'s, B, Adc16>, Option<i16>>; address::ADC.len()],
    dac: [Converters<Open<'s, B, Dac16>, (i16, u32)>; address::DAC.len()],
    encoder: Open<'s, B, Encoder8>,
    counters: Option<[i32; Encoder8::COUNTERS]>,
    /// The largest counts of the input at each counter.
    full_scale: [u32; Encoder8::COUNTERS],
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

/// The sockets of a processor.
pub(super) fn sockets(hand: &RobotDescription, number: u8) -> impl Iterator<Item = Socket> + '_ {
    hand.wires()
        .filter(move |(_, wire)| processor(hand, *wire) == Some(number))
        .filter_map(|(channel, _)| socket(channel))
}

/// The rate of the fastest processor that reads an A/D board, Hz.
fn rate_hz(hand: &RobotDescription, board: u8) -> Option<u16> {
    let reads = |(channel, _): &(Channel, _)| {
        socket(*channel).is_some_and(|socket| socket.board == Board::Adc(board))
    };
    let rates = hand.wires().filter(reads).filter_map(|(_, wire)| {
        let reader = hand.processor(processor(hand, wire)?);
        Some(reader.map_or(hand.servo_hz, |reader| hand.rate_hz(reader)))
    });
    rates.max().and_then(|rate| u16::try_from(rate).ok())
}

impl<'s, B: Bus + Send + Sync> RackWires<'s, B> {
    /// Opens the boards at which a processor has a wire.
    pub(super) fn new<C: InterruptController>(
        panel: &'s Panel<B, C>,
        hand: &RobotDescription,
        number: u8,
        rest: impl Fn(Channel) -> u32,
    ) -> Result<Self, BoardError> {
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
            full_scale: [0; Encoder8::COUNTERS],
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
                            let open = panel.open_typed(RackBoards::adc, number, OpenMode::READ)?;
                            if let Some(rate_hz) = rate_hz(hand, number) {
                                let set = open.set_timer(open.registers, rate_hz, AHEAD_US);
                                set.map_err(|error| OpenError::Bus {
                                    name: "adc",
                                    board: number,
                                    kind: error.kind(),
                                })?;
                            }
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
                                panel.open_typed(RackBoards::dac, number, OpenMode::WRITE)?;
                            dac.device = Some(open);
                        }
                        if let Some(place) = dac.lines.get_mut(line) {
                            *place = (output_register(zero, rest(channel)), zero);
                        }
                    }
                }
                Board::Encoder => {
                    if wires.encoder.is_none() {
                        let open = panel.open_typed(RackBoards::encoder, 0, OpenMode::READ)?;
                        wires.encoder = Some(open);
                    }
                    let input = hand.input(wire);
                    if let (Some(place), Some(input)) = (wires.full_scale.get_mut(line), input) {
                        *place = input.full_scale();
                    }
                }
            }
        }
        wires.put();
        Ok(wires)
    }
}

impl<B: Bus + Send + Sync> Wires for RackWires<'_, B> {
    fn scan(&mut self) {
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

    fn read(&self, channel: Channel) -> Option<u32> {
        let Socket { board, line } = socket(channel)?;
        let line = usize::from(line);
        match board {
            Board::Adc(number) => {
                let adc = self.adc.get(usize::from(number))?;
                adc.lines.get(line).copied().flatten().map(input_counts)
            }
            Board::Encoder => {
                let counts = u32::try_from(*self.counters?.get(line)?).ok()?;
                (counts <= *self.full_scale.get(line)?).then_some(counts)
            }
            Board::Dac(_) => None,
        }
    }

    fn write(&mut self, channel: Channel, counts: u32) {
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

    fn put(&mut self) {
        for dac in &self.dac {
            let Some(device) = &dac.device else { continue };
            let values = dac.lines.map(|(register, _)| register);
            if device.write_all(device.registers, &values).is_err() {
                self.failures = self.failures.wrapping_add(1);
            }
        }
    }

    fn failures(&self) -> u32 {
        self.failures
    }
}
