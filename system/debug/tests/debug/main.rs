//! The promises of README.md, on a simulated processor.

mod gateway;
mod hostile;
mod names;
mod packets;
mod stub;
mod words;
