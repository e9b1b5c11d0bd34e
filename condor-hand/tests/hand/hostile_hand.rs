//! What no text, no image, no user and no sensor brings about.
#![cfg(feature = "hostile")]

use proptest::collection::vec;
use proptest::prelude::*;

use condor_hand::hostile::{configuration, control};

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn what_is_read_keeps_the_rules(bytes in vec(any::<u8>(), 0..40)) {
        configuration(&bytes);
    }

    #[test]
    fn commands_stay_within_what_actuators_have(bytes in vec(any::<u8>(), 0..800)) {
        control(&bytes);
    }
}
