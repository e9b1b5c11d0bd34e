//! What a peer that writes arbitrary words at arbitrary moments can do: nothing to others.

use proptest::prelude::*;

#[path = "hostile/mod.rs"]
mod scenario;

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, max_shrink_iters: 3000, max_shrink_time: 60000, ..ProptestConfig::default() })]

    #[test]
    fn honest_processors_are_not_harmed(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
        scenario::run(&bytes);
    }
}

#[test]
fn replay() {
    let Ok(path) = std::env::var("REPLAY") else {
        return;
    };
    let text = std::fs::read_to_string(path).unwrap();
    let bytes: Vec<u8> = text
        .split(',')
        .filter_map(|n| n.trim().parse().ok())
        .collect();
    scenario::run(&bytes);
}
