//! [`Spi`]: a simulated SPI controller with the model of a part.

use embedded_hal::spi::{self, SpiDevice};

use super::SimBus;
use crate::bus::Bus as _;
use crate::serial::SpiCommand;

/// A simulated SPI controller with one part: the model at the address `base` of `bus`.
///
/// The first byte that is written is the number of a register with the bits of `command`; the
/// number advances with each further byte. An absent part reads as ones.
#[derive(Clone)]
pub struct Spi {
    /// The bus of the model.
    pub bus: SimBus,
    /// The bus address of the model.
    pub base: usize,
    /// The bits that the part expects in a command byte, apart from the register's number.
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
