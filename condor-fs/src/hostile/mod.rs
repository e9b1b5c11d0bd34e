//! Hostile peers, driven by bytes: a host that answers a client with anything, and a client that asks
//! a server for anything.
#![allow(clippy::must_use_candidate, reason = "of use to tests alone")]

mod client;
mod host;
pub mod peer;
mod source;

pub use client::run as client;
pub use host::run as host;

use source::Source;
