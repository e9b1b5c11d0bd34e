//! Hostile debuggers and areas, made of bytes.

mod gateway;
mod stub;

pub use gateway::run as gateway;
pub use stub::run as stub;
