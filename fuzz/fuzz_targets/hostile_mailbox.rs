//! See `condor_fuzz::hostile_mailbox`.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| condor_fuzz::hostile_mailbox(bytes));
