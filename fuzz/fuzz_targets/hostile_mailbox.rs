//! Two honest processors keep every promise while a third writes whatever it can: see `scenario`.
#![no_main]

use libfuzzer_sys::fuzz_target;

#[path = "../../condor-mbox/tests/hostile/progress.rs"]
mod progress;
#[path = "../../condor-mbox/tests/hostile/mod.rs"]
mod scenario;

fuzz_target!(|bytes: &[u8]| progress::report("hostile_mailbox", scenario::run(bytes)));
