//! The boards on the bus of a robot: [`Boards`] as its processors use them, and [`SimBoards`] as the simulated robot
//! sees them.

use condor_dev::{
    Bus, BusErrorKind, InterruptController, InterruptEntry, InterruptVector, OpenError,
};
use condor_hand::config::{Channel, OutputChannel, Wire};
use thiserror::Error;

use crate::RobotDescription;

/// The boards on the bus of a robot, on which the channels of its description are.
///
/// # For users
///
/// Programs have it as a parameter: `Servo<Rack>` is the servo program of a robot whose boards are a `Rack`.
///
/// # For implementers
///
/// Implement it for a type without values. A processor opens only those boards at which it has a wire, so that its
/// start does not disturb the outputs of other processors. Implement [`SimBoards`], too, if the robot is also to be
/// simulated behind the registers of these boards.
pub trait Boards: Copy + Default + Send + Sync + 'static {
    /// The drivers of the boards of one processor, and the entry of their interrupts.
    type Panel<B: Bus + Send + Sync, C: InterruptController + Send + Sync>: InterruptEntry
        + Send
        + Sync;

    /// The channels of one processor, on boards that are open.
    type Wires<'p, B: Bus + Send + Sync + 'p>: Wires;

    /// Checks whether the boards have all channels that a robot needs.
    ///
    /// # Errors
    /// Returns [`BoardError::NoChannel`] if no board has a channel; [`BoardError::Bits`] if the counts of a channel do
    /// not fit into its register; [`BoardError::Shared`] if two processors write the same board.
    fn check(robot: &RobotDescription) -> Result<(), BoardError>;

    /// Makes the drivers of the boards at which `processor` has a wire. `controller` is that of their interrupts.
    fn panel<B: Bus + Send + Sync, C: InterruptController + Send + Sync>(
        bus: B,
        controller: C,
        robot: &RobotDescription,
        processor: u8,
    ) -> Self::Panel<B, C>;

    /// Opens the boards at which `processor` has a wire, and sets each of its outputs to the counts that `rest`
    /// returns.
    ///
    /// # Errors
    /// Returns [`BoardError::Open`] if a board cannot be opened; the call can be repeated for a board that is not there
    /// yet.
    fn open<'p, B: Bus + Send + Sync, C: InterruptController + Send + Sync>(
        panel: &'p Self::Panel<B, C>,
        robot: &RobotDescription,
        processor: u8,
        rest: impl Fn(Channel) -> u32,
    ) -> Result<Self::Wires<'p, B>, BoardError>;
}

/// The channels of one processor, transferred board by board: call [`scan`](Self::scan), [`read`](Self::read) the
/// inputs, [`write`](Self::write) the outputs, and [`put`](Self::put) them, once in each tick.
pub trait Wires: Send {
    /// Reads all inputs.
    fn scan(&mut self);

    /// Returns the counts of an input at the last scan; `None` if its board did not answer, or shows a value that the
    /// input cannot have.
    fn read(&self, channel: Channel) -> Option<u32>;

    /// Sets the counts that the next [`put`](Self::put) writes to an output.
    fn write(&mut self, channel: Channel, counts: u32);

    /// Writes all outputs; those of one board change at the same instant.
    fn put(&mut self);

    /// Returns the number of transfers of a board that failed; wraps.
    fn failures(&self) -> u32;
}

/// Boards whose registers are memory, as a simulated robot sees them: it sets inputs and reads outputs.
pub trait SimBoards: Boards {
    /// Sets whether the boards are plugged in; unplugged boards do not answer.
    ///
    /// # Errors
    /// Returns [`BusFault`] if the bus fails.
    fn plug<B: Bus>(bus: &B, is_present: bool) -> Result<(), BusFault>;

    /// Returns the number of the board that has an input, from 0 and below 16; `None` if no board has it.
    fn input_board(input: Channel) -> Option<u8>;

    /// Returns true if a board of inputs converts between the instants `since_ns`, exclusive, and `now_ns`, inclusive,
    /// which are nanoseconds of the machine's clock.
    ///
    /// # Errors
    /// Returns [`BusFault`] if the bus fails.
    fn is_due<B: Bus>(bus: &B, board: u8, since_ns: u64, now_ns: u64) -> Result<bool, BusFault>;

    /// Ends a conversion: all inputs of the board are set. Returns the vector by which the board interrupts the
    /// processors that have a wire there; `None` if it does not interrupt.
    ///
    /// # Errors
    /// Returns [`BusFault`] if the bus fails.
    fn converted<B: Bus>(bus: &B, board: u8) -> Result<Option<InterruptVector>, BusFault>;

    /// Sets the counts that an input measures.
    ///
    /// # Errors
    /// Returns [`BusFault`] if the bus fails.
    fn set_input<B: Bus>(bus: &B, input: Channel, counts: u32) -> Result<(), BusFault>;

    /// Returns the number of the board that has an output, from 0 and below 16; `None` if no board has it. A simulated
    /// robot refuses others, and boards with more than 32 outputs.
    fn output_board(output: Channel) -> Option<u8>;

    /// Returns what became of a board of outputs since the last call.
    ///
    /// # Errors
    /// Returns [`BusFault`] if the bus fails.
    fn look<B: Bus>(bus: &B, board: u8) -> Result<BoardEvent, BusFault>;

    /// Returns the counts of an output; `None` while its converter makes 0 V.
    ///
    /// # Errors
    /// Returns [`BusFault`] if the bus fails.
    fn output<B: Bus>(bus: &B, output: &OutputChannel) -> Result<Option<u32>, BusFault>;
}

/// The use of a board of outputs since the last look at it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoardEvent {
    /// No program has the board open.
    Closed,
    /// The board is open, and its outputs were not written.
    Nothing,
    /// Its outputs were written.
    Written,
}

/// A transfer on the bus that failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("the bus failed at address {address:#x}: {kind}")]
pub struct BusFault {
    /// The address on the bus.
    pub address: usize,
    /// The kind of the error.
    pub kind: BusErrorKind,
}

/// The reason why boards cannot serve a robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum BoardError {
    /// No board has a channel.
    #[error(
        "there is no {} board {} with a channel {}; correct the channel in the configuration",
        channel.converter, channel.board, channel.channel
    )]
    NoChannel {
        /// The missing channel.
        channel: Channel,
    },
    /// Counts do not fit into a register.
    #[error(
        "the register of {} board {} channel {} cannot hold {bits} bits with zero at {zero} counts; correct the \
         configuration",
        channel.converter, channel.board, channel.channel
    )]
    Bits {
        /// The channel whose counts do not fit.
        channel: Channel,
        /// The width of the channel, bits.
        bits: u8,
        /// The counts at which its register is 0.
        zero: u32,
    },
    /// Two processors write a board of outputs; opening it rests the outputs of both.
    #[error(
        "processors {first} and {second} both write D/A board {board}, but a board must have one owner"
    )]
    Shared {
        /// The number of the board, from 0.
        board: u8,
        /// The processor of its first wire.
        first: u8,
        /// Another processor.
        second: u8,
    },
    /// A board cannot be opened.
    #[error(transparent)]
    Open(#[from] OpenError<'static>),
}

/// Returns the processor that serves the joint, finger or axis at the end of a wire; `None` if the robot does not have
/// it.
#[must_use]
pub fn processor(robot: &RobotDescription, wire: Wire) -> Option<u8> {
    match wire {
        Wire::Position { finger, .. }
        | Wire::Actuator { finger, .. }
        | Wire::Encoder { finger, .. }
        | Wire::Touch { finger } => robot.fingers.get(finger)?.processor(),
        Wire::Axis { axis } => {
            let axes = &robot.table.as_ref()?.axes;
            axes.get(axis).map(|axis| axis.processor)
        }
    }
}

/// Returns the effort of the actuator at the end of a wire while nothing is asked of it, N or N m; 0 for other wires.
pub(crate) fn at_rest(robot: &RobotDescription, wire: Wire) -> f64 {
    let actuator = match wire {
        Wire::Actuator { finger, actuator } => robot.actuator(finger, actuator),
        Wire::Position { .. } | Wire::Encoder { .. } | Wire::Touch { .. } | Wire::Axis { .. } => {
            None
        }
    };
    actuator.map_or(0.0, |actuator| actuator.limits().at_rest())
}

/// Boards that nobody opens, for tests of a robot that nothing drives.
#[cfg(test)]
pub(crate) mod none {
    use condor_dev::InterruptCounts;

    use super::*;

    #[derive(Clone, Copy, Default)]
    pub(crate) struct NoBoards;

    pub(crate) struct NoWires;

    pub(crate) struct NoPanel;

    impl InterruptEntry for NoPanel {
        fn serve_interrupts(&self) {}

        fn counts(&self) -> InterruptCounts {
            InterruptCounts::default()
        }

        fn each_unhandled(&self, _: &mut dyn FnMut(InterruptVector, u32)) {}

        fn each_stuck(&self, _: &mut dyn FnMut(InterruptVector, u32)) {}
    }

    impl Boards for NoBoards {
        type Panel<B: Bus + Send + Sync, C: InterruptController + Send + Sync> = NoPanel;
        type Wires<'p, B: Bus + Send + Sync + 'p> = NoWires;

        fn check(_: &RobotDescription) -> Result<(), BoardError> {
            Ok(())
        }

        fn panel<B: Bus + Send + Sync, C: InterruptController + Send + Sync>(
            _: B,
            _: C,
            _: &RobotDescription,
            _: u8,
        ) -> NoPanel {
            NoPanel
        }

        fn open<B: Bus + Send + Sync, C: InterruptController + Send + Sync>(
            _: &NoPanel,
            _: &RobotDescription,
            _: u8,
            _: impl Fn(Channel) -> u32,
        ) -> Result<NoWires, BoardError> {
            Ok(NoWires)
        }
    }

    impl Wires for NoWires {
        fn scan(&mut self) {}

        fn read(&self, _: Channel) -> Option<u32> {
            None
        }

        fn write(&mut self, _: Channel, _: u32) {}

        fn put(&mut self) {}

        fn failures(&self) -> u32 {
            0
        }
    }

    impl SimBoards for NoBoards {
        fn plug<B: Bus>(_: &B, _: bool) -> Result<(), BusFault> {
            Ok(())
        }

        fn set_input<B: Bus>(_: &B, _: Channel, _: u32) -> Result<(), BusFault> {
            Ok(())
        }

        fn input_board(input: Channel) -> Option<u8> {
            Some(input.board)
        }

        fn is_due<B: Bus>(_: &B, _: u8, _: u64, _: u64) -> Result<bool, BusFault> {
            Ok(true)
        }

        fn converted<B: Bus>(_: &B, _: u8) -> Result<Option<InterruptVector>, BusFault> {
            Ok(None)
        }

        fn output_board(output: Channel) -> Option<u8> {
            Some(output.board)
        }

        fn look<B: Bus>(_: &B, _: u8) -> Result<BoardEvent, BusFault> {
            Ok(BoardEvent::Closed)
        }

        fn output<B: Bus>(_: &B, _: &OutputChannel) -> Result<Option<u32>, BusFault> {
            Ok(None)
        }
    }
}
