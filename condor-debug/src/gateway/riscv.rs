//! RV64 with double floats: the frame of its trap handler, and its registers as GDB sees them.
//!
//! `gdbstub_arch` has the integer registers alone; here are the floating-point ones, too. The target
//! description says that the operating system is Linux: then GDB steps by temporary breakpoints, since
//! RISC-V has no trap after one instruction.

use std::num::NonZeroUsize;

use gdbstub::arch::{Arch, RegId, Registers};

/// The places of a frame: `x1` to `x31` are at 0 to 30.
pub mod frame {
    /// The address of the next instruction.
    pub const PC: u32 = 31;
    /// `mstatus`.
    pub const STATUS: u32 = 32;
    /// `mcause` of the trap.
    pub const CAUSE: u32 = 33;
    /// `mtval` of the trap.
    pub const VALUE: u32 = 34;
    /// `f0` to `f31` are here and behind.
    pub const FLOATS: u32 = 35;
    /// `fcsr`.
    pub const FCSR: u32 = 67;
}

/// The registers, as GDB reads and writes them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Rv64Registers {
    /// `x0` to `x31`.
    pub x: [u64; 32],
    /// The address of the next instruction.
    pub pc: u64,
    /// The bits of `f0` to `f31`.
    pub f: [u64; 32],
    /// The control and status register of floating point.
    pub fcsr: u32,
}

impl Rv64Registers {
    fn parts(fcsr: u32) -> [u32; 3] {
        [fcsr & 0x1f, fcsr >> 5 & 7, fcsr & 0xff]
    }
}

impl Registers for Rv64Registers {
    type ProgramCounter = u64;

    fn pc(&self) -> u64 {
        self.pc
    }

    fn gdb_serialize(&self, mut write_byte: impl FnMut(Option<u8>)) {
        let words = self.x.iter().chain([&self.pc]).chain(&self.f);
        let bytes = words.flat_map(|word| word.to_le_bytes());
        let parts = Self::parts(self.fcsr);
        bytes
            .chain(parts.into_iter().flat_map(u32::to_le_bytes))
            .for_each(|byte| write_byte(Some(byte)));
    }

    fn gdb_deserialize(&mut self, bytes: &[u8]) -> Result<(), ()> {
        let (words, parts) = bytes.split_at_checked(8 * 65).ok_or(())?;
        let (words, _) = words.as_chunks::<8>();
        let mut words = words.iter().map(|word| u64::from_le_bytes(*word));
        let places = self.x.iter_mut().chain([&mut self.pc]).chain(&mut self.f);
        for (place, word) in places.zip(&mut words) {
            *place = word;
        }
        // The third part is `fcsr`; the others are its parts, of which GDB may change either.
        let (parts, _) = parts.as_chunks::<4>();
        let [flags, mode, whole] = parts else {
            return Err(());
        };
        let [flags, mode, whole] = [flags, mode, whole].map(|part| u32::from_le_bytes(*part));
        let [old_flags, old_mode, old] = Self::parts(self.fcsr);
        self.fcsr = if whole == old && (flags, mode) != (old_flags, old_mode) {
            (flags & 0x1f) | (mode & 7) << 5
        } else {
            whole & 0xff
        };
        Ok(())
    }
}

/// The number of a register; its size in bytes is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rv64Register(pub usize);

impl RegId for Rv64Register {
    fn from_raw_id(id: usize) -> Option<(Self, Option<NonZeroUsize>)> {
        let bytes = match id {
            0..=64 => 8,
            65..=67 => 4,
            _ => return None,
        };
        Some((Self(id), NonZeroUsize::new(bytes)))
    }
}

/// RV64GC for `gdbstub`.
#[derive(Debug)]
pub enum Rv64 {}

impl Arch for Rv64 {
    type Usize = u64;
    type Registers = Rv64Registers;
    type BreakpointKind = usize;
    type RegId = Rv64Register;

    fn target_description_xml() -> Option<&'static str> {
        Some(DESCRIPTION)
    }
}

const DESCRIPTION: &str = include_str!("riscv.xml");

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn registers_come_back_as_they_went() {
        let mut registers = Rv64Registers {
            pc: 0x8000_1234,
            fcsr: 0xe1,
            ..Default::default()
        };
        for (place, x) in registers.x.iter_mut().enumerate() {
            *x = 0x0101_0101_0101_0101 * place as u64;
        }
        registers.f[31] = f64::to_bits(-1.5);
        let mut bytes = Vec::new();
        registers.gdb_serialize(|byte| bytes.push(byte.unwrap_or(0)));
        assert_eq!(bytes.len(), 65 * 8 + 3 * 4);
        let mut read = Rv64Registers::default();
        assert_eq!(read.gdb_deserialize(&bytes), Ok(()));
        assert_eq!(read, registers);
        assert_eq!(read.gdb_deserialize(&bytes[1..]), Err(()));
    }

    #[test]
    fn the_description_names_as_many_registers_as_there_are() {
        assert_eq!(DESCRIPTION.matches("<reg ").count(), 65 + 3);
        assert!(DESCRIPTION.contains("<osabi>GNU/Linux</osabi>"));
    }
}
