//! Two honest processors keep every promise while a third writes whatever it can: see `scenario`.
#![no_main]

use std::cell::RefCell;
use std::time::Instant;

use libfuzzer_sys::fuzz_target;

#[path = "../../condor-mbox/tests/hostile/mod.rs"]
mod scenario;

thread_local! {
    static PROGRESS: RefCell<(scenario::Tally, u64, Instant)> =
        RefCell::new((scenario::Tally::default(), 0, Instant::now()));
}

/// States between two lines of progress.
const LINE: u64 = 1_000_000;

fuzz_target!(|bytes: &[u8]| {
    let run = scenario::run(bytes);
    PROGRESS.with_borrow_mut(|(total, lines, begun)| {
        total.add(run);
        if total.states / LINE > *lines {
            *lines = total.states / LINE;
            let rate = total.states as f64 / begun.elapsed().as_secs_f64();
            eprintln!("hostile_mailbox: {total}; {rate:.0} states a second");
        }
    });
});
