//! See `condor_fuzz::remote_request`.
#![cfg_attr(fuzzing, no_main)]

#[cfg(fuzzing)]
libfuzzer_sys::fuzz_target!(|bytes: &[u8]| condor_fuzz::remote_request(bytes));

/// Without `cargo fuzz` there is nothing to run: `tests/replay.rs` has the seeds.
#[cfg(not(fuzzing))]
fn main() {}
