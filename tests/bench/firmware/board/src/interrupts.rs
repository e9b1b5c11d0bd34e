//! The interrupts of the board that firmwares use.

use cortex_m::interrupt::InterruptNumber;

/// The number of bits of a priority of the core. QEMU has eight; these are those of the FPGA image.
pub const NVIC_PRIO_BITS: u8 = 3;

/// An interrupt, by its number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
pub enum Interrupt {
    /// The alarm.
    TIMER0 = 8,
    /// A pin of port 0 that nothing drives.
    SPARE0 = 24,
    /// A pin of port 0 that nothing drives.
    SPARE1 = 25,
    /// A pin of port 0 that nothing drives.
    SPARE2 = 26,
    /// A pin of port 0 that nothing drives.
    SPARE3 = 27,
    /// A pin of port 0 that nothing drives.
    SPARE4 = 28,
    /// A pin of port 0 that nothing drives.
    SPARE5 = 29,
    /// A pin of port 0 that nothing drives.
    SPARE6 = 30,
    /// A pin of port 0 that nothing drives.
    SPARE7 = 31,
}

// SAFETY: the numbers are those of AN385, and the vector table below has a place for each.
unsafe impl InterruptNumber for Interrupt {
    fn number(self) -> u16 {
        self as u16
    }
}

/// Converts a priority of 1 (lowest) to 8 (highest), as RTIC counts them, to the value that the NVIC takes.
#[must_use]
pub const fn hardware_priority(logical: u8) -> u8 {
    ((1 << NVIC_PRIO_BITS) - logical) << (8 - NVIC_PRIO_BITS)
}

/// A place of the vector table.
type Vector = unsafe extern "C" fn();

unsafe extern "C" {
    fn DefaultHandler();
    fn TIMER0();
    fn SPARE0();
    fn SPARE1();
    fn SPARE2();
    fn SPARE3();
    fn SPARE4();
    fn SPARE5();
    fn SPARE6();
    fn SPARE7();
}

/// The vectors behind those of the core.
// SAFETY: `cortex-m-rt` keeps this section and this name for a table of this form.
#[unsafe(link_section = ".vector_table.interrupts")]
#[unsafe(no_mangle)]
static __INTERRUPTS: [Vector; 32] = {
    let mut vectors: [Vector; 32] = [DefaultHandler; 32];
    vectors[Interrupt::TIMER0 as usize] = TIMER0;
    vectors[Interrupt::SPARE0 as usize] = SPARE0;
    vectors[Interrupt::SPARE1 as usize] = SPARE1;
    vectors[Interrupt::SPARE2 as usize] = SPARE2;
    vectors[Interrupt::SPARE3 as usize] = SPARE3;
    vectors[Interrupt::SPARE4 as usize] = SPARE4;
    vectors[Interrupt::SPARE5 as usize] = SPARE5;
    vectors[Interrupt::SPARE6 as usize] = SPARE6;
    vectors[Interrupt::SPARE7 as usize] = SPARE7;
    vectors
};
