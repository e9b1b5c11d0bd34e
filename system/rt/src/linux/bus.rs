//! [`ProcessBus`]: the bus of a process, if it has one.

use condor_dev::linux::LinuxBus;
use condor_dev::{Bus, BusAccessError, Width};

use crate::silent::Silent;

/// The bus of a [`LinuxProcess`](super::LinuxProcess), through which its program accesses boards.
/// All clones are the same bus.
#[derive(Clone, Debug)]
pub enum ProcessBus {
    /// A bus in a file, or in a part of one, that all processes map. Its first byte has the bus
    /// address 0.
    Mapped(LinuxBus),
    /// A bus without boards: all accesses fail.
    Silent(Silent),
}

impl Bus for ProcessBus {
    type Error = BusAccessError;

    #[inline]
    fn read(&self, address: usize, width: Width) -> Result<u32, BusAccessError> {
        match self {
            Self::Mapped(bus) => bus.read(address, width),
            Self::Silent(bus) => bus.read(address, width),
        }
    }

    #[inline]
    fn write(&self, address: usize, width: Width, value: u32) -> Result<(), BusAccessError> {
        match self {
            Self::Mapped(bus) => bus.write(address, width, value),
            Self::Silent(bus) => bus.write(address, width, value),
        }
    }
}
