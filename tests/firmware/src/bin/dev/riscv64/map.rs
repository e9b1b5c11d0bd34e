//! The addresses of QEMU's machine `virt`.

use condor_dev::riscv::{Context, GuardedMmio, Plic};
use condor_dev::{InterruptLevel, Mmio};

/// The 16550, and its source at the PLIC.
pub(crate) const UART: usize = 0x1000_0000;
pub(crate) const UART_VECTOR: u16 = 10;
/// A virtio slot: a device answers there that is not a board of this program.
pub(crate) const VIRTIO: usize = 0x1000_1000;
/// An address where nothing answers.
pub(crate) const NOWHERE: usize = 0x1000_9000;

const PLIC: usize = 0x0c00_0000;
const PLIC_SOURCES: u16 = 95;
const HIGHEST: InterruptLevel = InterruptLevel(7);
/// The context of hart 0 in machine mode.
const HART_0: Context = Context::new(0).unwrap();

const RAM: usize = 0x8000_0000;

/// All below the memory of the machine.
// SAFETY: no memory that Rust knows of is there; `fault` asks `on_fault`. The devices there that
// write to memory, of virtio, are told no addresses by anybody.
pub(crate) const BUS: GuardedMmio = unsafe { GuardedMmio::new(Mmio::new(0, RAM)) };

/// Returns the PLIC for the interrupts of hart 0, the only one that runs.
pub(crate) const fn plic() -> Plic<GuardedMmio> {
    Plic::new(BUS, PLIC, HART_0, PLIC_SOURCES, HIGHEST)
}
