//! No words of a processor make a host do harm: the scenario of the fuzz target, as a property.

use proptest::prelude::*;

#[path = "hostile/host.rs"]
mod host;
#[path = "hostile/mod.rs"]
mod terminals;

proptest! {
    #[test]
    fn hosts_bear_any_processor(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
        host::run(&bytes);
    }
}
