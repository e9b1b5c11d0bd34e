//! [`Bus`]: registers of boards, at addresses that may or may not answer.

use core::convert::Infallible;
use core::fmt::Debug;

/// What is wrong with an access, for code that is generic over buses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum BusErrorKind {
    /// Nothing answers at the address: no board, or one that is broken.
    NoAnswer,
    /// The address is not a multiple of the access's width.
    Misaligned,
    /// The address is not reached through this bus.
    OutOfRange,
    /// The bus reaches the address for reading only.
    ReadOnly,
    /// What answered before is gone: a device that vanished, a file that was truncated.
    Lost,
}

/// An error of a bus; every backend brings its own.
pub trait BusError: Debug {
    /// The kind that generic code can act on.
    fn kind(&self) -> BusErrorKind;
}

/// The error of a bus whose accesses always succeed.
impl BusError for Infallible {
    fn kind(&self) -> BusErrorKind {
        match *self {}
    }
}

/// How many bits an access moves at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Width {
    /// One byte.
    Bits8,
    /// Two bytes.
    Bits16,
    /// Four bytes.
    Bits32,
}

impl Width {
    /// The same in bytes.
    #[must_use]
    pub const fn bytes(self) -> usize {
        match self {
            Self::Bits8 => 1,
            Self::Bits16 => 2,
            Self::Bits32 => 4,
        }
    }
}

/// Reads and writes of 8, 16 and 32 bits at bus addresses, each of which may answer with a bus
/// error.
///
/// # For users
///
/// An access is made once, in this width, in program order relative to the other accesses of the
/// same context; registers may change by being read. Values are as the processor sees them:
/// bytes are swapped, where a board wants that, by its driver.
///
/// # For implementers
///
/// The memory behind a bus is never a Rust reference. An access that the bus does not answer returns
/// an error, never a signal or a trap; a bus that cannot know returns
/// [`Infallible`](core::convert::Infallible) errors and overrides [`answers`](Self::answers) if it
/// can know at start-up. A misaligned access is refused, not split. Call
/// [`conformance::bus`](conformance/fn.bus.html) from one test.
pub trait Bus {
    /// The backend's error.
    type Error: BusError;

    /// Reads a byte.
    ///
    /// # Errors
    /// See [`BusErrorKind`]; so for all accesses.
    fn read8(&self, address: usize) -> Result<u8, Self::Error>;

    /// Reads two bytes at once.
    ///
    /// # Errors
    /// As [`read8`](Self::read8).
    fn read16(&self, address: usize) -> Result<u16, Self::Error>;

    /// Reads four bytes at once.
    ///
    /// # Errors
    /// As [`read8`](Self::read8).
    fn read32(&self, address: usize) -> Result<u32, Self::Error>;

    /// Writes a byte.
    ///
    /// # Errors
    /// As [`read8`](Self::read8).
    fn write8(&self, address: usize, value: u8) -> Result<(), Self::Error>;

    /// Writes two bytes at once.
    ///
    /// # Errors
    /// As [`read8`](Self::read8).
    fn write16(&self, address: usize, value: u16) -> Result<(), Self::Error>;

    /// Writes four bytes at once.
    ///
    /// # Errors
    /// As [`read8`](Self::read8).
    fn write32(&self, address: usize, value: u32) -> Result<(), Self::Error>;

    /// Whether something answers a read at `address`: for probing, before anything relies on it.
    fn answers(&self, address: usize, width: Width) -> bool {
        match width {
            Width::Bits8 => self.read8(address).is_ok(),
            Width::Bits16 => self.read16(address).is_ok(),
            Width::Bits32 => self.read32(address).is_ok(),
        }
    }
}

macro_rules! forwarded {
    ($($method:ident($($argument:ident: $kind:ty),*) -> $result:ty;)*) => {
        $(
            #[inline(always)]
            fn $method(&self, $($argument: $kind),*) -> $result {
                B::$method(self, $($argument),*)
            }
        )*
    };
}

impl<B: Bus + ?Sized> Bus for &B {
    type Error = B::Error;

    forwarded! {
        read8(address: usize) -> Result<u8, B::Error>;
        read16(address: usize) -> Result<u16, B::Error>;
        read32(address: usize) -> Result<u32, B::Error>;
        write8(address: usize, value: u8) -> Result<(), B::Error>;
        write16(address: usize, value: u16) -> Result<(), B::Error>;
        write32(address: usize, value: u32) -> Result<(), B::Error>;
        answers(address: usize, width: Width) -> bool;
    }
}

/// The registers of one board: a bus, and where the board begins on it.
#[derive(Debug)]
pub struct Registers<'b, B> {
    bus: &'b B,
    base: usize,
}

impl<B> Clone for Registers<'_, B> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<B> Copy for Registers<'_, B> {}

macro_rules! at_offset {
    ($($(#[$doc:meta])* $method:ident($($value:ident: $kind:ty)?) -> $result:ty;)*) => {
        $(
            $(#[$doc])*
            ///
            /// # Errors
            /// The bus's.
            #[inline(always)]
            pub fn $method(&self, offset: usize $(, $value: $kind)?) -> Result<$result, B::Error> {
                self.bus.$method(self.base.wrapping_add(offset) $(, $value)?)
            }
        )*
    };
}

impl<'b, B: Bus> Registers<'b, B> {
    /// The registers from `base` on.
    #[inline]
    pub const fn new(bus: &'b B, base: usize) -> Self {
        Self { bus, base }
    }

    /// Where the board begins.
    #[must_use]
    pub const fn base(&self) -> usize {
        self.base
    }

    /// Whether something answers at `offset`.
    #[must_use]
    pub fn answers(&self, offset: usize, width: Width) -> bool {
        self.bus.answers(self.base.wrapping_add(offset), width)
    }

    at_offset! {
        /// Reads the byte at `offset`.
        read8() -> u8;
        /// Reads the two bytes at `offset`.
        read16() -> u16;
        /// Reads the four bytes at `offset`.
        read32() -> u32;
        /// Writes the byte at `offset`.
        write8(value: u8) -> ();
        /// Writes the two bytes at `offset`.
        write16(value: u16) -> ();
        /// Writes the four bytes at `offset`.
        write32(value: u32) -> ();
    }
}
