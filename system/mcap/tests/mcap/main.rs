//! Files against the crate `mcap`, and what is no file.

mod broken;
mod peer;
