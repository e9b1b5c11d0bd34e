//! [`report`]: prints the number of states that a long run has gone through.

use std::cell::RefCell;
use std::time::Instant;

use condor_mbox::hostile::Tally;

/// The number of states between two lines.
const LINE: u64 = 1_000_000;

thread_local! {
    static PROGRESS: RefCell<(Tally, Instant)> =
        RefCell::new((Tally::default(), Instant::now()));
}

/// Adds a run of `target`, and prints a line for each million of states.
pub fn report(target: &str, run: Tally) {
    PROGRESS.with_borrow_mut(|(total, begun)| {
        let lines = total.states / LINE;
        total.add(run);
        if total.states / LINE > lines {
            let rate = u128::from(total.states) * 1_000 / begun.elapsed().as_millis().max(1);
            eprintln!("{target}: {total}; {rate} states a second");
        }
    });
}
