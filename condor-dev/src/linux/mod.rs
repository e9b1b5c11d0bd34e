//! Registers and interrupts of Linux.
//!
//! | your case | use |
//! |---|---|
//! | a device that the kernel exposes to programs as `/dev/uio`*n* | [`LinuxBus::uio`], [`UioInterrupts`] |
//! | physical addresses, and the right to open `/dev/mem` | [`LinuxBus::physical`] |
//! | a file whose other side is a simulated machine | [`LinuxBus::map`] |
//!
//! Nested pairs combine several buses: `(LinuxBus, LinuxBus)` is a [`Bus`](crate::Bus), too.
//!
//! # Bus errors
//!
//! If the memory behind an access is gone (a truncated file, an unplugged device), the kernel
//! raises SIGBUS; it also does so if nothing answers on the bus and the processor reports that
//! precisely. The first bus installs a handler for SIGBUS, which turns the signal into an error of
//! the access. It passes on signals that do not concern such an access to the handler that was
//! installed before. A handler that is installed later must likewise pass on signals that do not
//! concern it. If a thread blocks SIGBUS and touches memory that has vanished, the kernel kills it.
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

pub use bus::{BusMapError, LinuxBus, MapAccess};
pub use uio::UioInterrupts;
