//! QEMU's machine `virt`: what is where, its console without interrupts, and its switch.

use condor_dev::riscv::{Context, GuardedMmio, Plic};
use condor_dev::{Bus as _, Level, Mmio};

/// The 16550, and its source at the PLIC.
pub(crate) const UART: usize = 0x1000_0000;
pub(crate) const UART_VECTOR: u16 = 10;
/// A virtio slot: something answers there, which is no board of this program.
pub(crate) const VIRTIO: usize = 0x1000_1000;
/// Where nothing answers.
pub(crate) const NOWHERE: usize = 0x1000_9000;

const PLIC: usize = 0x0c00_0000;
const PLIC_SOURCES: u16 = 95;
const HIGHEST: Level = Level(7);
/// The context of hart 0 in machine mode.
const HART_0: Context = match Context::new(0) {
    Some(context) => context,
    None => panic!("a PLIC has that"),
};

const RAM: usize = 0x8000_0000;

/// All below the memory of the machine.
// SAFETY: no memory that Rust knows of is there; `trap` asks `on_fault`. The devices there that
// write to memory, of virtio, are told no addresses by anybody.
pub(crate) const BUS: GuardedMmio = unsafe { GuardedMmio::new(Mmio::new(0, RAM)) };

/// The interrupts of hart 0, the only one that runs.
pub(crate) const fn plic() -> Plic<GuardedMmio> {
    Plic::new(BUS, PLIC, HART_0, PLIC_SOURCES, HIGHEST)
}

const UART_LINE_STATUS: usize = UART + 5;
const UART_READY: u8 = 1 << 5;
const SWITCH: usize = 0x0010_0000;
const SWITCH_PASS: u32 = 0x5555;
const SWITCH_FAIL: u32 = 0x3333 | 1 << 16;

/// Puts text on the console, while the driver has nothing to send.
pub(crate) fn print(text: &str) {
    for byte in text.bytes() {
        while BUS
            .read8(UART_LINE_STATUS)
            .is_ok_and(|status| status & UART_READY == 0)
        {}
        // The machine has a console.
        let _ = BUS.write8(UART, byte);
    }
}

/// Ends QEMU, with success or not.
pub(crate) fn switch_off(success: bool) -> ! {
    let word = if success { SWITCH_PASS } else { SWITCH_FAIL };
    loop {
        // The machine has its switch here.
        let _ = BUS.write32(SWITCH, word);
    }
}
