//! QEMU's machine `virt`: its console, its switch, and where its clock is.

use condor_mos::Rate;

/// The core-local interruptor.
pub(crate) const CLINT: usize = 0x0200_0000;
/// How often its `mtime` counts in a second.
pub(crate) const MTIME: Rate = Rate::hz(10_000_000);

const MSIP: *mut u32 = CLINT as *mut u32;
const UART: *mut u8 = 0x1000_0000 as *mut u8;
const UART_LINE_STATUS: usize = 5;
const UART_READY: u8 = 1 << 5;
const SWITCH: *mut u32 = 0x0010_0000 as *mut u32;
const SWITCH_PASS: u32 = 0x5555;
const SWITCH_FAIL: u32 = 0x3333 | 1 << 16;

/// Puts text on the console.
pub(crate) fn print(text: &str) {
    for byte in text.bytes() {
        // SAFETY: the machine has a 16550 here, which nothing else in this program touches.
        unsafe {
            while UART.add(UART_LINE_STATUS).read_volatile() & UART_READY == 0 {}
            UART.write_volatile(byte);
        }
    }
}

/// Raises the software interrupt of hart 0, or takes it back.
pub(crate) fn ring(pending: bool) {
    // SAFETY: the first register of the CLINT is that of hart 0, which only this function uses.
    unsafe { MSIP.write_volatile(pending.into()) };
}

/// Ends QEMU, with success or not.
pub(crate) fn switch_off(success: bool) -> ! {
    let word = if success { SWITCH_PASS } else { SWITCH_FAIL };
    loop {
        // SAFETY: the machine has its switch here.
        unsafe { SWITCH.write_volatile(word) };
    }
}
