//! [`I2c`] and [`Spi`]: the boards of a simulated bus behind two wires or four.

use embedded_hal::i2c::{self, NoAcknowledgeSource};
use embedded_hal::spi::{self, SpiDevice};

use super::Bus;
use crate::bus::{Bus as _, BusErrorKind};
use crate::serial::SpiCommand;

/// An I2C controller whose part with the 7-bit address `d` is the model at `d << 8`.
///
/// The first byte written is the number of a register, which advances with each further byte; a
/// transaction begins at register 0. An absent part does not acknowledge its address.
#[derive(Clone)]
pub struct I2c(pub Bus);

impl i2c::ErrorType for I2c {
    type Error = i2c::ErrorKind;
}

impl i2c::I2c for I2c {
    fn transaction(
        &mut self,
        part: u8,
        operations: &mut [i2c::Operation<'_>],
    ) -> Result<(), i2c::ErrorKind> {
        let mut register = 0_u8;
        // A register follows each start, which comes where reads turn into writes.
        let mut started = true;
        for operation in operations {
            let done = match operation {
                i2c::Operation::Read(into) => {
                    started = true;
                    into.iter_mut().try_for_each(|byte| {
                        *byte = self
                            .0
                            .read8(usize::from(part) << 8 | usize::from(register))?;
                        register = register.wrapping_add(1);
                        Ok(())
                    })
                }
                i2c::Operation::Write(from) => from.iter().try_for_each(|&byte| {
                    if core::mem::take(&mut started) {
                        register = byte;
                        return Ok(());
                    }
                    let address = usize::from(part) << 8 | usize::from(register);
                    register = register.wrapping_add(1);
                    self.0.write8(address, byte)
                }),
            };
            done.map_err(|error: crate::AccessError| {
                i2c::ErrorKind::NoAcknowledge(match error.kind {
                    BusErrorKind::NoAnswer => NoAcknowledgeSource::Address,
                    _ => NoAcknowledgeSource::Unknown,
                })
            })?;
        }
        Ok(())
    }
}

/// An SPI controller whose one part is the model at `base`.
///
/// The first byte that is written is the number of a register with the bits of `command`; it
/// advances with each further byte. An absent part reads as ones.
#[derive(Clone)]
pub struct Spi {
    /// The bus of the model.
    pub bus: Bus,
    /// The model's base.
    pub base: usize,
    /// The bits that the part expects beside a register's number.
    pub command: SpiCommand,
}

impl spi::ErrorType for Spi {
    type Error = spi::ErrorKind;
}

impl SpiDevice for Spi {
    fn transaction(
        &mut self,
        operations: &mut [spi::Operation<'_, u8>],
    ) -> Result<(), spi::ErrorKind> {
        let flags = self.command.read | self.command.write;
        let mut at = None;
        for operation in operations {
            match operation {
                spi::Operation::Write(from) => {
                    for &byte in *from {
                        match &mut at {
                            None => at = Some(self.base + usize::from(byte & !flags)),
                            Some(register) => {
                                let _ = self.bus.write8(*register, byte);
                                *register += 1;
                            }
                        }
                    }
                }
                spi::Operation::Read(into) => {
                    for byte in into.iter_mut() {
                        let register = at.get_or_insert(self.base);
                        *byte = self.bus.read8(*register).unwrap_or(0xff);
                        *register += 1;
                    }
                }
                _ => return Err(spi::ErrorKind::Other),
            }
        }
        Ok(())
    }
}
