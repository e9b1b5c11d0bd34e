//! Mailbox messages between processors that share memory.
#![cfg_attr(not(any(feature = "std", condor_loom, test)), no_std)]

#[cfg(feature = "conformance")]
pub mod conformance;
mod doorbell;
mod error;
mod exclusion;
mod id;
pub mod layout;
mod published;
mod region;
mod spin_lock;
#[cfg(not(condor_loom))]
mod static_memory;
#[allow(dead_code, unused_imports)]
mod sync;
mod time;
mod window;

pub use doorbell::{Doorbell, Evidence};
pub use error::{Error, LayoutField, Object, Progress};
pub use exclusion::{CriticalSection, Exclusion, SingleContext};
pub use id::{Processor, Vector};
pub use published::{Latest, Published, Publisher, ReadError, Subscriber};
pub use region::{AccessError, Place, Places, Region};
pub use spin_lock::{
    Attempt, Bakery, Guard, HardwareSemaphore, Lives, LockError, NativeSwap, Owner, SemaphoreSwap,
    SpinLock, TestAndSet,
};
#[cfg(not(condor_loom))]
pub use static_memory::{StaticMemory, StaticWindow};
pub use time::{Clock, Instant};
pub use window::{
    CompareExchange, LoadOrder, MemoryWindow, StoreOrder, WindowError, WindowErrorKind,
    check_access,
};
