//! No words of a processor make a host do harm: the scenario of the fuzz target, as a property.
#![cfg(feature = "hostile")]

use proptest::prelude::*;

use condor_tty::hostile::host;

proptest! {
    #[test]
    fn hosts_bear_any_processor(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
        host(&bytes);
    }
}
