//! [`Bus`]: access to the registers of boards, which may or may not answer.

use core::convert::Infallible;
use core::fmt::Debug;

/// The reason why an access to a [`Bus`] failed, in a form that code for any bus can match on.
///
/// A bus that has nothing to add to it can use this enum as its error type: it implements
/// [`BusError`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BusErrorKind {
    /// Nothing answers at the address: no board, or one that is broken.
    #[error("no device answers")]
    NoAnswer,
    /// The address is not a multiple of the access's width.
    #[error("the address is misaligned")]
    Misaligned,
    /// The address does not belong to this bus.
    #[error("the address is out of range")]
    OutOfRange,
    /// The bus can only read at this address.
    #[error("the bus is read-only")]
    ReadOnly,
    /// The board or memory that answered before is gone: a device vanished, or a file was
    /// truncated.
    #[error("the device was removed")]
    Lost,
    /// Another context, or another controller of the same wires, is using the bus; try again later.
    #[error("the bus is in use")]
    Busy,
    /// Any other error, such as data that was not acknowledged, or signals that break the protocol.
    #[error("the bus failed")]
    Other,
}

/// The trait of the error types of buses. The buses of this crate use [`BusAccessError`]; a bus of
/// your own may use another type.
pub trait BusError: core::error::Error {
    /// Returns the kind of error, which code for any bus can handle.
    fn kind(&self) -> BusErrorKind;
}

/// The error of a bus whose accesses always succeed.
impl BusError for Infallible {
    fn kind(&self) -> BusErrorKind {
        match *self {}
    }
}

impl BusError for BusErrorKind {
    fn kind(&self) -> BusErrorKind {
        *self
    }
}

/// The failure of an access to a bus: the address, and the reason. It is the error type of this
/// crate's buses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("bus error at {address:#x}: {kind}")]
pub struct BusAccessError {
    /// The bus address of the access.
    pub address: usize,
    /// The kind of error.
    pub kind: BusErrorKind,
}

impl BusError for BusAccessError {
    fn kind(&self) -> BusErrorKind {
        self.kind
    }
}

/// The width of an access to a bus: 8, 16 or 32 bits. The discriminant is the number of bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Width {
    /// One byte.
    Bits8 = 1,
    /// Two bytes.
    Bits16 = 2,
    /// Four bytes.
    Bits32 = 4,
}

impl Width {
    /// Returns the number of bytes: 1, 2 or 4.
    #[must_use]
    pub const fn bytes(self) -> usize {
        self as usize
    }

    /// Returns a mask of the bits that a value of this width has: `0xff`, `0xffff` or
    /// `0xffff_ffff`.
    #[must_use]
    pub const fn mask(self) -> u32 {
        u32::MAX >> (32 - 8 * self.bytes())
    }

    /// Returns `Ok` if an access of this width may be made at `address`.
    #[inline(always)]
    pub(crate) const fn check(self, address: usize) -> Result<(), BusAccessError> {
        if address.is_multiple_of(self.bytes()) {
            return Ok(());
        }
        let kind = BusErrorKind::Misaligned;
        Err(BusAccessError { address, kind })
    }
}

macro_rules! typed {
    ($($read:ident, $write:ident: $kind:ty, $width:ident, $what:literal;)*) => {
        $(
            #[doc = concat!("Reads the ", $what, " at `address`.")]
            ///
            /// # Errors
            /// [`Self::Error`] if the access is refused or nothing answers; [`BusErrorKind`] lists
            /// the kinds.
            #[inline(always)]
            fn $read(&self, address: usize) -> Result<$kind, Self::Error> {
                Ok(self.read(address, Width::$width)? as $kind)
            }

            #[doc = concat!("Writes the ", $what, " at `address`.")]
            ///
            /// # Errors
            /// [`Self::Error`] if the access is refused or nothing answers; [`BusErrorKind`] lists
            /// the kinds.
            #[inline(always)]
            fn $write(&self, address: usize, value: $kind) -> Result<(), Self::Error> {
                self.write(address, Width::$width, value.into())
            }
        )*
    };
}

/// A bus: it reads and writes the registers of boards, 8, 16 or 32 bits at a time, by their bus
/// addresses. A *board* is anything with registers, such as a peripheral of the processor or a chip
/// on I2C. Each access may return an error.
///
/// # For users
///
/// Each access is made once and in the given width, since a register may change when it is read.
/// The accesses of one context are made in program order. Values are as the processor sees them: if
/// a board needs bytes swapped, its driver does that.
///
/// # For implementers
///
/// Only [`read`](Self::read) and [`write`](Self::write) are required. A bus on which every transfer
/// is slow overrides the block transfers. Never make a Rust reference to the memory behind a bus.
///
/// An access to which nothing answers returns an error; it raises neither a signal nor a trap. A
/// misaligned access is refused, not split. Call [`conformance::bus`](conformance/fn.bus.html) from
/// a test: it checks that a bus follows these rules. Only a bus that cannot know whether something
/// answered may have the error type [`Infallible`](core::convert::Infallible); it overrides
/// [`answers`](Self::answers) if it can find out at start-up in another way.
pub trait Bus {
    /// The type of the errors of this bus.
    type Error: BusError;

    /// Reads the register at a bus address; if the width is less than 32 bits, the upper bits of
    /// the value are 0.
    ///
    /// # Errors
    /// [`Self::Error`] if the access is refused or nothing answers; [`BusErrorKind`] lists the
    /// kinds.
    fn read(&self, address: usize, width: Width) -> Result<u32, Self::Error>;

    /// Writes the register at a bus address with the lower bits of `value`.
    ///
    /// # Errors
    /// [`Self::Error`] if the access is refused or nothing answers.
    fn write(&self, address: usize, width: Width, value: u32) -> Result<(), Self::Error>;

    /// Reads the byte registers from `address` on, in order.
    ///
    /// # Errors
    /// [`Self::Error`] if an access is refused or nothing answers; a part of `into` may have been
    /// read then.
    fn read_block(&self, address: usize, into: &mut [u8]) -> Result<(), Self::Error> {
        for (offset, byte) in into.iter_mut().enumerate() {
            *byte = self.read(address.wrapping_add(offset), Width::Bits8)? as u8;
        }
        Ok(())
    }

    /// Writes the byte registers from `address` on, in order.
    ///
    /// # Errors
    /// [`Self::Error`] if an access is refused or nothing answers; a part of `from` may have been
    /// written then.
    fn write_block(&self, address: usize, from: &[u8]) -> Result<(), Self::Error> {
        for (offset, &byte) in from.iter().enumerate() {
            self.write(address.wrapping_add(offset), Width::Bits8, byte.into())?;
        }
        Ok(())
    }

    /// Returns true if something answers a read at `address`. Probes use this before anything
    /// relies on the address.
    fn answers(&self, address: usize, width: Width) -> bool {
        self.read(address, width).is_ok()
    }

    typed! {
        read8, write8: u8, Bits8, "byte";
        read16, write16: u16, Bits16, "two bytes";
        read32, write32: u32, Bits32, "four bytes";
    }
}

impl<B: Bus + ?Sized> Bus for &B {
    type Error = B::Error;

    #[inline(always)]
    fn read(&self, address: usize, width: Width) -> Result<u32, B::Error> {
        B::read(self, address, width)
    }

    #[inline(always)]
    fn write(&self, address: usize, width: Width, value: u32) -> Result<(), B::Error> {
        B::write(self, address, width, value)
    }

    fn read_block(&self, address: usize, into: &mut [u8]) -> Result<(), B::Error> {
        B::read_block(self, address, into)
    }

    fn write_block(&self, address: usize, from: &[u8]) -> Result<(), B::Error> {
        B::write_block(self, address, from)
    }

    fn answers(&self, address: usize, width: Width) -> bool {
        B::answers(self, address, width)
    }
}

/// The registers of one board, as its driver accesses them: a [`Bus`] on which address 0 is the
/// board's first register.
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

impl<'b, B: Bus> Registers<'b, B> {
    /// Makes a bus of the registers of the board that begins at address `base` of `bus`.
    #[inline]
    pub const fn new(bus: &'b B, base: usize) -> Self {
        Self { bus, base }
    }

    /// Returns the bus address at which the board begins, for example to print it.
    #[must_use]
    pub const fn base(&self) -> usize {
        self.base
    }
}

/// Accesses the board; addresses are offsets from its beginning.
impl<B: Bus> Bus for Registers<'_, B> {
    type Error = B::Error;

    #[inline(always)]
    fn read(&self, offset: usize, width: Width) -> Result<u32, B::Error> {
        self.bus.read(self.base.wrapping_add(offset), width)
    }

    #[inline(always)]
    fn write(&self, offset: usize, width: Width, value: u32) -> Result<(), B::Error> {
        self.bus.write(self.base.wrapping_add(offset), width, value)
    }

    fn read_block(&self, offset: usize, into: &mut [u8]) -> Result<(), B::Error> {
        self.bus.read_block(self.base.wrapping_add(offset), into)
    }

    fn write_block(&self, offset: usize, from: &[u8]) -> Result<(), B::Error> {
        self.bus.write_block(self.base.wrapping_add(offset), from)
    }

    fn answers(&self, offset: usize, width: Width) -> bool {
        self.bus.answers(self.base.wrapping_add(offset), width)
    }
}
