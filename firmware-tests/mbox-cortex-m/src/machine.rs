//! QEMU's machine `microbit`: its console and its clock.

use condor_mbox::Instant;
use cortex_m_semihosting::{debug, hprint};

/// Puts text on the console of the debugger.
pub(crate) fn print(text: &str) {
    hprint!("{}", text);
}

/// Ends QEMU, with success or not.
pub(crate) fn switch_off(success: bool) -> ! {
    loop {
        debug::exit(if success {
            debug::EXIT_SUCCESS
        } else {
            debug::EXIT_FAILURE
        });
    }
}

const TIMER0: usize = 0x4000_8000;
const TASKS_START: usize = TIMER0;
const TASKS_CAPTURE_0: usize = TIMER0 + 0x40;
const BITMODE: usize = TIMER0 + 0x508;
const PRESCALER: usize = TIMER0 + 0x510;
const CC_0: usize = TIMER0 + 0x540;

const BITMODE_32: u32 = 3;
/// 16 MHz / 2⁴.
const PRESCALER_1_MHZ: u32 = 4;
const NS_PER_US: u64 = 1000;

/// Starts the clock: `TIMER0`, one count a microsecond; it wraps after 71 minutes.
pub(crate) fn start_clock() {
    write(PRESCALER, PRESCALER_1_MHZ);
    write(BITMODE, BITMODE_32);
    write(TASKS_START, 1);
}

/// The time since the start. An interrupt in between that asks too makes it later, never earlier.
pub(crate) fn now() -> Instant {
    write(TASKS_CAPTURE_0, 1);
    // SAFETY: the chip has this register, and nothing else uses the timer.
    let us = unsafe { (CC_0 as *const u32).read_volatile() };
    Instant::from_ns(u64::from(us) * NS_PER_US)
}

fn write(register: usize, value: u32) {
    // SAFETY: the chip has this register, and nothing else uses the timer.
    unsafe { (register as *mut u32).write_volatile(value) };
}
