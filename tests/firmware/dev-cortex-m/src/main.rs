//! The calls of [`dev_exercise`] on a core without compare-and-swap.
#![no_std]
#![no_main]

#[machine::entry]
fn main() -> ! {
    machine::check(dev_exercise::everything)
}
