//! See `condor_fuzz::live_connection`.
#![cfg_attr(fuzzing, no_main)]

#[cfg(fuzzing)]
libfuzzer_sys::fuzz_target!(|bytes: &[u8]| condor_fuzz::live_connection(bytes));

/// Without `cargo fuzz` there is nothing to run: `tests/replay.rs` has the seeds.
#[cfg(not(fuzzing))]
fn main() {}
