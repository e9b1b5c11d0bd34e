//! What converters make of what is.

use condor_hand::plant::{Converter, Fault, FaultKind, PlantError, SensorBank};
use proptest::prelude::*;

const ANGLE: Converter = Converter {
    bits: 12,
    range: (-0.5, 2.0),
    noise: 0.0,
};

proptest! {
    #[test]
    fn a_reading_is_within_half_a_count(value in -0.5_f64..2.0, bits in 1_u32..=32) {
        let converter = Converter { bits, ..ANGLE };
        let mut bank = SensorBank::new([converter], &[], 1).unwrap();
        let [reading] = bank.read(0.0, &[value]);
        let half = 0.5 * converter.resolution();
        prop_assert!((reading - value).abs() <= half + 1e-15, "{} of {}", reading, value);
        prop_assert_eq!(converter.value(converter.counts(reading)), reading);
    }
}

#[test]
fn counts_end_where_the_range_ends() {
    assert_eq!(ANGLE.counts(-0.5), 0);
    assert_eq!(ANGLE.counts(2.0), 4095);
    assert_eq!(ANGLE.counts(9.0), 4095);
    assert_eq!(ANGLE.counts(f64::NEG_INFINITY), 0);
    assert_eq!(ANGLE.counts(f64::NAN), 0);
    assert_eq!(Converter { bits: 32, ..ANGLE }.counts(2.0), u32::MAX);
}

#[test]
fn faults_come_and_go_by_their_script() {
    let fault = |channel, from_s, until_s, kind| Fault {
        channel,
        from_s,
        until_s,
        kind,
    };
    let script = [
        fault(0, 1.0, 2.0, FaultKind::Stuck),
        fault(1, 1.0, 2.0, FaultKind::Offset(0.25)),
        fault(2, 1.0, 2.0, FaultKind::Dropout(1.0)),
        fault(3, 1.0, f64::INFINITY, FaultKind::NotANumber),
    ];
    let mut bank = SensorBank::new([ANGLE; 4], &script, 1).unwrap();
    let near = |reading: f64, value: f64| (reading - value).abs() <= ANGLE.resolution();
    let read = bank.read(0.5, &[0.1, 0.2, 0.3, 0.4]);
    assert!(near(read[0], 0.1) && near(read[1], 0.2) && near(read[2], 0.3) && near(read[3], 0.4));
    for now in [1.0, 1.5, 1.999] {
        let read = bank.read(now, &[0.7, 0.7, 0.7, 0.7]);
        assert!(near(read[0], 0.1), "{read:?}");
        assert!(near(read[1], 0.95), "{read:?}");
        assert_eq!(read[2], -0.5);
        assert!(read[3].is_nan());
    }
    let read = bank.read(2.0, &[0.7, 0.7, 0.7, 0.7]);
    assert!(
        near(read[0], 0.7) && near(read[1], 0.7) && near(read[2], 0.7),
        "{read:?}"
    );
    assert!(read[3].is_nan());
}

#[test]
fn a_loose_wire_loses_its_share_of_readings() {
    let script = [Fault {
        channel: 0,
        from_s: 0.0,
        until_s: f64::INFINITY,
        kind: FaultKind::Dropout(0.25),
    }];
    let mut bank = SensorBank::new([ANGLE], &script, 5).unwrap();
    let lost = (0..4000)
        .filter(|_| bank.read(1.0, &[0.7]) == [-0.5])
        .count();
    assert!((900..1100).contains(&lost), "{lost} of 4000");
}

#[test]
fn a_fault_of_one_channel_leaves_the_noise_of_the_others() {
    let noisy = Converter {
        noise: 0.02,
        ..ANGLE
    };
    let script = [Fault {
        channel: 0,
        from_s: 0.0,
        until_s: f64::INFINITY,
        kind: FaultKind::Dropout(0.5),
    }];
    let mut with = SensorBank::new([noisy; 2], &script, 7).unwrap();
    let mut without = SensorBank::new([noisy; 2], &[], 7).unwrap();
    let mut other = SensorBank::new([noisy; 2], &[], 8).unwrap();
    let (mut spread, mut differ) = (0.0, false);
    for tick in 0..1000 {
        let now = f64::from(tick) * 2.5e-3;
        let [_, a] = with.read(now, &[0.5, 0.5]);
        let [_, b] = without.read(now, &[0.5, 0.5]);
        let [_, c] = other.read(now, &[0.5, 0.5]);
        assert_eq!(a.to_bits(), b.to_bits());
        differ |= a != c;
        spread += (a - 0.5) * (a - 0.5) / 1000.0;
    }
    assert!(differ);
    assert!((libm::sqrt(spread) - 0.02).abs() < 0.002, "{spread}");
}

#[test]
fn impossible_sensors_are_refused() {
    let bits = Converter { bits: 33, ..ANGLE };
    let refused = SensorBank::new([bits], &[], 1).unwrap_err();
    assert_eq!(refused, PlantError::Bits { bits: 33 });
    let script = [Fault {
        channel: 1,
        from_s: 0.0,
        until_s: 1.0,
        kind: FaultKind::Stuck,
    }];
    let refused = SensorBank::new([ANGLE], &script, 1).unwrap_err();
    let expected = PlantError::NoChannel {
        channel: 1,
        channels: 1,
    };
    assert_eq!(refused, expected);
}
