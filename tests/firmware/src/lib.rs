//! The parts that the programs of this package share: the machines of QEMU, how they start, print and
//! end, and the checks that they make.
#![no_std]

#[cfg(target_arch = "arm")]
mod arm;
mod checks;
#[cfg(target_arch = "riscv64")]
mod riscv64;

use core::hint::black_box;
use core::panic::PanicInfo;

#[cfg(target_arch = "arm")]
pub use arm::*;
pub use checks::{Checks, Console};
#[cfg(target_arch = "riscv64")]
pub use riscv64::*;

/// Makes the checks of a program and ends QEMU, with success if all held.
pub fn check(exercise: impl FnOnce(&mut Checks)) -> ! {
    let mut checks = Checks::default();
    exercise(&mut checks);
    may_panic(0);
    switch_off(checks.conclude())
}

/// Keeps functions of types in the image that the program does not call, for any arguments: the search for paths
/// that panic looks at all that is there.
///
/// ```text
/// keep! { Type: function, generic_function::<u32>; Other: method; }
/// ```
#[macro_export]
macro_rules! keep {
    ($($of:ty: $($name:ident $(::<$($generic:ty),+>)?),+;)+) => {
        $(::core::hint::black_box([$(<$of>::$name $(::<$($generic),+>)? as *const ()),+]);)+
    };
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
