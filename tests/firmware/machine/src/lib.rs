//! The machines of QEMU that run the firmwares: how they start, print and end.
#![no_std]

#[cfg(target_arch = "arm")]
mod arm;
#[cfg(target_arch = "riscv64")]
mod riscv64;

use core::hint::black_box;
use core::panic::PanicInfo;

#[cfg(target_arch = "arm")]
pub use arm::*;
use checks::Checks;
#[cfg(target_arch = "riscv64")]
pub use riscv64::*;

/// Makes the checks of a firmware and ends QEMU, with success if all held.
pub fn check(exercise: impl FnOnce(&mut Checks<'_>)) -> ! {
    let mut checks = Checks::new(&print);
    exercise(&mut checks);
    may_panic(0);
    switch_off(checks.conclude())
}

/// Panics, if built to: the search for panicking paths must find this one.
fn may_panic(index: usize) {
    if cfg!(feature = "panicking") {
        let table = black_box([0_u8; 4]);
        black_box(table[black_box(index)]);
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

/// Names the place that is searched for in the linked image: it is there only if something can panic.
#[unsafe(no_mangle)]
#[inline(never)]
extern "C" fn condor_firmware_panicked() -> ! {
    switch_off(false)
}
