//! See `condor_fuzz::debug_stub`.
#![cfg_attr(fuzzing, no_main)]

#[cfg(fuzzing)]
libfuzzer_sys::fuzz_target!(|bytes: &[u8]| condor_fuzz::debug_stub(bytes));

/// Without `cargo fuzz` there is nothing to run: `tests/replay.rs` has the seeds.
#[cfg(not(fuzzing))]
fn main() {}
