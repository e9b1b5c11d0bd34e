//! Regions, published values and locks in memory full of noise: see `scenario::regions`.
#![no_main]

use libfuzzer_sys::fuzz_target;

#[path = "../../condor-mbox/tests/hostile/progress.rs"]
mod progress;
#[path = "../../condor-mbox/tests/hostile/mod.rs"]
mod scenario;

fuzz_target!(|bytes: &[u8]| progress::report("regions", scenario::regions::run(bytes)));
