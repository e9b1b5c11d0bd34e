//! No driver panics, runs for ever or loses a byte that it acknowledged, whatever its board does.
//!
//! `PROPTEST_CASES=100000 cargo test --release -p condor-dev --test dev hostile -- --nocapture` goes
//! through some 10⁷ accesses and says how many.

use std::cell::RefCell;

use proptest::prelude::*;
use proptest::test_runner::TestRunner;

use utah_mit_boards::hostile::{Tally, drivers};

#[test]
fn drivers_bear_any_board() {
    let default = ProptestConfig::default();
    let chosen = std::env::var_os("PROPTEST_CASES").is_some();
    let config = ProptestConfig {
        cases: if chosen { default.cases } else { 1_000 },
        failure_persistence: None,
        max_shrink_time: 60_000,
        ..default
    };
    let total = RefCell::new(Tally::default());
    let bytes = prop::collection::vec(any::<u8>(), 0..600);
    let outcome = TestRunner::new(config).run(&bytes, |bytes| {
        total.borrow_mut().add(drivers(&bytes));
        Ok(())
    });
    println!("{}", total.borrow());
    outcome.unwrap();
}
