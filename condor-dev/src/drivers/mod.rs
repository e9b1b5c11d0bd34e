//! The drivers of this crate, each with the table of its registers; `sim` has their models.

mod as5600;
mod pca9685;
pub(crate) mod register;
mod uart16550;

pub use as5600::{As5600, Magnet};
pub use pca9685::{ChipClock, ClockError, Pca9685};
pub use uart16550::{Format, LineErrors, Uart16550};
