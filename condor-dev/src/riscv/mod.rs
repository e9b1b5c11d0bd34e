//! Bare-metal RISC-V: interrupts from a PLIC, and, for these processors alone, registers whose absence
//! is survived (`GuardedMmio`).

mod plic;

pub use plic::{Context, Plic};

#[cfg(any(target_arch = "riscv32", target_arch = "riscv64"))]
mod guarded;

#[cfg(any(target_arch = "riscv32", target_arch = "riscv64"))]
pub use guarded::{GuardedMmio, on_fault};
