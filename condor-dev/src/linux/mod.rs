//! Registers and interrupts of Linux.
//!
//! | you have | you take |
//! |---|---|
//! | a device that the kernel gives to programs as `/dev/uio`*n* | [`LinuxBus::uio`], [`UioInterrupts`] |
//! | physical addresses, and the right to open `/dev/mem` | [`LinuxBus::physical`] |
//! | a file whose other side is a simulated machine | [`LinuxBus::map`] |
//!
//! Several buses are one as nested pairs: `(LinuxBus, LinuxBus)` is a [`Bus`](crate::Bus), too.
//!
//! # Bus errors
//!
//! The kernel answers an access behind which there is nothing any more (a truncated file, a device
//! that was unplugged) with SIGBUS, and so it does where nothing answers on the bus, if the processor reports
//! that precisely. With the first bus a handler for SIGBUS is installed, which turns it into
//! an error of the access; it passes on what does not concern such an access to the handler that was there.
//! Who installs one later must likewise pass on what does not concern him. A thread that
//! blocks SIGBUS is killed by the kernel if it touches memory that has vanished.
//!
//! Accesses are functions of their own in assembly, for x86-64, `AArch64` and 64-bit RISC-V. There is
//! no such module for other processors.
//!
//! # Real time
//!
//! An access is a plain memory access once its page is there: call `mlockall`. Only waiting for
//! interrupts and completing them are system calls.

mod bus;
mod uio;

pub use bus::{Access, LinuxBus, MapError};
pub use uio::UioInterrupts;
