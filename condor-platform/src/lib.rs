#![doc = include_str!("../README.md")]
#![cfg_attr(not(any(feature = "linux", feature = "critical-section")), no_std)]

#[cfg(all(feature = "linux", target_os = "linux"))]
pub mod linux;

#[cfg(feature = "critical-section")]
mod section;
