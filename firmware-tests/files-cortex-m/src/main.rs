//! The calls of [`files_exercise`] on a core without compare-and-swap.
#![no_std]
#![no_main]

mod machine;
mod stack;

use core::panic::PanicInfo;

use checks::Checks;
// Its critical section.
use cortex_m as _;
use files_exercise::Memory;
use machine::{now, print, start_clock, switch_off};

static MEMORY: Memory = Memory::new();

/// What the exercise may take of the stack, the checks and the host's end included.
const STACK_BYTES: usize = 11 * 1024;

#[cortex_m_rt::entry]
fn main() -> ! {
    start_clock();
    let mut checks = Checks::new(&print);
    files_exercise::everything(&mut checks, &MEMORY, now);
    checks.group("the stack");
    let used = stack::used();
    stack::report(&mut checks, used);
    checks.that("it takes 11 KiB at most", used <= STACK_BYTES);
    may_panic(used);
    switch_off(checks.conclude());
}

/// Panics, if built to: the search for panicking paths must find this one.
fn may_panic(index: usize) {
    if cfg!(feature = "panicking") {
        let table = core::hint::black_box([0_u8; 4]);
        core::hint::black_box(table[core::hint::black_box(index)]);
    }
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    if let Some(place) = info.location() {
        print("panic in ");
        print(place.file());
        print("\n");
    }
    condor_firmware_panicked()
}

/// The name that is searched for in the linked image: it is there only if something can panic.
#[unsafe(no_mangle)]
#[inline(never)]
extern "C" fn condor_firmware_panicked() -> ! {
    switch_off(false)
}
