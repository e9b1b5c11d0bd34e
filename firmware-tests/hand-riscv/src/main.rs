//! The controller hierarchy of a hand, in 64-bit floating-point registers.
#![no_std]
#![no_main]

mod machine;

use core::panic::PanicInfo;

use checks::Checks;
use machine::{print, switch_off};

// Floating point is on: `FS` is initial.
core::arch::global_asm!(
    include_str!("../../one-hart.s"),
    include_str!("trap.s"),
    mstatus = const 0x2000
);

/// Where hart 0 comes from `one-hart.s`.
#[unsafe(no_mangle)]
extern "C" fn main(hart: usize) {
    let mut checks = Checks::new(&print);
    hand_exercise::same_bits(&mut checks, &print);
    may_panic(hart);
    switch_off(checks.conclude());
}

/// Every trap comes here, and ends the program.
#[unsafe(no_mangle)]
extern "C" fn trap() {
    print("an exception\n");
    switch_off(false);
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
