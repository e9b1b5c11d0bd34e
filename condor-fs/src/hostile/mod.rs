//! Hostile peers, driven by bytes: a host that sends a client any answer, and a client that sends a server any
//! request.
#![allow(clippy::must_use_candidate, reason = "of use to tests alone")]

mod client;
mod host;
pub mod peer;
mod source;

pub use client::run as client;
pub use host::run as host;

use source::Source;
