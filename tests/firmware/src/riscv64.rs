//! `virt`.

use riscv::register::{mstatus, time};
pub use riscv_rt::entry;

/// The core-local interruptor.
pub const CLINT: usize = 0x0200_0000;
/// The frequency of its `mtime`, Hz.
pub const MTIME_HZ: u32 = 10_000_000;
const TICK_NS: u64 = 1_000_000_000 / MTIME_HZ as u64;

const UART: *mut u8 = 0x1000_0000 as *mut u8;
const UART_LINE_STATUS: usize = 5;
const UART_READY: u8 = 1 << 5;
const SWITCH: *mut u32 = 0x0010_0000 as *mut u32;
const SWITCH_PASS: u32 = 0x5555;
const SWITCH_FAIL: u32 = 0x3333 | 1 << 16;

/// Puts text on the console, by the serial port that nothing else uses meanwhile.
pub fn print(text: &str) {
    for byte in text.bytes() {
        // SAFETY: the machine has a 16550 here.
        unsafe {
            while UART.add(UART_LINE_STATUS).read_volatile() & UART_READY == 0 {}
            UART.write_volatile(byte);
        }
    }
}

/// Ends QEMU, with success or not.
pub fn switch_off(success: bool) -> ! {
    let word = if success { SWITCH_PASS } else { SWITCH_FAIL };
    loop {
        // SAFETY: the machine has its switch here.
        unsafe { SWITCH.write_volatile(word) };
    }
}

/// Makes every use of floating point an exception, in a program that must not use it.
pub fn switch_floats_off() {
    // SAFETY: such a program has nothing in these registers.
    unsafe { mstatus::set_fs(mstatus::FS::Off) };
}

/// Returns the nanoseconds since the start.
#[must_use]
pub fn now_ns() -> u64 {
    time::read64().saturating_mul(TICK_NS)
}

/// Raises the machine software interrupt of this hart or another, or takes it back.
#[inline]
pub fn ring(hart: usize, pending: bool) {
    let msip = (CLINT as *mut u32).wrapping_add(hart);
    // SAFETY: the CLINT begins with a register for each hart, which has no other effect.
    unsafe { msip.write_volatile(pending.into()) };
}

/// Handles every trap for which the firmware has no handler; `riscv-rt` calls it.
#[unsafe(no_mangle)]
extern "C" fn abort() -> ! {
    print("an exception, or an interrupt that nobody enabled\n");
    switch_off(false)
}
