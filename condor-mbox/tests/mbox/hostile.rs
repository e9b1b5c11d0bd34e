//! What a peer that writes arbitrary words at arbitrary moments can do: nothing to others.
//!
//! `PROPTEST_CASES=100000 cargo test --release -p condor-mbox --test mbox hostile -- --nocapture` goes
//! through some 10⁸ states and says how many.

use std::cell::RefCell;

use proptest::prelude::*;
use proptest::test_runner::TestRunner;

use crate::scenario;

/// Some twenty seconds of an unoptimised build, unless `PROPTEST_CASES` says otherwise.
fn config() -> ProptestConfig {
    let default = ProptestConfig::default();
    let chosen = std::env::var_os("PROPTEST_CASES").is_some();
    let cases = if chosen { default.cases } else { 1_000 };
    ProptestConfig {
        // One alone takes Miri a minute.
        cases: if cfg!(miri) { 1 } else { cases },
        failure_persistence: None,
        max_shrink_time: 60_000,
        ..default
    }
}

fn explore(run: fn(&[u8]) -> scenario::Tally) {
    let total = RefCell::new(scenario::Tally::default());
    let longest = if cfg!(miri) { 40 } else { 600 };
    let bytes = prop::collection::vec(any::<u8>(), 0..longest);
    let outcome = TestRunner::new(config()).run(&bytes, |bytes| {
        total.borrow_mut().add(run(&bytes));
        Ok(())
    });
    println!("{}", total.borrow());
    outcome.unwrap();
}

#[test]
fn honest_processors_are_not_harmed() {
    explore(scenario::run);
}

#[test]
fn regions_cells_and_locks_bear_any_words() {
    explore(scenario::regions::run);
}
