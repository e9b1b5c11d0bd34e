//! [`I2cBus`] and [`SpiBus`]: registers of parts on an I2C or SPI bus, through embedded-hal.

use embedded_hal::i2c::{self, Error as _, I2c, NoAcknowledgeSource};
use embedded_hal::spi::{Operation, SpiDevice};

use crate::bus::{Bus, BusAccessError, BusErrorKind, Width};
use crate::claim::ClaimCell;

/// A [`Bus`] of the registers of all parts on one I2C bus, over any controller that implements [`I2c`] of embedded-hal.
///
/// Register `r` of the part with the 7-bit address `d` has the bus address `d << 8 | r`; see
/// [`Location::i2c`](crate::Location::i2c). Registers have 8 bits. A wider access moves two or four of them in one
/// transfer, in the processor's byte order; a block of up to 64 registers is one transfer, too. If a part does not
/// advance its register number by itself, access it only by bytes.
///
/// Only one context at a time uses the wires. An access of another context meanwhile, such as an
/// interrupt handler, is refused as [`Busy`](BusErrorKind::Busy). A transfer takes about 25 µs per
/// byte at 400 kHz; it masks no interrupts during that time.
///
/// ```
/// use condor_dev::sim::{As5600Model, I2c, SimBus};
/// use condor_dev::{Bus, I2cBus, Width};
///
/// let parts = SimBus::new();
/// parts.insert(0x3600, As5600Model::default());
/// let bus = I2cBus::new(I2c(parts)); // or any controller that implements embedded_hal's I2c
/// let status = bus.read(0x360B, Width::Bits8)?; // register 0x0B of the part at 0x36
/// println!("{status:#x}");
/// # Ok::<_, Box<dyn std::error::Error>>(())
/// ```
pub struct I2cBus<I> {
    i2c: ClaimCell<I>,
    first: usize,
}

/// Registers that one write to an I2C part moves at most.
const BLOCK: usize = 64;

impl<I: I2c> I2cBus<I> {
    /// Makes a bus of the parts behind the controller `i2c`. Their bus addresses are 0 to 0x7fff.
    #[must_use]
    pub const fn new(i2c: I) -> Self {
        Self::from(0, i2c)
    }

    /// Makes a bus like [`new`](Self::new), but with the 0x8000 bus addresses from `first` on, a multiple of 4. Use it
    /// for a second I2C bus in one [`Switch`](crate::Switch).
    #[must_use]
    pub const fn from(first: usize, i2c: I) -> Self {
        let i2c = ClaimCell::new(i2c);
        Self { i2c, first }
    }

    /// Makes a transfer of `len` registers by `with`, which gets the part and the register.
    fn transfer(
        &self,
        address: usize,
        len: usize,
        with: impl FnOnce(&mut I, u8, u8) -> Result<(), I::Error>,
    ) -> Result<(), BusAccessError> {
        let error = |kind| BusAccessError { address, kind };
        let offset = address.wrapping_sub(self.first);
        let (part, register) = (offset >> 8, offset as u8);
        if part > 0x7f || usize::from(register) + len > 0x100 {
            return Err(error(BusErrorKind::OutOfRange));
        }
        let mut i2c = self.i2c.claim().ok_or(error(BusErrorKind::Busy))?;
        with(&mut i2c, part as u8, register).map_err(|failed| {
            error(match failed.kind() {
                i2c::ErrorKind::NoAcknowledge(NoAcknowledgeSource::Data) => BusErrorKind::Other,
                i2c::ErrorKind::NoAcknowledge(_) => BusErrorKind::NoAnswer,
                i2c::ErrorKind::ArbitrationLoss => BusErrorKind::Busy,
                _ => BusErrorKind::Other,
            })
        })
    }
}

impl<I: I2c> Bus for I2cBus<I> {
    type Error = BusAccessError;

    fn read(&self, address: usize, width: Width) -> Result<u32, BusAccessError> {
        read_wide(self, address, width)
    }

    fn write(&self, address: usize, width: Width, value: u32) -> Result<(), BusAccessError> {
        write_wide(self, address, width, value)
    }

    fn read_block(&self, address: usize, into: &mut [u8]) -> Result<(), BusAccessError> {
        self.transfer(address, into.len(), |i2c, part, register| {
            i2c.write_read(part, &[register], into)
        })
    }

    fn write_block(&self, mut address: usize, from: &[u8]) -> Result<(), BusAccessError> {
        for part_of in from.chunks(BLOCK) {
            self.transfer(address, part_of.len(), |i2c, part, register| {
                let mut bytes = [register; BLOCK + 1];
                for (place, &byte) in bytes.iter_mut().skip(1).zip(part_of) {
                    *place = byte;
                }
                let bytes = bytes.get(..=part_of.len()).unwrap_or_default();
                i2c.write(part, bytes)
            })?;
            address = address.wrapping_add(part_of.len());
        }
        Ok(())
    }
}

/// A [`Bus`] of the registers of one part on an SPI bus, over any [`SpiDevice`] of embedded-hal.
///
/// A transfer begins with a command byte: the number of the register, and bits for reading or writing, which
/// the data sheet defines. As with [`I2cBus`], registers have 8 bits, wider accesses and blocks move several of
/// them in one transfer, and an access while another context uses the wires is refused as
/// [`Busy`](BusErrorKind::Busy). SPI has no acknowledgement: an absent part reads as ones or zeros, so a
/// driver's probe must check an identification.
pub struct SpiBus<S> {
    spi: ClaimCell<S>,
    first: usize,
    command: SpiCommand,
}

/// The bits of an SPI part's command byte that select a read or a write. The bits below them are the number of the
/// register.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SpiCommand {
    /// The bits that are set for a read; 0x80 for most parts.
    pub read: u8,
    /// The bits that are set for a write; 0 for most parts.
    pub write: u8,
}

impl<S: SpiDevice> SpiBus<S> {
    /// Makes a bus of the registers of the part behind `spi`. Register 0 has the bus address `first`, a multiple of 4.
    /// The part has as many registers as there are numbers below the lowest bit set in `command`: 128 if that bit is
    /// 0x80.
    #[must_use]
    pub const fn new(first: usize, spi: S, command: SpiCommand) -> Self {
        let spi = ClaimCell::new(spi);
        Self {
            spi,
            first,
            command,
        }
    }

    fn transfer(
        &self,
        address: usize,
        flags: u8,
        len: usize,
        data: Operation<'_, u8>,
    ) -> Result<(), BusAccessError> {
        let error = |kind| BusAccessError { address, kind };
        let register = address.wrapping_sub(self.first);
        let flag_bits = self.command.read | self.command.write;
        let registers = match flag_bits {
            0 => 0x100,
            bits => 1 << bits.trailing_zeros(),
        };
        if register >= registers || len > registers - register {
            return Err(error(BusErrorKind::OutOfRange));
        }
        let mut spi = self.spi.claim().ok_or(error(BusErrorKind::Busy))?;
        let command = [register as u8 | flags];
        let done = spi.transaction(&mut [Operation::Write(&command), data]);
        done.map_err(|_| error(BusErrorKind::Other))
    }
}

impl<S: SpiDevice> Bus for SpiBus<S> {
    type Error = BusAccessError;

    fn read(&self, address: usize, width: Width) -> Result<u32, BusAccessError> {
        read_wide(self, address, width)
    }

    fn write(&self, address: usize, width: Width, value: u32) -> Result<(), BusAccessError> {
        write_wide(self, address, width, value)
    }

    fn read_block(&self, address: usize, into: &mut [u8]) -> Result<(), BusAccessError> {
        self.transfer(
            address,
            self.command.read,
            into.len(),
            Operation::Read(into),
        )
    }

    fn write_block(&self, address: usize, from: &[u8]) -> Result<(), BusAccessError> {
        self.transfer(
            address,
            self.command.write,
            from.len(),
            Operation::Write(from),
        )
    }
}

/// Reads a register of some bytes as the block that it is.
fn read_wide<B>(bus: &B, address: usize, width: Width) -> Result<u32, BusAccessError>
where
    B: Bus<Error = BusAccessError>,
{
    width.check(address)?;
    let (mut byte, mut pair, mut word) = ([0; 1], [0; 2], [0; 4]);
    match width {
        Width::Bits8 => bus.read_block(address, &mut byte)?,
        Width::Bits16 => bus.read_block(address, &mut pair)?,
        Width::Bits32 => bus.read_block(address, &mut word)?,
    }
    // Two of them are 0.
    Ok(u32::from(byte[0]) | u32::from(u16::from_ne_bytes(pair)) | u32::from_ne_bytes(word))
}

/// Writes a register of some bytes as the block that it is.
fn write_wide<B>(bus: &B, address: usize, width: Width, value: u32) -> Result<(), BusAccessError>
where
    B: Bus<Error = BusAccessError>,
{
    width.check(address)?;
    match width {
        Width::Bits8 => bus.write_block(address, &[value as u8]),
        Width::Bits16 => bus.write_block(address, &(value as u16).to_ne_bytes()),
        Width::Bits32 => bus.write_block(address, &value.to_ne_bytes()),
    }
}
