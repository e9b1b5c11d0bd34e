//! `mps2-an385`, `mps2-an386` and `microbit`.

// Its critical section.
use cortex_m as _;
use cortex_m_rt::STACK_PAINT_VALUE;
pub use cortex_m_rt::entry;
use cortex_m_semihosting::{debug, hprint};

/// The frequency of the core, Hz.
pub const CORE_HZ: u32 = if cfg!(microbit) {
    16_000_000
} else {
    25_000_000
};

/// Puts text on the console of the debugger.
pub fn print(text: &str) {
    hprint!("{}", text);
}

/// Ends QEMU, with success or not.
pub fn switch_off(success: bool) -> ! {
    loop {
        debug::exit(if success {
            debug::EXIT_SUCCESS
        } else {
            debug::EXIT_FAILURE
        });
    }
}

unsafe extern "C" {
    static _stack_end: u32;
    static _stack_start: u32;
}

/// Returns the most bytes of stack that were in use at a time since the start, when `cortex-m-rt` painted
/// it.
#[must_use]
pub fn stack_used() -> usize {
    let start = (&raw const _stack_start).addr();
    let mut unused = &raw const _stack_end;
    // SAFETY: the linker puts RAM for the stack between the two. What is above the lowest word that
    // is not painted any more is not looked at.
    while unused.addr() < start && unsafe { unused.read_volatile() } == STACK_PAINT_VALUE {
        unused = unused.wrapping_add(1);
    }
    start.saturating_sub(unused.addr())
}

/// `TIMER0` of the nRF51822.
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

/// Starts the clock of `microbit`: one count a microsecond; it wraps after 71 minutes.
pub fn start_clock() {
    write(PRESCALER, PRESCALER_1_MHZ);
    write(BITMODE, BITMODE_32);
    write(TASKS_START, 1);
}

/// Returns the nanoseconds since [`start_clock`]. If an interrupt asks in between, the result is later,
/// never earlier.
#[must_use]
pub fn now_ns() -> u64 {
    write(TASKS_CAPTURE_0, 1);
    // SAFETY: the chip has this register, and nothing else uses the timer.
    let us = unsafe { (CC_0 as *const u32).read_volatile() };
    u64::from(us) * NS_PER_US
}

fn write(register: usize, value: u32) {
    // SAFETY: the chip has this register, and nothing else uses the timer.
    unsafe { (register as *mut u32).write_volatile(value) };
}
