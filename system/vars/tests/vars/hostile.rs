//! Whatever is written to the window, or asked: no panic, no end that does not come, nothing written
//! outside of the table.
#![cfg(feature = "hostile")]

use proptest::prelude::*;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(if cfg!(miri) { 8 } else { 256 }))]

    #[test]
    fn both_ends_bear_anything(bytes in prop::collection::vec(any::<u8>(), 0..2000)) {
        condor_vars::hostile::run(&bytes);
    }
}
