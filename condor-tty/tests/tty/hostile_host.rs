//! No words of a processor make a host do harm: the scenario of the fuzz target, as a property.
#![cfg(feature = "linux")]

use proptest::prelude::*;

use crate::terminals;

#[path = "terminals/host.rs"]
mod host;

proptest! {
    #[test]
    fn hosts_bear_any_processor(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
        host::run(&bytes);
    }
}
