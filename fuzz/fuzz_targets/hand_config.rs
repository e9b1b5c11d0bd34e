//! See `condor_fuzz::hand_config`.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| condor_fuzz::hand_config(bytes));
