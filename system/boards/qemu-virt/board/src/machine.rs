//! The addresses of the devices of the machine, from its device tree.

use core::num::NonZeroU32;

use condor_mos::Rate;

/// RAM: what the host maps.
pub(crate) const RAM: usize = 0x8000_0000;
/// The address in the RAM at which programs go back to the monitor, whose first instruction is that of a
/// cold start.
pub(crate) const MONITOR: usize = RAM + 4;
/// The core-local interruptor.
pub(crate) const CLINT: usize = 0x0200_0000;
/// The platform-level interrupt controller.
pub(crate) const PLIC: usize = 0x0c00_0000;
pub(crate) const PLIC_BYTES: usize = 0x60_0000;
/// The number of its sources, and below its highest priority.
pub(crate) const PLIC_SOURCES: u16 = 96;
pub(crate) const PLIC_HIGHEST: u8 = 7;
/// The serial port, a 16550, and its interrupt.
pub(crate) const UART: usize = 0x1000_0000;
pub(crate) const UART_BYTES: usize = 0x100;
pub(crate) const UART_VECTOR: u16 = 10;
/// The PCI bus: the configuration of its cards, its ports, and the first of the four sources of its interrupts.
pub(crate) const PCI_CONFIGURATION: usize = 0x3000_0000;
pub(crate) const PCI_PORTS: usize = 0x0300_0000;
pub(crate) const PCI_SOURCES: u16 = 32;
/// Ends QEMU.
pub(crate) const SWITCH: usize = 0x0010_0000;

/// The frequency at which `mtime` counts, in Hz.
pub(crate) const MTIME_HZ: NonZeroU32 = NonZeroU32::new(10_000_000).unwrap();
/// The rate of `mtime`, the counter of time that all harts share: 10 MHz.
pub const MTIME: Rate = Rate::hz(MTIME_HZ.get());

/// Machine interrupts, as bits of `mie`.
pub(crate) const SOFTWARE: usize = 1 << 3;
/// The interrupt of boards behind the PLIC.
pub(crate) const EXTERNAL: usize = 1 << 11;
/// The interrupt of the serial line between harts and host: that of supervisor mode, which machine mode takes.
pub(crate) const LINE: usize = 1 << 9;

/// Causes of traps.
pub(crate) mod cause {
    const INTERRUPT: usize = 1 << (usize::BITS - 1);
    pub(crate) const SOFTWARE: usize = INTERRUPT | 0x3;
    pub(crate) const EXTERNAL: usize = INTERRUPT | 0xb;
    pub(crate) const LINE: usize = INTERRUPT | 0x9;
}
