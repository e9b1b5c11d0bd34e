//! The simulated bus conforms, and buses with a fault do not.

use condor_dev::conformance::{self, Ground};
use condor_dev::sim::{self, Model};
use condor_dev::{Bus, BusError, BusErrorKind, Width};

/// A board that is nothing but memory.
struct Memory([u8; 16]);

impl Model for Memory {
    fn size(&self) -> usize {
        self.0.len()
    }

    fn read(&mut self, offset: usize, width: Width) -> Option<u32> {
        let bytes = self.0.get(offset..)?;
        Some(match width {
            Width::Bits8 => bytes[0].into(),
            Width::Bits16 => u16::from_ne_bytes(*bytes.first_chunk()?).into(),
            Width::Bits32 => u32::from_ne_bytes(*bytes.first_chunk()?),
        })
    }

    fn write(&mut self, offset: usize, width: Width, value: u32) -> Option<()> {
        let bytes = self.0.get_mut(offset..)?;
        match width {
            Width::Bits8 => bytes[0] = value as u8,
            Width::Bits16 => *bytes.first_chunk_mut()? = (value as u16).to_ne_bytes(),
            Width::Bits32 => *bytes.first_chunk_mut()? = value.to_ne_bytes(),
        }
        Some(())
    }
}

const GROUND: Ground = Ground {
    memory: 0x100,
    absent: Some(0x110),
    refuses_misaligned: true,
};

fn memory() -> sim::Bus {
    let bus = sim::Bus::new();
    bus.insert(0x100, Memory([0; 16]));
    bus
}

#[test]
fn the_simulated_bus_conforms() {
    assert_eq!(conformance::bus(&memory(), GROUND), Ok(()));
    // And so does a reference to one.
    assert_eq!(conformance::bus(&&memory(), GROUND), Ok(()));
}

/// What is wrong with a bus.
#[derive(Clone, Copy, Debug, PartialEq)]
enum BusFault {
    SplitsMisaligned,
    SwapsBytes,
    WritesWords,
    NeverFails,
    WrongKind,
    LooksByWriting,
}

struct FaultyBus(sim::Bus, BusFault);

#[derive(Debug)]
struct FaultyError(BusErrorKind);

impl BusError for FaultyError {
    fn kind(&self) -> BusErrorKind {
        self.0
    }
}

impl FaultyBus {
    fn result<T: Default>(&self, result: Result<T, sim::SimBusError>) -> Result<T, FaultyError> {
        match (result, self.1) {
            (Ok(value), _) => Ok(value),
            (Err(_), BusFault::NeverFails) => Ok(T::default()),
            (Err(_), BusFault::WrongKind) => Err(FaultyError(BusErrorKind::ReadOnly)),
            (Err(error), _) => Err(FaultyError(error.kind)),
        }
    }

    fn aligned(&self, address: usize, width: usize) -> usize {
        if self.1 == BusFault::SplitsMisaligned {
            address & !(width - 1)
        } else {
            address
        }
    }
}

impl Bus for FaultyBus {
    type Error = FaultyError;

    fn read8(&self, address: usize) -> Result<u8, FaultyError> {
        self.result(self.0.read8(address))
    }

    fn read16(&self, address: usize) -> Result<u16, FaultyError> {
        let value = self.result(self.0.read16(self.aligned(address, 2)))?;
        Ok(if self.1 == BusFault::SwapsBytes {
            value.swap_bytes()
        } else {
            value
        })
    }

    fn read32(&self, address: usize) -> Result<u32, FaultyError> {
        self.result(self.0.read32(self.aligned(address, 4)))
    }

    fn write8(&self, address: usize, value: u8) -> Result<(), FaultyError> {
        if self.1 == BusFault::WritesWords {
            let word = u16::from(value) | u16::from(value) << 8;
            return self.result(self.0.write16(address & !1, word));
        }
        self.result(self.0.write8(address, value))
    }

    fn write16(&self, address: usize, value: u16) -> Result<(), FaultyError> {
        let value = if self.1 == BusFault::SwapsBytes {
            value.swap_bytes()
        } else {
            value
        };
        self.result(self.0.write16(self.aligned(address, 2), value))
    }

    fn write32(&self, address: usize, value: u32) -> Result<(), FaultyError> {
        self.result(self.0.write32(self.aligned(address, 4), value))
    }

    fn answers(&self, address: usize, width: Width) -> bool {
        match (self.1, width) {
            (BusFault::LooksByWriting, _) => self.write8(address, 0).is_ok(),
            (_, Width::Bits8) => self.read8(address).is_ok(),
            (_, Width::Bits16) => self.read16(address).is_ok(),
            (_, Width::Bits32) => self.read32(address).is_ok(),
        }
    }
}

#[test]
fn a_bus_with_a_fault_does_not_conform() {
    for fault in [
        BusFault::SplitsMisaligned,
        BusFault::SwapsBytes,
        BusFault::WritesWords,
        BusFault::NeverFails,
        BusFault::WrongKind,
        BusFault::LooksByWriting,
    ] {
        let found = conformance::bus(&FaultyBus(memory(), fault), GROUND);
        assert!(found.is_err(), "{fault:?}");
    }
}
