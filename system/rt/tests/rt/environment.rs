//! The settings of a process in the system of a test.
#![cfg(feature = "linux")]

use std::path::Path;

use condor_mbox::Processor;
use condor_rt::linux::{Environment, LoopContext};

/// The settings of `processor` in the system in `directory`.
pub(crate) fn environment(
    directory: &Path,
    processor: Processor,
    window_bytes: u32,
    loops: LoopContext,
) -> Environment {
    Environment {
        loops,
        ..Environment::new(directory.join("mailbox"), window_bytes, processor)
    }
}
