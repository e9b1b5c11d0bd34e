//! The counts of converters.

#![allow(
    clippy::float_cmp,
    reason = "the tests say where a number is exactly another"
)]

use condor_hand::config::OutputChannel;
use condor_hand::math::clamp;
use proptest::prelude::*;

proptest! {
    #[test]
    fn counts_are_the_nearest_to_what_a_drive_is_to_do(
        newtons in -20.0..150.0_f64,
        bits in 1..=24_u8,
        turned: bool,
    ) {
        let full = f64::from((1_u32 << bits) - 1);
        let gain = full / 130.0;
        let dac = OutputChannel {
            board: 0,
            channel: 0,
            bits,
            gain: if turned { -gain } else { gain },
            offset: if turned { full } else { 0.0 },
        };
        let counts = dac.counts(newtons);
        prop_assert!(counts <= dac.full_scale());
        let inside = clamp(newtons, 0.0, 130.0);
        prop_assert!((dac.value(counts) - inside).abs() <= 0.5 / gain * (1.0 + 1e-9));
    }
}

#[test]
fn counts_end_where_the_converter_does() {
    let dac = OutputChannel {
        board: 0,
        channel: 0,
        bits: 12,
        gain: 31.5,
        offset: 0.0,
    };
    let counts = [-1.0, 0.0, 65.0, 130.0, 1e9, f64::NAN, f64::INFINITY].map(|n| dac.counts(n));
    assert_eq!(counts, [0, 0, 2048, 4095, 4095, 0, 4095]);
    assert_eq!(OutputChannel { bits: 32, ..dac }.full_scale(), u32::MAX);
}
