#![doc = include_str!("../README.md")]

pub mod config;
mod feed;
mod job;
mod log;
mod motions;
mod parameter_worker;
mod presence;
mod serve;
mod system;

pub use serve::Gateway;
pub use system::SystemChoice;
