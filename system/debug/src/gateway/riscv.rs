//! RV64 with double floats: the frame of its trap handler, and its registers as GDB sees them.
//!
//! The target description says that there is no operating system: then GDB leaves steps to the gateway.

use condor_mbox::MemoryWindow;

use crate::{Tracer, TracerError};

/// The places of registers in the frame of a RISC-V processor, as
/// [`Tracer::register`](crate::Tracer::register) counts them. The places 0 to 30 are those of `x1`
/// to `x31`.
pub mod frame {
    /// The place of the program counter: the address of the next instruction.
    pub const PC: u32 = 31;
    /// The place of the register `mstatus`.
    pub const STATUS: u32 = 32;
    /// The place of the register `mcause`, which has the cause of the trap.
    pub const CAUSE: u32 = 33;
    /// The place of the register `mtval`, which has the value of the trap, such as an address.
    pub const VALUE: u32 = 34;
    /// The place of the floating-point register `f0`; `f1` to `f31` are at the places after it.
    pub const FLOATS: u32 = 35;
    /// The place of the register `fcsr`: rounding mode and exception flags of floating point.
    pub const FCSR: u32 = 67;
}

/// The number of registers that GDB knows: 65 of 8 bytes, and the three views of `fcsr` of 4.
const WIDE: u32 = 65;
const REGISTERS: u32 = WIDE + 3;

/// The place of a register in the frame: `x1` to `x31`, `pc`, then `f0` to `f31`; `None` for `x0`.
fn place(register: u32) -> Option<u32> {
    match register {
        0 => None,
        1..=31 => Some(register - 1),
        32 => Some(frame::PC),
        _ => Some(frame::FLOATS + register - 33),
    }
}

/// `fflags`, `frm` and `fcsr` as a shift and a mask of the last.
fn view(register: u32) -> (u32, u64) {
    match register - WIDE {
        0 => (0, 0x1f),
        1 => (5, 7),
        _ => (0, 0xff),
    }
}

/// Reads a register of the held program as GDB numbers it; `None` if there is none such.
pub(super) fn read<W: MemoryWindow>(
    tracer: &Tracer<W>,
    register: u32,
) -> Result<Option<Vec<u8>>, TracerError> {
    if register >= REGISTERS {
        return Ok(None);
    }
    if register < WIDE {
        let value = place(register).map_or(Ok(0), |place| tracer.register(place))?;
        return Ok(Some(value.to_le_bytes().to_vec()));
    }
    let (shift, mask) = view(register);
    let value = tracer.register(frame::FCSR)? >> shift & mask;
    Ok(Some((value as u32).to_le_bytes().to_vec()))
}

/// Sets a register to the first of these bytes. Returns how many they are; `None` if there is no such
/// register, or they are too few.
pub(super) fn write<W: MemoryWindow>(
    tracer: &Tracer<W>,
    register: u32,
    bytes: &[u8],
) -> Result<Option<usize>, TracerError> {
    if register < WIDE {
        let Some(value) = bytes.first_chunk() else {
            return Ok(None);
        };
        if let Some(place) = place(register) {
            tracer.set_register(place, u64::from_le_bytes(*value))?;
        }
        return Ok(Some(value.len()));
    }
    let (true, Some(value)) = (register < REGISTERS, bytes.first_chunk()) else {
        return Ok(None);
    };
    let (shift, mask) = view(register);
    let old = tracer.register(frame::FCSR)?;
    let new = (u64::from(u32::from_le_bytes(*value)) & mask) << shift;
    tracer.set_register(frame::FCSR, old & !(mask << shift) | new)?;
    Ok(Some(value.len()))
}

/// All registers of the held program.
pub(super) fn read_all<W: MemoryWindow>(tracer: &Tracer<W>) -> Result<Vec<u8>, TracerError> {
    let mut all = Vec::new();
    for register in 0..REGISTERS {
        all.extend(read(tracer, register)?.unwrap_or_default());
    }
    Ok(all)
}

/// Sets all registers. Returns true if there were enough bytes.
pub(super) fn write_all<W: MemoryWindow>(
    tracer: &Tracer<W>,
    mut bytes: &[u8],
) -> Result<bool, TracerError> {
    // The last is `fcsr` as a whole, and counts.
    for register in 0..REGISTERS {
        let Some(count) = write(tracer, register, bytes)? else {
            return Ok(false);
        };
        bytes = bytes.get(count..).unwrap_or_default();
    }
    Ok(true)
}

/// The registers, for GDB.
pub(super) const DESCRIPTION: &str = include_str!("riscv.xml");

#[cfg(test)]
mod tests {
    use condor_mbox::sim::SimWindow;

    use super::*;

    #[test]
    fn registers_come_back_as_they_went() {
        let area = condor_mbox::Region::whole(SimWindow::new(crate::AREA_BYTES));
        let tracer = Tracer::new(area, || {});
        let mut bytes: Vec<u8> = (0..=255).cycle().take(65 * 8 + 3 * 4).collect();
        assert_eq!(write_all(&tracer, &bytes), Ok(true));
        assert_eq!(write_all(&tracer, &bytes[..500]), Ok(false));
        // `x0` is zero, and the last view of `fcsr` counts.
        bytes[..8].fill(0);
        let fcsr = bytes[65 * 8 + 8];
        let parts = [fcsr & 0x1f, fcsr >> 5, fcsr].map(|part| u32::from(part).to_le_bytes());
        bytes.truncate(65 * 8);
        bytes.extend(parts.concat());
        assert_eq!(read_all(&tracer), Ok(bytes));
    }

    #[test]
    fn a_part_of_the_control_register_is_written_alone() {
        let area = condor_mbox::Region::whole(SimWindow::new(crate::AREA_BYTES));
        let tracer = Tracer::new(area, || {});
        assert_eq!(write(&tracer, 67, &[0xff, 0, 0, 0]), Ok(Some(4)));
        assert_eq!(write(&tracer, 66, &[2, 0, 0, 0]), Ok(Some(4)));
        assert_eq!(tracer.register(frame::FCSR), Ok(0x5f));
        assert_eq!(read(&tracer, 66), Ok(Some(vec![2, 0, 0, 0])));
        for missing in [68, u32::MAX] {
            assert_eq!(read(&tracer, missing), Ok(None));
            assert_eq!(write(&tracer, missing, &[0; 8]), Ok(None));
        }
    }

    #[test]
    fn the_description_names_as_many_registers_as_there_are() {
        assert_eq!(DESCRIPTION.matches("<reg ").count(), 65 + 3);
        assert!(DESCRIPTION.contains("<osabi>none</osabi>"));
    }
}
