//! `condor-dev`: a switch over boards that are memory, and on QEMU's RISC-V machine `virt` also on hardware that
//! nobody here wrote.
#![no_std]
#![no_main]

mod boards;
mod memory;
#[cfg(target_arch = "riscv64")]
mod riscv64;

#[firmware::entry]
fn main() -> ! {
    #[cfg(target_arch = "riscv64")]
    firmware::switch_floats_off();
    firmware::check(|checks| {
        boards::boards(checks);
        #[cfg(target_arch = "riscv64")]
        riscv64::devices(checks);
    })
}
