//! [`I2c`]: a simulated I2C controller with models of parts.

use embedded_hal::i2c::{self, NoAcknowledgeSource};

use crate::bus::{Bus, BusAccessError, BusErrorKind};

/// A simulated I2C controller, for use behind an [`I2cBus`](crate::I2cBus). The part with the 7-bit address `d` is the
/// model at address `d << 8` of the bus in this value: a [`SimJoint`](super::SimJoint), or a `SimBus` (feature `sim`).
///
/// The first byte written is the number of a register, which advances within each operation as the
/// part does it; a transaction begins at register 0. An absent part does not acknowledge its address.
#[derive(Clone)]
pub struct I2c<B>(pub B);

impl<B> i2c::ErrorType for I2c<B> {
    type Error = i2c::ErrorKind;
}

impl<B: Bus<Error = BusAccessError>> i2c::I2c for I2c<B> {
    fn transaction(
        &mut self,
        part: u8,
        operations: &mut [i2c::Operation<'_>],
    ) -> Result<(), i2c::ErrorKind> {
        let mut register = 0_u8;
        // A register follows each start, which comes where reads turn into writes.
        let mut started = true;
        for operation in operations {
            let at = |register: u8| usize::from(part) << 8 | usize::from(register);
            let done = match operation {
                i2c::Operation::Read(into) => {
                    started = true;
                    self.0.read_block(at(register), into)
                }
                i2c::Operation::Write(from) => {
                    let mut bytes = &**from;
                    if let [number, rest @ ..] = bytes
                        && core::mem::take(&mut started)
                    {
                        (register, bytes) = (*number, rest);
                    }
                    self.0.write_block(at(register), bytes)
                }
            };
            done.map_err(|error| {
                i2c::ErrorKind::NoAcknowledge(match error.kind {
                    BusErrorKind::NoAnswer | BusErrorKind::OutOfRange => {
                        NoAcknowledgeSource::Address
                    }
                    _ => NoAcknowledgeSource::Unknown,
                })
            })?;
        }
        Ok(())
    }
}
