//! The handler of panics: it prints the panic, and QEMU ends with an error.

use core::panic::PanicInfo;

use cortex_m_semihosting::hprintln;

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    hprintln!("{}", info);
    crate::switch_off(false)
}
