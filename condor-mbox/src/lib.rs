//! Mailbox messages between processors that share memory.
#![cfg_attr(not(any(feature = "std", condor_loom, test)), no_std)]

#[cfg(feature = "conformance")]
pub mod conformance;
mod doorbell;
mod error;
mod exchange;
mod exclusion;
mod id;
pub mod layout;
#[cfg(feature = "linux")]
pub mod linux;
mod mail;
mod mailbox;
mod published;
mod region;
#[cfg(all(
    feature = "riscv",
    not(condor_loom),
    any(target_arch = "riscv32", target_arch = "riscv64")
))]
pub mod riscv;
#[cfg(feature = "sim")]
pub mod sim;
mod spin_lock;
#[cfg(not(condor_loom))]
mod static_memory;
mod sync;
mod time;
mod window;
mod windows;

pub use doorbell::{Doorbell, Evidence};
pub use error::{Error, LayoutField, Object, Progress, ProtocolWord};
pub use exchange::{Exchange, ExchangeError, answer};
pub use exclusion::{CriticalSection, Exclusion, SingleContext};
pub use id::{Processor, Vector};
pub use mailbox::{
    Call, Handler, MAX_DEPTH, Mailbox, Message, Messenger, PeerState, Pending, Ticket,
    VectorStatistics, Waiting,
};
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
    check_access, check_word,
};
pub use windows::Windows;
