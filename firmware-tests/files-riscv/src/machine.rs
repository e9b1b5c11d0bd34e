//! QEMU's machine `virt`: its console, its clock and its switch.

use condor_mbox::Instant;

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

/// Nanoseconds of a tick at 10 MHz.
const TICK_NS: u64 = 100;

/// The time since the start.
pub(crate) fn now() -> Instant {
    Instant::from_ns(riscv::register::time::read64().saturating_mul(TICK_NS))
}

/// Ends QEMU, with success or not.
pub(crate) fn switch_off(success: bool) -> ! {
    let word = if success { SWITCH_PASS } else { SWITCH_FAIL };
    loop {
        // SAFETY: the machine has its switch here.
        unsafe { SWITCH.write_volatile(word) };
    }
}
