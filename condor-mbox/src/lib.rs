//! Mailbox messages between processors that share memory.
#![cfg_attr(not(any(feature = "std", condor_loom, test)), no_std)]

mod doorbell;
mod error;
mod exclusion;
mod id;
pub mod layout;
#[cfg(feature = "linux")]
pub mod linux;
mod mail;
mod mailbox;
#[cfg(feature = "sim")]
pub mod sim;
mod sync;
mod time;
mod window;
mod windows;

pub use doorbell::{Doorbell, Evidence};
pub use error::{Error, LayoutField, Object, Progress};
pub use exclusion::{CriticalSection, Exclusion, SingleContext};
pub use id::{Processor, Vector};
pub use mailbox::{
    Call, Handler, MAX_DEPTH, Mailbox, Message, Messenger, PeerState, Pending, Ticket,
    VectorStatistics, Waiting,
};
pub use time::{Clock, Instant};
pub use window::{
    CompareExchange, LoadOrder, MemoryWindow, StoreOrder, WindowError, WindowErrorKind,
    check_access,
};
pub use windows::Windows;
