//! [`ProcessBus`]: the bus of a process, if it has one.

use std::sync::Arc;

use condor_dev::linux::LinuxBus;
use condor_dev::{Bus, BusAccessError, Width};

use super::serial::SerialPort;
use crate::silent::Silent;

/// The bus of a [`LinuxProcess`](super::LinuxProcess), through which its program accesses boards: a file, or a part of
/// one, that all processes map, whose first byte has the bus address 0; and at [`SERIAL`](crate::SERIAL) the serial port
/// of the process. Where there is nothing, accesses fail. All clones are the same bus.
#[derive(Clone, Debug)]
pub struct ProcessBus {
    pub(super) mapped: Option<LinuxBus>,
    pub(super) serial: Option<Arc<SerialPort>>,
}

impl ProcessBus {
    #[inline]
    fn serial(&self, address: usize) -> Option<(&SerialPort, usize)> {
        let serial = self.serial.as_ref()?;
        Some((serial, SerialPort::register(address)?))
    }
}

impl Bus for ProcessBus {
    type Error = BusAccessError;

    #[inline]
    fn read(&self, address: usize, width: Width) -> Result<u32, BusAccessError> {
        if let Some((serial, register)) = self.serial(address) {
            return serial.read(register, width);
        }
        match &self.mapped {
            Some(bus) => bus.read(address, width),
            None => Silent.read(address, width),
        }
    }

    #[inline]
    fn write(&self, address: usize, width: Width, value: u32) -> Result<(), BusAccessError> {
        if let Some((serial, register)) = self.serial(address) {
            return serial.write(register, width, value);
        }
        match &self.mapped {
            Some(bus) => bus.write(address, width, value),
            None => Silent.write(address, width, value),
        }
    }
}
