//! Locks and critical sections of Linux threads, the handler of SIGBUS, files, and their locks.

mod bus_error;
mod file_lock;
mod held;
mod lock;
mod regular;
mod thread;
mod whole_file;

pub use bus_error::{MemoryFault, Repair, on_bus_error};
pub use file_lock::{LOCK_PATIENCE, lock_file, while_held};
#[cfg(all(feature = "critical-section", not(miri)))]
pub(crate) use held::{hold, let_go};
pub use held::{is_held, on_leaving};
pub use lock::PiLock;
pub use regular::{open_regular, read_regular, read_text};
pub use thread::thread_number;
pub use whole_file::{WholeFile, sync_name};
