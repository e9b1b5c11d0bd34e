//! What converters make of what is.

use condor_hand::config::InputChannel;
use condor_hand::plant::{Sensor, SensorBank, SensorFault, SensorFaultKind};
use proptest::prelude::*;

/// -0.5 to 2, in 12 bits.
const ADC: InputChannel = InputChannel {
    board: 0,
    channel: 0,
    bits: 12,
    gain: 2.5 / 4095.0,
    offset: -0.5,
};

const ANGLE: Sensor = Sensor {
    adc: ADC,
    noise: 0.0,
};

proptest! {
    #[test]
    fn a_reading_is_within_half_a_count(share in 0.0_f64..=1.0, bits in 1_u8..=32, turned: bool) {
        let full = f64::from(InputChannel { bits, ..ADC }.full_scale());
        let gain = if turned { -2.5 / full } else { 2.5 / full };
        let offset = if turned { 2.0 } else { -0.5 };
        let adc = InputChannel { bits, gain, offset, ..ADC };
        let value = -0.5 + 2.5 * share;
        let mut bank = SensorBank::new([Sensor { adc, noise: 0.0 }], &[], 1).unwrap();
        let [reading] = bank.read(0.0, &[value]);
        prop_assert!((reading - value).abs() <= 0.5 * gain.abs() + 1e-15, "{} of {}", reading, value);
        prop_assert_eq!(adc.value(adc.counts(reading)), reading);
    }
}

#[test]
fn counts_end_where_the_range_ends() {
    assert_eq!(ADC.counts(-0.5), 0);
    assert_eq!(ADC.counts(2.0), 4095);
    assert_eq!(ADC.counts(9.0), 4095);
    assert_eq!(ADC.counts(f64::NEG_INFINITY), 0);
    assert_eq!(ADC.counts(f64::NAN), 0);
    assert_eq!(InputChannel { bits: 32, ..ADC }.counts(1e9), u32::MAX);
}

#[test]
fn faults_come_and_go_by_their_script() {
    let fault = |channel, from_s, until_s, kind| SensorFault {
        channel,
        from_s,
        until_s,
        kind,
    };
    let script = [
        fault(0, 1.0, 2.0, SensorFaultKind::Stuck),
        fault(1, 1.0, 2.0, SensorFaultKind::Offset(0.25)),
        fault(2, 1.0, 2.0, SensorFaultKind::Dropout(1.0)),
        fault(3, 1.0, f64::INFINITY, SensorFaultKind::NotANumber),
    ];
    let mut bank = SensorBank::new([ANGLE; 4], &script, 1).unwrap();
    let near = |reading: f64, value: f64| (reading - value).abs() <= ADC.gain;
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
    let script = [SensorFault {
        channel: 0,
        from_s: 0.0,
        until_s: f64::INFINITY,
        kind: SensorFaultKind::Dropout(0.25),
    }];
    let mut bank = SensorBank::new([ANGLE], &script, 5).unwrap();
    let lost = (0..4000)
        .filter(|_| bank.read(1.0, &[0.7]) == [-0.5])
        .count();
    assert!((900..1100).contains(&lost), "{lost} of 4000");
}

#[test]
fn a_fault_of_one_channel_leaves_the_noise_of_the_others() {
    let noisy = Sensor {
        noise: 0.02,
        ..ANGLE
    };
    let script = [SensorFault {
        channel: 0,
        from_s: 0.0,
        until_s: f64::INFINITY,
        kind: SensorFaultKind::Dropout(0.5),
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
    let bits = Sensor {
        adc: InputChannel { bits: 33, ..ADC },
        noise: 0.0,
    };
    let refused = SensorBank::new([bits], &[], 1).unwrap_err();
    assert_eq!(
        refused.to_string(),
        "the width of a converter, bits, is 33; it must be at most 32"
    );
    let flat = Sensor {
        adc: InputChannel { gain: 0.0, ..ADC },
        noise: 0.0,
    };
    let refused = SensorBank::new([flat], &[], 1).unwrap_err();
    assert_eq!(
        refused.to_string(),
        "the size of a converter's count is 0; it must be above 0"
    );
    let script = [SensorFault {
        channel: 1,
        from_s: 0.0,
        until_s: 1.0,
        kind: SensorFaultKind::Stuck,
    }];
    let refused = SensorBank::new([ANGLE], &script, 1).unwrap_err();
    assert_eq!(
        refused.to_string(),
        "the number of the channel, from 0, is 1; it must be below 1"
    );
}
