//! The controller hierarchy of a hand, with 32-bit floating-point registers and 64 bits in software.
#![no_std]
#![no_main]

use core::panic::PanicInfo;

use checks::Checks;
// Its critical section is what semihosting takes.
use cortex_m as _;
use cortex_m_semihosting::{debug, hprint};

#[cortex_m_rt::entry]
fn main() -> ! {
    let mut checks = Checks::new(&print);
    hand_exercise::same_bits(&mut checks, &print);
    may_panic(0);
    switch_off(checks.conclude());
}

/// Puts text on the console of the debugger.
fn print(text: &str) {
    hprint!("{}", text);
}

/// Ends QEMU, with success or not.
fn switch_off(success: bool) -> ! {
    loop {
        debug::exit(if success {
            debug::EXIT_SUCCESS
        } else {
            debug::EXIT_FAILURE
        });
    }
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
