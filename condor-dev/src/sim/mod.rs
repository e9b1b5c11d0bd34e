//! Models of parts and their registers: in a joint, without allocation, or on a bus with injected
//! faults, for tests on any machine with std.

mod as5600;
#[cfg(all(feature = "sim", not(target_os = "none")))]
mod bus;
#[cfg(all(feature = "sim", not(target_os = "none")))]
mod controller;
mod i2c;
mod joint;
mod pca9685;
#[cfg(all(feature = "sim", not(target_os = "none")))]
mod spi;
#[cfg(all(feature = "sim", not(target_os = "none")))]
mod uart;

pub use as5600::As5600Model;
#[cfg(all(feature = "sim", not(target_os = "none")))]
pub use bus::SimBus;
#[cfg(all(feature = "sim", not(target_os = "none")))]
pub use controller::Controller;
pub use i2c::I2c;
pub use joint::SimJoint;
pub use pca9685::Pca9685Model;
#[cfg(all(feature = "sim", not(target_os = "none")))]
pub use spi::Spi;
#[cfg(all(feature = "sim", not(target_os = "none")))]
pub use uart::{LineFault, UartModel};

use crate::bus::Width;

/// A simulated board: its registers, and its behaviour when they are read and written. Tests put
/// models on a simulated bus.
///
/// Offsets are in bytes from the beginning of the board. They are below the model's
/// [`size`](Self::size), and multiples of the access's width.
pub trait Model: Send {
    /// Returns the number of bytes that the board takes on the bus.
    fn size(&self) -> usize;

    /// Reads the register at `offset`; returns `None` if the access must fail as a bus error.
    fn read(&mut self, offset: usize, width: Width) -> Option<u32>;

    /// Writes the register at `offset`; returns `None` if the access must fail as a bus error.
    fn write(&mut self, offset: usize, width: Width, value: u32) -> Option<()>;

    /// Returns the offset of the register that follows in a block.
    fn next(&self, offset: usize) -> usize {
        offset + 1
    }

    /// Returns the offset of the register that the board has at a bus address outside of its own
    /// place, if it answers there, too.
    fn also_at(&self, _address: usize) -> Option<usize> {
        None
    }

    /// Returns true if the board asks for its interrupt.
    fn interrupts(&self) -> bool {
        false
    }
}
