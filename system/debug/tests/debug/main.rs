//! The promises of README.md, on a simulated processor.

mod gateway;
mod names;
mod stub;
mod words;
