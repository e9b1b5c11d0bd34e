//! Mailbox messages between processors that share memory.
#![cfg_attr(not(any(feature = "std", condor_loom, test)), no_std)]

mod doorbell;
mod error;
mod exclusion;
mod id;
pub mod layout;
#[cfg(feature = "linux")]
pub mod linux;
#[allow(dead_code, unused_imports)]
mod sync;
mod time;
mod window;
mod windows;

pub use doorbell::{Doorbell, Evidence};
pub use error::{Error, LayoutField, Object, Progress};
pub use exclusion::{CriticalSection, Exclusion, SingleContext};
pub use id::{Processor, Vector};
pub use time::{Clock, Instant};
pub use window::{
    CompareExchange, LoadOrder, MemoryWindow, StoreOrder, WindowError, WindowErrorKind,
    check_access,
};
pub use windows::Windows;
