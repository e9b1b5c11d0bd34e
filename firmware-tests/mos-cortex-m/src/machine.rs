//! QEMU's machines `mps2-an385` and `microbit`: the console, and interrupts that nothing drives.

use cortex_m_semihosting::{debug, hprint};

/// Periods of `SysTick` in a second.
pub(crate) const TICK_HZ: u32 = 2_000;
/// How fast the core is.
pub(crate) const CORE_HZ: u32 = if cfg!(microbit) {
    16_000_000
} else {
    25_000_000
};

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

/// The first of two interrupts that no device uses: software interrupts of the nRF51.
pub(crate) const SPARE: u16 = 22;

/// A place of the vector table.
type Vector = extern "C" fn();

/// The vectors behind those of the core.
// SAFETY: `cortex-m-rt` keeps this section and this name for a table of this form.
#[unsafe(link_section = ".vector_table.interrupts")]
#[unsafe(no_mangle)]
static __INTERRUPTS: [Vector; 32] = {
    let mut vectors: [Vector; 32] = [unexpected; 32];
    let [middle, slowest] = crate::VECTORS;
    vectors[SPARE as usize] = middle;
    vectors[SPARE as usize + 1] = slowest;
    vectors
};

extern "C" fn unexpected() {
    print("an interrupt that nobody enabled\n");
    switch_off(false);
}
