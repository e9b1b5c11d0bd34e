//! The drivers that ship, each with the table of its registers; `sim` has their models.

pub(crate) mod register;
mod uart16550;

#[cfg(all(test, feature = "sim"))]
mod interrupted_tests;

pub use uart16550::{Format, LineErrors, Uart16550};
