// The first definition of a link counts: here those of README.md lead to items instead of files.
#![cfg_attr(
    all(feature = "linux", target_os = "linux"),
    doc = "[linux]: mod@linux"
)]
//! [layout]: mod@layout
//! [region]: Region
//! [exchange]: mod@exchange
//! [published]: mod@published
//! [shared_log]: mod@shared_log
//! [spin_lock]: mod@spin_lock
//! [window]: MemoryWindow
//! [time]: Clock
//! [doorbell]: Doorbell
//! [exclusion]: Exclusion
//! [backend]: Backend
//! [error]: enum@MailboxError
#![cfg_attr(not(condor_loom), doc = "[static_memory]: StaticMemory")]
//!
// Its first examples want the feature.
#![cfg_attr(any(feature = "linux", not(doctest)), doc = include_str!("../README.md"))]
#![cfg_attr(
    any(target_os = "none", not(any(feature = "std", condor_loom, test))),
    no_std
)]

// Linked, so that a program which asks it for critical sections has them.
#[cfg(feature = "std")]
use condor_platform as _;

// Machines, and documents of their own.
#[cfg(feature = "conformance")]
pub mod conformance;
// Functions that tests and fuzz targets call with arbitrary bytes.
#[cfg(all(feature = "hostile", not(any(condor_loom, target_os = "none"))))]
#[doc(hidden)]
pub mod hostile;
pub mod layout;
#[cfg(all(feature = "linux", target_os = "linux"))]
pub mod linux;
#[cfg(all(
    feature = "riscv",
    not(condor_loom),
    any(target_arch = "riscv32", target_arch = "riscv64")
))]
pub mod riscv;
#[cfg(all(feature = "sim", not(target_os = "none")))]
pub mod sim;

// Messages longer than a word; each of these modules has types of its own beside the one below.
pub mod exchange;
pub mod published;
pub mod shared_log;
pub mod spin_lock;

mod backend;
mod doorbell;
pub mod error;
mod exclusion;
mod id;
mod mail;
mod mailbox;
mod region;
#[cfg(not(condor_loom))]
mod static_memory;
mod sync;
mod time;
pub mod window;
mod windows;

pub use error::{MailboxError, SendProgress};
pub use id::{Processor, Vector};
pub use mailbox::{
    Call, Handler, Mailbox, MessageTicket, Messenger, PeerState, PendingReply, VectorStatistics,
    Waiting,
};

pub use exchange::Exchange;
pub use published::Published;
pub use region::{Allocator, Offset, Region};
pub use shared_log::SharedLog;
pub use spin_lock::SpinLock;

pub use backend::Backend;
pub use doorbell::{Doorbell, Evidence};
pub use exclusion::{CriticalSection, Exclusion, SingleContext};
#[cfg(not(condor_loom))]
pub use static_memory::{StaticMemory, StaticWindow};
pub use time::{Clock, Instant};
pub use window::{AccessError, LoadOrder, MemoryWindow, StoreOrder};
pub use windows::Windows;
