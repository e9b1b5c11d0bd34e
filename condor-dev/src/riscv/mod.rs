//! Bare-metal RISC-V: interrupts from a PLIC, and, only on these processors, access to registers
//! that may be absent (`GuardedMmio`).

mod plic;

pub use plic::{Context, Plic};

#[cfg(any(target_arch = "riscv32", target_arch = "riscv64"))]
mod guarded;

#[cfg(any(target_arch = "riscv32", target_arch = "riscv64"))]
pub use guarded::{GuardedMmio, on_fault};
