//! Brings a system up, watches it, and takes it down.

pub mod image;
