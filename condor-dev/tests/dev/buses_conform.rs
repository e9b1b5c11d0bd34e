//! The simulated bus conforms, and buses with a fault do not.

use condor_dev::conformance::{self, BusMemory};
use condor_dev::sim::{self, Model};
use condor_dev::{Bus, BusAccessError, BusErrorKind, Mmio, Width};

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

const GROUND: BusMemory = BusMemory {
    memory: 0x100,
    absent: Some(0x110),
    refuses_misaligned: true,
};

fn memory() -> sim::SimBus {
    let bus = sim::SimBus::new();
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
    WritesBlocksInPlace,
}

struct FaultyBus(sim::SimBus, BusFault);

impl FaultyBus {
    fn result<T: Default>(&self, result: Result<T, BusAccessError>) -> Result<T, BusErrorKind> {
        match (result, self.1) {
            (Ok(value), _) => Ok(value),
            (Err(_), BusFault::NeverFails) => Ok(T::default()),
            (Err(_), BusFault::WrongKind) => Err(BusErrorKind::ReadOnly),
            (Err(error), _) => Err(error.kind),
        }
    }

    fn aligned(&self, address: usize, width: Width) -> usize {
        if self.1 == BusFault::SplitsMisaligned {
            address & !(width.bytes() - 1)
        } else {
            address
        }
    }

    fn swapped(&self, width: Width, value: u32) -> u32 {
        if self.1 == BusFault::SwapsBytes && width == Width::Bits16 {
            (value as u16).swap_bytes().into()
        } else {
            value
        }
    }
}

impl Bus for FaultyBus {
    type Error = BusErrorKind;

    fn read(&self, address: usize, width: Width) -> Result<u32, BusErrorKind> {
        let value = self.result(self.0.read(self.aligned(address, width), width))?;
        Ok(self.swapped(width, value))
    }

    fn write(&self, address: usize, width: Width, value: u32) -> Result<(), BusErrorKind> {
        if self.1 == BusFault::WritesWords && width == Width::Bits8 {
            return self.result(self.0.write16(address & !1, value as u16 * 0x101));
        }
        let value = self.swapped(width, value);
        self.result(self.0.write(self.aligned(address, width), width, value))
    }

    fn write_block(&self, address: usize, from: &[u8]) -> Result<(), BusErrorKind> {
        for (offset, &byte) in from.iter().enumerate() {
            let offset = if self.1 == BusFault::WritesBlocksInPlace {
                0
            } else {
                offset
            };
            self.write8(address + offset, byte)?;
        }
        Ok(())
    }

    fn answers(&self, address: usize, width: Width) -> bool {
        match self.1 {
            BusFault::LooksByWriting => self.write8(address, 0).is_ok(),
            _ => self.read(address, width).is_ok(),
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
        BusFault::WritesBlocksInPlace,
    ] {
        let found = conformance::bus(&FaultyBus(memory(), fault), GROUND);
        assert!(found.is_err(), "{fault:?}");
    }
}

#[test]
fn registers_in_memory_conform() {
    let mut memory = [0_u64; 3];
    // SAFETY: the array is aligned, and reached through the bus alone as long as that is used.
    let bus = unsafe { Mmio::translated(memory.as_mut_ptr().cast(), 0x1000, 16) };
    for memory in [0x1000, 0x1008] {
        let ground = BusMemory {
            memory,
            absent: Some(0x1010),
            refuses_misaligned: true,
        };
        assert_eq!(conformance::bus(&bus, ground), Ok(()));
    }
    assert_eq!(memory[2], 0);
}

#[test]
fn what_is_outside_of_registers_is_not_accessed() {
    // SAFETY: nothing is accessed.
    let bus = unsafe { Mmio::translated(std::ptr::dangling_mut::<u32>().cast(), 0x1000, 2) };
    let kind = |result: Result<(), BusAccessError>| result.unwrap_err().kind;
    assert_eq!(kind(bus.write32(0x1000, 0)), BusErrorKind::OutOfRange);
    for address in [0xfff, 0x1002, usize::MAX] {
        assert_eq!(kind(bus.write8(address, 0)), BusErrorKind::OutOfRange);
    }
    assert_eq!(kind(bus.write16(0x1001, 0)), BusErrorKind::Misaligned);
    assert_eq!(kind(bus.write32(0x1002, 0)), BusErrorKind::Misaligned);
}
