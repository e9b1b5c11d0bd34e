#![doc = include_str!("../README.md")]

pub mod book;
pub mod config;
mod feed;
mod job;
pub mod journal;
mod log;
mod motions;
mod parameter_worker;
mod presence;
mod serve;
mod system;

pub use serve::Gateway;
pub use system::SystemChoice;
