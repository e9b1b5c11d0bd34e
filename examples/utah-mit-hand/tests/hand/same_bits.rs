//! The same input gives condor-hand's controllers the same bits here as in the firmwares under
//! `examples/bare-metal`.

use checks::Checks;

#[test]
fn every_level_gives_the_committed_bits() {
    let print = |text: &str| print!("{text}");
    let mut checks = Checks::new(&print);
    hand_exercise::same_bits(&mut checks, &print);
    assert!(checks.conclude());
}
