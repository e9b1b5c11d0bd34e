//! The serial port of a hart's program: a 16550 on the machine's PCI bus, which QEMU connects to a terminal device.
//!
//! Hart *n* has the card in slot *n* + 1. Its registers are ports of the bus, at a place that the program chooses before
//! it uses them.

use condor_dev::{Bus as _, BusAccessError, InterruptVector, Mmio};
use condor_rt::SERIAL;
use qemu_virt_host::map::SERIAL_HARTS;

use crate::machine::{PCI_CONFIGURATION, PCI_PORTS, PCI_SOURCES};

/// The words of a card's configuration (PCI Local Bus Specification 3.0, section 6.1).
mod word {
    pub(super) const IDENTITY: usize = 0x00;
    pub(super) const COMMAND: usize = 0x04;
    pub(super) const PLACE: usize = 0x10;
}

/// The identity of QEMU's `pci-serial`.
const CARD: u32 = 0x0002_1b36;
/// Has the card answer at its ports.
const ANSWER: u32 = 1 << 0;
const REGISTERS: usize = 8;

/// The registers of the port of a hart at [`SERIAL`], and its source in the PLIC; no registers and no source, if the
/// machine has no port for it. Cards have the four sources in turn.
pub(crate) fn find(hart: u32) -> (Mmio, Option<InterruptVector>) {
    let found = slot(hart).filter(|slot| answers(*slot).is_ok_and(|card| card));
    let registers = PCI_PORTS + port(found.unwrap_or(0));
    let len = if found.is_some() { REGISTERS } else { 0 };
    // SAFETY: the card has these registers, and its hart alone uses them.
    let registers = unsafe { Mmio::translated(registers as *mut u8, SERIAL.base(), len) };
    let source = found.map(|slot| InterruptVector(PCI_SOURCES + slot as u16 % 4));
    (registers, source)
}

/// Has the card in a slot answer at its ports, if there is one.
fn answers(slot: usize) -> Result<bool, BusAccessError> {
    let configuration = PCI_CONFIGURATION + (slot << 15);
    // SAFETY: the machine has the configuration of each slot there, whether there is a card or not.
    let card = unsafe { Mmio::translated(configuration as *mut u8, 0, 0x1000) };
    if card.read32(word::IDENTITY)? != CARD {
        return Ok(false);
    }
    // Nothing else is at these ports.
    card.write32(word::PLACE, port(slot) as u32)?;
    card.write32(word::COMMAND, ANSWER)?;
    Ok(true)
}

const fn slot(hart: u32) -> Option<usize> {
    if hart < SERIAL_HARTS {
        Some(hart as usize + 1)
    } else {
        None
    }
}

const fn port(slot: usize) -> usize {
    0x1000 + slot * REGISTERS
}
