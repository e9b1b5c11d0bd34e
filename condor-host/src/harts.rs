//! A machine of harts beside this one: what lies where in the memory that both see, and how the host
//! says which program a hart is to run.
//!
//! All of the machine's memory is one file of the host, as on a bus adaptor that maps one computer's
//! memory into the other's. At its beginning lies the [monitor](#the-monitor) that all harts come up in;
//! where the rest is, a [`Map`] says, which the host writes before the machine is switched on:
//!
//! | | |
//! |---|---|
//! | monitor | code, data and stacks of the resident program |
//! | map | this table, at [`map::AT`] |
//! | a page for each hart | its [`Control`] |
//! | `mail` and `data` of every processor | what `condor-mbox` needs, for the processes of the host, too |
//! | bus | registers of boards, if there are any |
//! | a range for each hart | its program, and at its end the stack, below which a guard lies |
//!
//! All words have 32 bits and are little-endian.
//!
//! # The monitor
//!
//! A hart without a program waits in a monitor, which looks at its [`Control`]. The host puts a program
//! into the hart's range, [orders](Control::order) a start, and rings the hart. The program runs until
//! it ends, until a trap that it does not handle ends it, or until the host abandons it: then the hart is
//! in the monitor again, and the others have not noticed.

mod control;
#[cfg(all(feature = "harts", target_os = "linux"))]
mod image;
pub mod map;
#[cfg(all(feature = "harts", target_os = "linux"))]
mod memory;
#[cfg(all(feature = "harts", target_os = "linux"))]
mod qemu;

pub use control::{ARGUMENT_BYTES, Control, ERROR_BYTES, Fault, Order, State, cause_name};
#[cfg(all(feature = "harts", target_os = "linux"))]
pub use image::{Image, ImageError, RAM};
pub use map::{Map, MapError, Run};
#[cfg(feature = "program")]
pub(crate) use memory::bus;
#[cfg(all(feature = "harts", target_os = "linux"))]
pub use memory::{MachineMemory, MemoryError};
#[cfg(all(feature = "harts", target_os = "linux"))]
pub use qemu::Qemu;
