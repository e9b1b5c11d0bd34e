#![doc = include_str!("../README.md")]
#![cfg_attr(
    any(
        target_os = "none",
        not(any(feature = "linux", feature = "critical-section"))
    ),
    no_std
)]

mod float;

#[cfg(all(feature = "linux", target_os = "linux"))]
pub mod linux;

#[cfg(all(
    feature = "riscv",
    any(target_arch = "riscv32", target_arch = "riscv64")
))]
pub mod riscv;

#[cfg(all(feature = "critical-section", not(target_os = "none")))]
mod section;

pub use float::FloatExceptions;
