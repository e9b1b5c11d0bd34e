//! See `condor_fuzz::fs_host`.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| condor_fuzz::fs_host(bytes));
