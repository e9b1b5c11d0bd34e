// The first definition of a link counts: here those of README.md lead to items instead of files.
#![cfg_attr(feature = "linux", doc = "[linux]: mod@linux")]
//! [layout]: mod@layout
//! [region]: Region
//! [exchange]: Exchange
//! [published]: Published
//! [spin_lock]: SpinLock
//! [window]: MemoryWindow
//! [time]: Clock
//! [doorbell]: Doorbell
//! [exclusion]: Exclusion
//! [error]: enum@Error
#![cfg_attr(not(condor_loom), doc = "[static_memory]: StaticMemory")]
//!
#![doc = include_str!("../README.md")]
#![cfg_attr(not(any(feature = "std", condor_loom, test)), no_std)]

// Linked, so that a program which asks it for critical sections has them.
#[cfg(feature = "std")]
use condor_platform as _;

// Documents of their own.
#[cfg(feature = "conformance")]
pub mod conformance;
pub mod layout;
#[cfg(feature = "linux")]
pub mod linux;
#[cfg(all(
    feature = "riscv",
    not(condor_loom),
    any(target_arch = "riscv32", target_arch = "riscv64")
))]
pub mod riscv;
#[cfg(feature = "sim")]
pub mod sim;

mod doorbell;
mod error;
mod exchange;
mod exclusion;
mod id;
mod mail;
mod mailbox;
mod published;
mod region;
mod spin_lock;
#[cfg(not(condor_loom))]
mod static_memory;
mod sync;
mod time;
mod window;
mod windows;

// Messages.
pub use error::{Error, LayoutField, Object, Progress, ProtocolWord};
pub use id::{Processor, Vector};
pub use mailbox::{
    Call, Handler, Link, MAX_DEPTH, Mailbox, Message, Messenger, PeerState, Pending, Ticket,
    VectorStatistics, Waiting,
};

// What is longer than a word.
pub use exchange::{Exchange, ExchangeError, answer};
pub use published::{Latest, Published, Publisher, ReadError, Subscriber};
pub use region::{AccessError, Place, Places, Region};
pub use spin_lock::{
    Attempt, Bakery, Guard, HardwareSemaphore, Lives, LockError, NativeSwap, Owner, SemaphoreSwap,
    SpinLock, TestAndSet,
};

// The machine.
pub use doorbell::{Doorbell, Evidence};
pub use exclusion::{CriticalSection, Exclusion, SingleContext};
#[cfg(not(condor_loom))]
pub use static_memory::{StaticMemory, StaticWindow};
pub use time::{Clock, Instant};
pub use window::{
    CompareExchange, LoadOrder, LoadStep, MemoryWindow, StoreOrder, StoreStep, WindowError,
    WindowErrorKind, check_access, check_words,
};
pub use windows::Windows;
