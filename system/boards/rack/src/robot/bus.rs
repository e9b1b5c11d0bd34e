//! [`RackBus`]: a bus on which a processor sees its own boards.

use condor_dev::{Bus, BusError, BusErrorKind, Width};
use thiserror::Error;

use super::{Board, address};

/// A set of boards of the rack, such as those at which one processor has a wire. [`RackBus`] takes it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BoardSet(u64);

/// A bus on which only the boards of one processor answer.
///
/// When a program starts, it initialises every board that answers, and a board that is initialised takes its outputs to
/// rest. A processor that starts while others run must therefore not see the boards of the others.
#[derive(Clone, Debug)]
pub struct RackBus<B> {
    bus: B,
    seen: BoardSet,
}

/// The reason why an access to the bus by a [`RackBus`] has failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum RackBusError<E: BusError> {
    /// The board belongs to another processor, or there is none.
    #[error(
        "this processor has no board at bus address {address:#x}: none is there, or it belongs to another processor"
    )]
    Hidden {
        /// The address on the bus.
        address: usize,
    },
    /// An access to the bus failed.
    #[error(transparent)]
    Bus(E),
}

impl Board {
    /// Returns the address at which the board begins on the bus; `None` if the rack does not have the board.
    #[must_use]
    pub fn address(self) -> Option<usize> {
        match self {
            Self::Adc(number) => address::ADC.get(usize::from(number)).copied(),
            Self::Dac(number) => address::DAC.get(usize::from(number)).copied(),
            Self::Encoder => Some(address::ENCODER),
        }
    }
}

impl BoardSet {
    /// Adds `board` to the set. A board that the rack does not have is left out.
    pub fn insert(&mut self, board: Board) {
        self.0 |= board.address().map_or(0, bit);
    }

    /// Returns true if `board` is in the set.
    #[must_use]
    pub fn contains(self, board: Board) -> bool {
        board.address().is_some_and(|address| self.reaches(address))
    }

    fn reaches(self, address: usize) -> bool {
        self.0 & bit(address) != 0
    }
}

/// The bit of the board at an address; none past the end of the bus.
fn bit(address: usize) -> u64 {
    const { assert!(address::BUS_BYTES / address::BOARD_BYTES == u64::BITS as usize) };
    let number = u32::try_from(address / address::BOARD_BYTES);
    number.map_or(0, |number| 1_u64.checked_shl(number).unwrap_or(0))
}

impl<B> RackBus<B> {
    /// Makes a bus on which only the boards `seen` answer.
    pub const fn new(bus: B, seen: BoardSet) -> Self {
        Self { bus, seen }
    }

    fn of<E: BusError>(&self, address: usize) -> Result<&B, RackBusError<E>> {
        let seen = self.seen.reaches(address).then_some(&self.bus);
        seen.ok_or(RackBusError::Hidden { address })
    }
}

impl<E: BusError> BusError for RackBusError<E> {
    fn kind(&self) -> BusErrorKind {
        match self {
            Self::Hidden { .. } => BusErrorKind::NoAnswer,
            Self::Bus(error) => error.kind(),
        }
    }
}

impl<B: Bus> Bus for RackBus<B> {
    type Error = RackBusError<B::Error>;

    #[inline]
    fn read(&self, address: usize, width: Width) -> Result<u32, Self::Error> {
        self.of(address)?
            .read(address, width)
            .map_err(RackBusError::Bus)
    }

    #[inline]
    fn write(&self, address: usize, width: Width, value: u32) -> Result<(), Self::Error> {
        let bus = self.of(address)?;
        bus.write(address, width, value).map_err(RackBusError::Bus)
    }
}
