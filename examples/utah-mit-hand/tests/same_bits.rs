//! The same input gives condor-hand's controllers the same bits here as in the firmwares under
//! `tests/firmware`.
//!
//! A program of its own: beside code of a dependency that is not optimized, the tests of the system would
//! use its copies of generic functions, and take twice the time.

use checks::Checks;

#[test]
fn every_level_gives_the_committed_bits() {
    let print = |text: &str| print!("{text}");
    let mut checks = Checks::new(&print);
    hand_exercise::same_bits(&mut checks, &print);
    assert!(checks.conclude());
}
