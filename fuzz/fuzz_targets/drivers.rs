//! See `condor_fuzz::drivers`.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| condor_fuzz::drivers(bytes));
