//! Attacks of a hostile end of a terminal on the other one, and of a person on a line editor, made of bytes.
#![allow(
    clippy::must_use_candidate,
    clippy::new_without_default,
    reason = "of use to tests alone"
)]

mod haunted;
mod host;
mod processor;
mod reader;
mod script;
pub mod support;
pub mod typing;

pub use host::run as host;
pub use processor::run as processor;
pub use reader::run as reader;
pub use typing::run as editor;
