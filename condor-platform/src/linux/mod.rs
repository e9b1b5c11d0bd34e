//! Locks and critical sections of Linux threads.

mod held;
mod lock;
mod thread;

#[cfg(all(feature = "critical-section", not(miri)))]
pub(crate) use held::{hold, let_go};
pub use held::{is_held, on_leaving};
pub use lock::PiLock;
pub use thread::thread_number;
