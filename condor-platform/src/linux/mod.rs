//! Locks and critical sections of Linux threads, and the handler of SIGBUS.

mod bus_error;
mod held;
mod lock;
mod thread;

pub use bus_error::{BusError, Repair, on_bus_error};
#[cfg(all(feature = "critical-section", not(miri)))]
pub(crate) use held::{hold, let_go};
pub use held::{is_held, on_leaving};
pub use lock::PiLock;
pub use thread::thread_number;
