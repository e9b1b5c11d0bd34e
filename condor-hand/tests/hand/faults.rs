//! What the monitor of a finger and the way to rest promise.

#![allow(
    clippy::float_cmp,
    reason = "the tests say where a number is exactly another"
)]

use condor_hand::fault::{
    ActuatorFaultLimits, EncoderFaultLimits, Fault, FaultCode, FaultLimits, FaultPlace,
    FaultQuantity, FaultRange, FingerMonitor, JointFaultLimits, Observation, Plausible, SafeRamp,
    SensorFaultLimits, Stuck, Threshold,
};
use condor_hand::{NumberError, Requirement, Subject};
use nalgebra::Vector2;
use proptest::prelude::*;

/// Of two joints and four actuators.
fn limits() -> FaultLimits<2, 4> {
    let actuator = ActuatorFaultLimits {
        sensor: SensorFaultLimits {
            lost_samples: 2,
            plausible: Plausible::default(),
            range: FaultRange {
                low: -5.0,
                high: 200.0,
                samples: 3,
            },
            stuck: Stuck {
                band: 0.1,
                travel: 5.0,
                samples: 4,
            },
            tracking: Threshold {
                value: 20.0,
                samples: 5,
            },
        },
        effort: FaultRange {
            low: 1.0,
            high: 150.0,
            samples: 6,
        },
    };
    let joint = JointFaultLimits {
        sensor: SensorFaultLimits {
            lost_samples: 2,
            plausible: Plausible {
                rate_change: 4.0,
                travel: 0.02,
            },
            range: FaultRange {
                low: -3.0,
                high: 3.0,
                samples: 3,
            },
            stuck: Stuck {
                band: 0.001,
                travel: 0.05,
                samples: 4,
            },
            tracking: Threshold {
                value: 0.3,
                samples: 5,
            },
        },
        limit: FaultRange {
            low: -0.5,
            high: 1.5,
            samples: 2,
        },
    };
    FaultLimits {
        actuators: [actuator; 4],
        encoders: [None; 4],
        joints: [joint; 2],
        period_s: Threshold {
            value: 0.003,
            samples: 2,
        },
        set_point_age_s: Threshold {
            value: 0.05,
            samples: 1,
        },
    }
}

/// A tick of the finger.
#[derive(Clone, Copy)]
struct Seen {
    desired_efforts: [f64; 4],
    efforts: [f64; 4],
    desired_positions: [Option<f64>; 2],
    positions: Vector2<f64>,
    actuator_positions: [f64; 4],
    lost: u32,
    believed: Vector2<f64>,
    rates: Vector2<f64>,
    period_s: f64,
    set_point_age_s: f64,
}

/// Two motors of a differential, and two that turn the second joint alone.
const ARMS: [[f64; 2]; 4] = [[10.0, 10.0], [10.0, -10.0], [0.0, 5.0], [0.0, 5.0]];

/// The positions of the actuators when the joints are there.
fn actuators(joints: &Vector2<f64>) -> [f64; 4] {
    ARMS.map(|arms| Vector2::from(arms).dot(joints))
}

fn good() -> Seen {
    Seen {
        desired_efforts: [10.0; 4],
        efforts: [10.0; 4],
        desired_positions: [Some(0.2); 2],
        positions: Vector2::repeat(0.2),
        actuator_positions: actuators(&Vector2::repeat(0.2)),
        lost: 0,
        believed: Vector2::repeat(0.2),
        rates: Vector2::zeros(),
        period_s: 0.0025,
        set_point_age_s: 0.02,
    }
}

struct Monitor(FingerMonitor<2, 4>);

impl Monitor {
    fn new(limits: &FaultLimits<2, 4>) -> Self {
        Self(FingerMonitor::new(*limits).unwrap())
    }

    fn update(&mut self, seen: &Seen) -> Option<Fault> {
        self.0.update(&Observation {
            desired_efforts: &seen.desired_efforts,
            efforts: &seen.efforts,
            desired_positions: &seen.desired_positions,
            positions: &seen.positions,
            actuator_positions: &seen.actuator_positions,
            arms: &ARMS,
            lost: seen.lost,
            believed: &seen.believed,
            rates: &seen.rates,
            period_s: seen.period_s,
            set_point_age_s: seen.set_point_age_s,
        })
    }
}

fn monitor() -> Monitor {
    Monitor::new(&limits())
}

/// Shows an observation after one good one until it is a fault: the fault, and which sample.
fn first_fault(observation: &Seen) -> Option<(Fault, usize)> {
    let mut monitor = monitor();
    assert_eq!(monitor.update(&good()), None);
    (1..100).find_map(|k| Some((monitor.update(observation)?, k)))
}

fn check(observation: &Seen, code: FaultCode, place: FaultPlace, samples: usize) {
    let (fault, after) = first_fault(observation).unwrap();
    assert_eq!((fault.code, fault.place, after), (code, place, samples));
    assert!(!fault.allowed.holds(fault.value), "{fault:?}");
    let quantity = match place {
        FaultPlace::Actuator(_) => FaultQuantity::Effort,
        FaultPlace::Joint(_) => FaultQuantity::Position,
        FaultPlace::Finger => FaultQuantity::Time,
    };
    assert_eq!(fault.quantity, quantity);
}

#[test]
fn each_fault_is_found_where_and_when_its_limit_says() {
    let mut low = good();
    low.efforts[3] = 0.5;
    check(&low, FaultCode::LowEffort, FaultPlace::Actuator(3), 6);

    let mut high = good();
    high.efforts[0] = 151.0;
    high.desired_efforts[0] = 140.0;
    check(&high, FaultCode::HighEffort, FaultPlace::Actuator(0), 6);

    let mut outside = good();
    outside.efforts[1] = -6.0;
    check(&outside, FaultCode::OutOfRange, FaultPlace::Actuator(1), 3);

    let mut lost = good();
    lost.positions[1] = f64::NAN;
    check(&lost, FaultCode::NotFinite, FaultPlace::Joint(1), 2);
    lost = good();
    lost.desired_efforts[2] = f64::INFINITY;
    check(&lost, FaultCode::NotFinite, FaultPlace::Actuator(2), 2);

    let mut behind = good();
    behind.efforts[0] = 35.0;
    check(&behind, FaultCode::Tracking, FaultPlace::Actuator(0), 5);
    behind = good();
    behind.positions[0] = 0.6;
    check(&behind, FaultCode::Tracking, FaultPlace::Joint(0), 5);

    let mut stuck = good();
    stuck.desired_positions[0] = Some(0.3);
    check(&stuck, FaultCode::Stuck, FaultPlace::Joint(0), 4);
    stuck = good();
    stuck.desired_efforts[3] = 16.0;
    check(&stuck, FaultCode::Stuck, FaultPlace::Actuator(3), 4);

    let mut past = good();
    past.positions[1] = 1.6;
    past.desired_positions[1] = None;
    check(&past, FaultCode::JointLimit, FaultPlace::Joint(1), 2);

    let mut late = good();
    late.period_s = 0.004;
    check(&late, FaultCode::MissedDeadline, FaultPlace::Finger, 2);
    late = good();
    late.set_point_age_s = f64::NAN;
    check(&late, FaultCode::StaleSetPoint, FaultPlace::Finger, 1);

    assert_eq!(first_fault(&good()), None);
}

#[test]
fn a_gap_of_many_periods_is_as_many_missed_deadlines() {
    let mut limits = limits();
    limits.period_s.samples = 5;
    for (gap_s, is_fault) in [(0.004, false), (0.014, false), (0.016, true), (0.5, true)] {
        let mut monitor = Monitor::new(&limits);
        assert_eq!(monitor.update(&good()), None);
        let mut late = good();
        late.period_s = gap_s;
        let fault = monitor.update(&late);
        assert_eq!(
            fault.map(|fault| fault.code),
            is_fault.then_some(FaultCode::MissedDeadline)
        );
        // One that is in time ends the row.
        assert_eq!(monitor.update(&good()), fault);
        late.period_s = 0.014;
        assert_eq!(monitor.update(&late), fault, "after {gap_s} s");
    }
}

#[test]
fn a_position_that_cannot_be_is_a_fault_of_its_own() {
    let mut lost = good();
    lost.lost = 0b10;
    lost.positions[1] = 0.7;
    check(&lost, FaultCode::Jump, FaultPlace::Joint(1), 2);
    // Where it was all the time, although the joint went on.
    lost.positions[1] = 0.2;
    lost.believed[1] = 0.25;
    check(&lost, FaultCode::Stuck, FaultPlace::Joint(1), 2);
}

/// Encoders of the first two motors tell both joints.
fn limits_with_encoders() -> FaultLimits<2, 4> {
    let mut limits = limits();
    let encoder = EncoderFaultLimits {
        sensor: SensorFaultLimits {
            lost_samples: 2,
            plausible: Plausible {
                rate_change: 80.0,
                travel: 0.4,
            },
            range: FaultRange {
                low: -30.0,
                high: 30.0,
                samples: 3,
            },
            stuck: Stuck {
                band: 0.01,
                travel: 1.0,
                samples: 4,
            },
            tracking: Threshold::default(),
        },
        tells: 0b11,
        arms: 20.0,
    };
    limits.encoders = [Some(encoder), Some(encoder), None, None];
    for joint in &mut limits.joints {
        joint.sensor.range.samples = 0;
    }
    limits
}

#[test]
fn an_encoder_is_named_in_place_of_the_joints_that_it_tells() {
    let mut lost = good();
    lost.actuator_positions[1] = f64::NAN;
    lost.positions = Vector2::repeat(f64::NAN);
    lost.lost = 0b11;
    let mut outside = good();
    outside.actuator_positions[0] = 31.0;
    let mut stuck = good();
    stuck.desired_positions = [Some(0.3), Some(0.25)];
    stuck.actuator_positions[1] = 0.5;
    let mut jumped = good();
    jumped.actuator_positions[1] = 2.0;
    jumped.positions = Vector2::new(0.3, 0.1);
    jumped.lost = 0b11;
    for (seen, actuator, code, samples) in [
        (lost, 1, FaultCode::NotFinite, 2),
        (outside, 0, FaultCode::OutOfRange, 3),
        (stuck, 0, FaultCode::Stuck, 4),
        (jumped, 1, FaultCode::Jump, 2),
    ] {
        let mut monitor = Monitor::new(&limits_with_encoders());
        assert_eq!(monitor.update(&good()), None);
        let find = (1..100).find_map(|k| Some((monitor.update(&seen)?, k)));
        let (fault, after) = find.unwrap();
        let place = FaultPlace::Actuator(actuator);
        assert_eq!((fault.code, fault.place, after), (code, place, samples));
        assert_eq!(fault.quantity, FaultQuantity::Position);
        assert!(!fault.allowed.holds(fault.value), "{fault:?}");
    }
}

#[test]
fn a_joint_is_named_if_several_encoders_show_the_same() {
    let mut hit = good();
    // Both motors went with the first joint.
    hit.positions[0] = 0.3;
    hit.actuator_positions = actuators(&hit.positions);
    hit.lost = 0b01;
    let mut monitor = Monitor::new(&limits_with_encoders());
    assert_eq!(monitor.update(&good()), None);
    assert_eq!(monitor.update(&hit), None);
    let fault = monitor.update(&hit).unwrap();
    assert_eq!(
        (fault.code, fault.place),
        (FaultCode::Jump, FaultPlace::Joint(0))
    );
    assert!(!fault.allowed.holds(fault.value), "{fault:?}");
}

#[test]
fn samples_must_be_in_a_row() {
    let mut low = good();
    low.efforts[0] = 0.5;
    let mut monitor = monitor();
    for k in 0..60 {
        let observation = if k % 6 == 5 { good() } else { low };
        assert_eq!(monitor.update(&observation), None);
    }
}

#[test]
fn a_sensor_that_follows_or_rests_is_not_stuck() {
    let mut monitor = monitor();
    let mut observation = good();
    for k in 0..500 {
        // It rests for a while, then it moves with its set-point, 0.1 rad behind.
        let desired = if k < 200 {
            0.2
        } else {
            0.2 + 0.002 * f64::from(k - 200)
        };
        observation.desired_positions[0] = Some(desired);
        observation.positions[0] = if k < 200 { 0.2 } else { desired - 0.01 };
        assert_eq!(monitor.update(&observation), None, "sample {k}");
    }
}

#[test]
fn faults_stay_until_they_are_cleared() {
    let mut limits = limits();
    limits.actuators[0].effort.samples = 1;
    let mut monitor = Monitor::new(&limits);
    let mut broken = good();
    broken.efforts[0] = 160.0;
    broken.set_point_age_s = 1.0;
    let first = monitor.update(&broken).unwrap();
    let fault = Fault {
        place: FaultPlace::Actuator(0),
        quantity: FaultQuantity::Effort,
        code: FaultCode::HighEffort,
        value: 160.0,
        allowed: Requirement::AtMost(150.0),
    };
    assert_eq!(first, fault);
    for _ in 0..50 {
        assert_eq!(monitor.update(&good()), Some(first));
    }
    monitor.0.clear();
    assert_eq!(monitor.0.first(), None);
    assert_eq!(monitor.update(&good()), None);
}

#[test]
fn a_check_of_no_samples_is_off() {
    let mut limits = limits();
    limits.actuators[0].effort.samples = 0;
    limits.actuators[0].sensor.tracking.samples = 0;
    limits.set_point_age_s.samples = 0;
    let mut monitor = Monitor::new(&limits);
    let mut broken = good();
    broken.efforts[0] = 160.0;
    broken.set_point_age_s = 1.0;
    for _ in 0..100 {
        assert_eq!(monitor.update(&broken), None);
    }
}

#[test]
fn limits_say_what_is_wrong_with_them() {
    let mut wrong = limits();
    wrong.joints[1].limit.low = 2.0;
    let error = FingerMonitor::new(wrong).unwrap_err();
    assert_eq!(
        error.to_string(),
        "joint 1, 'past its limit': the upper end is 1.5; it must be at least 2"
    );
    let mut wrong = limits();
    wrong.actuators[3].effort.low = f64::NAN;
    assert!(matches!(
        FingerMonitor::new(wrong),
        Err(NumberError {
            at: Subject::ActuatorCheck(3, FaultCode::LowEffort),
            ..
        })
    ));
}

#[test]
fn ramps_say_what_is_wrong_with_their_numbers() {
    let (from, to) = ([100.0; 2], [4.0; 2]);
    for seconds in [0.0, 0.0025, -1.0, f64::NAN, f64::INFINITY] {
        assert!(
            SafeRamp::new(from, to, seconds, 400.0).is_err(),
            "{seconds}"
        );
    }
    assert!(SafeRamp::new(from, to, -1.0, -400.0).is_err());
    let error = SafeRamp::new([100.0, f64::NAN], to, 0.5, 400.0).unwrap_err();
    assert_eq!(error.what, "the way of an effort");
}

proptest! {
    /// No step, no way back, and the end is reached in the time.
    #[test]
    fn a_ramp_is_monotone_and_without_steps(
        begin in [-130.0..130.0_f64, -130.0..130.0_f64], to in -10.0..10.0_f64, samples in 2..400_u32,
    ) {
        let seconds = f64::from(samples) / 400.0;
        let mut ramp = SafeRamp::new(begin, [to; 2], seconds, 400.0).unwrap();
        let mut last = begin;
        for _ in 0..samples {
            prop_assert!(!ramp.is_done());
            let next = ramp.update();
            for ((start, last), next) in begin.iter().zip(last).zip(next) {
                let (step, whole) = (next - last, to - start);
                prop_assert!(step * whole >= 0.0);
                prop_assert!(step.abs() <= whole.abs() / f64::from(samples) + 1e-12);
            }
            last = next;
        }
        prop_assert!(ramp.is_done());
        prop_assert_eq!(last, [to; 2]);
        prop_assert_eq!(ramp.update(), [to; 2]);
    }
}

#[test]
fn the_readme_explains_every_fault_in_the_words_of_programs() {
    let readme = include_str!("../../README.md");
    for code in FaultCode::ALL {
        let (begin, end) = (format!("| {code} | "), format!(" | {} |", code.remedy()));
        let is_row = |line: &str| line.starts_with(&begin) && line.ends_with(&end);
        assert!(readme.lines().any(is_row), "{begin}…{end}");
    }
}

#[test]
fn a_fault_is_told_with_the_names_of_its_parts() {
    use FaultPlace::{Actuator, Finger, Joint};
    use FaultQuantity::{Effort, Position, Time};
    use Requirement::{AtLeast, AtMost, Within};
    let hand = include_str!("../../hands/utah-mit.toml");
    let hand = condor_hand::config::Hand::<4, 4, 8>::from_toml(hand, "utah-mit.toml").unwrap();
    let of_flexor = (Actuator(4), Effort);
    let of_distal = (Joint(3), Position);
    let of_index = (Finger, Time);
    for ((place, quantity), code, value, allowed, said) in [
        (
            of_flexor,
            FaultCode::LowEffort,
            0.0,
            AtLeast(1.0),
            "index.middle-flexor: effort of 0 N is too low, at least 1 N is allowed",
        ),
        (
            (Actuator(8), Effort),
            FaultCode::HighEffort,
            180.5,
            AtMost(180.0),
            "index.8: effort of 180.5 is too high, at most 180 is allowed",
        ),
        (
            of_distal,
            FaultCode::Tracking,
            0.254_321,
            AtMost(0.25),
            "index.distal: tracking error of 0.2543 rad, at most 0.25 rad is allowed",
        ),
        (
            of_distal,
            FaultCode::JointLimit,
            1.6,
            Within(-0.05, 1.55),
            "index.distal: position of 1.6 rad is past its limit, -0.05 to 1.55 rad is allowed",
        ),
        (
            of_distal,
            FaultCode::Jump,
            0.5,
            AtMost(0.026),
            "index.distal: position jumped by 0.5 rad, at most 0.026 rad is allowed",
        ),
        (
            (Actuator(4), Position),
            FaultCode::Stuck,
            0.002,
            AtMost(0.001),
            "index.middle-flexor: position is stuck, it should have changed by 0.002 m, at most 0.001 m is allowed",
        ),
        (
            (Actuator(4), Position),
            FaultCode::OutOfRange,
            0.2,
            Within(-0.1, 0.1),
            "index.middle-flexor: position of 0.2 m is out of its sensor's range, -0.1 to 0.1 m is allowed",
        ),
        (
            of_distal,
            FaultCode::NotFinite,
            f64::NAN,
            Requirement::Finite,
            "index.distal: position, or its set-point, is NaN, it must be a finite number",
        ),
        (
            of_index,
            FaultCode::MissedDeadline,
            0.004,
            AtMost(0.00375),
            "index: missed deadline, 0.004 s after the tick before, at most 0.00375 s is allowed",
        ),
        (
            of_index,
            FaultCode::StaleSetPoint,
            0.0625,
            AtMost(0.06),
            "index: no new set-point, the last one is 0.0625 s old, at most 0.06 s is allowed",
        ),
        (
            of_index,
            FaultCode::StaleSetPoint,
            f64::INFINITY,
            AtMost(0.06),
            "index: no set-point, at most 0.06 s without one is allowed",
        ),
    ] {
        let fault = Fault {
            place,
            quantity,
            code,
            value,
            allowed,
        };
        assert!(!allowed.holds(value), "{fault:?}");
        assert_eq!(fault.of(&hand.fingers[0]).to_string(), said);
    }
}
