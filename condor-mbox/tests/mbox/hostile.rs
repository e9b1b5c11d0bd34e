//! What a peer that writes arbitrary words at arbitrary moments can do: nothing to others.
//!
//! `PROPTEST_CASES=100000 cargo test --release -p condor-mbox --features hostile --test mbox hostile -- --nocapture` goes
//! through some 10⁸ states and says how many.
#![cfg(feature = "hostile")]

use std::cell::RefCell;

use proptest::prelude::*;
use proptest::test_runner::TestRunner;

use condor_mbox::hostile::{Tally, mailbox, mailbox_behind_caches, regions};

/// Some twenty seconds of an unoptimised build, unless `PROPTEST_CASES` says otherwise.
fn config(share: u32) -> ProptestConfig {
    let default = ProptestConfig::default();
    let chosen = std::env::var_os("PROPTEST_CASES").is_some();
    let cases = if chosen { default.cases } else { 1_000 / share };
    ProptestConfig {
        // One alone takes Miri a minute.
        cases: if cfg!(miri) { 1 } else { cases },
        failure_persistence: None,
        max_shrink_time: 60_000,
        ..default
    }
}

fn explore(run: fn(&[u8]) -> Tally, share: u32) {
    let total = RefCell::new(Tally::default());
    let longest = if cfg!(miri) { 40 } else { 600 };
    let bytes = prop::collection::vec(any::<u8>(), 0..longest);
    let outcome = TestRunner::new(config(share)).run(&bytes, |bytes| {
        total.borrow_mut().add(run(&bytes));
        Ok(())
    });
    println!("{}", total.borrow());
    outcome.unwrap();
}

#[test]
fn honest_processors_are_not_harmed() {
    explore(mailbox, 1);
}

#[test]
fn honest_processors_are_not_harmed_behind_caches() {
    // The simulated caches take most of the time.
    explore(mailbox_behind_caches, 4);
}

#[test]
fn regions_cells_and_locks_bear_any_words() {
    explore(regions, 1);
}
