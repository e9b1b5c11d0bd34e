//! The controller hierarchy of a hand. A hart has 64-bit floating-point registers; a Cortex-M4 has
//! 32-bit ones, and 64 bits in software.
#![no_std]
#![no_main]

#[machine::entry]
fn main() -> ! {
    machine::check(|checks| hand_exercise::same_bits(checks, &machine::print))
}
