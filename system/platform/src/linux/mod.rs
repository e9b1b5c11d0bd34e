//! Locks and critical sections of Linux threads, the handler of SIGBUS, programs that a fatal error holds, files, and
//! their locks.

mod bus_error;
mod fatal_signal;
mod file_lock;
mod lock;
mod regular;
mod thread;
mod thread_words;
mod whole_file;

pub use bus_error::{MemoryFault, Repair, on_bus_error};
pub use fatal_signal::{end_by_arithmetic, hold_at_fatal_errors, hold_for_debugger};
pub use file_lock::{LOCK_PATIENCE, lock_file, while_held};
pub use lock::PiLock;
pub use regular::{open_regular, read_regular, read_text};
pub use thread::thread_number;
#[cfg(all(feature = "critical-section", not(miri)))]
pub(crate) use thread_words::{hold, let_go};
pub use thread_words::{is_held, on_leaving};
pub use whole_file::{WholeFile, sync_name};
