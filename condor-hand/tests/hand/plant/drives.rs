//! How an effort follows its command.

use condor_hand::plant::{DriveKind, Pneumatic, SimDrive, SimFinger};
use condor_hand::transmission::Linear;
use nalgebra::{Vector1, Vector3};
use proptest::prelude::*;

use super::mechanisms::{Pendulum, exact, finger, free_joint, own_tendons};

const ROD: Pendulum = Pendulum {
    mass: 0.1,
    length: 0.1,
};

/// A pendulum with a flexor and an extensor.
type PulledRod = SimFinger<Pendulum, Linear<1, 2>, 1, 2>;

/// A joint too heavy to move.
fn held(drive: SimDrive) -> PulledRod {
    let mut joint = free_joint();
    joint.friction.armature = 1e6;
    finger(ROD, joint, drive)
}

fn pneumatic() -> SimDrive {
    SimDrive {
        low: 0.0,
        high: 130.0,
        kind: DriveKind::Pneumatic(Pneumatic {
            area_m2: 2.355e-4,
            valve_hz: 80.0,
            valve_damping: 0.7,
            fill_s: 1.0 / (40.0 * core::f64::consts::PI),
            heat_ratio: 1.4,
            atmosphere_pa: 101_325.0,
            volume_m3: 1e-5,
            viscous: 5.0,
            coulomb_n: 1.0,
            fade: 0.05,
        }),
    }
}

fn flexor(command: f64) -> [f64; 2] {
    [command, 0.0]
}

fn step(finger: &mut PulledRod, dt: f64, updates: u32, command: f64) -> f64 {
    finger
        .step(dt, updates, &flexor(command), &Vector3::zeros())
        .unwrap();
    finger.efforts()[0]
}

#[test]
fn the_exact_drive_pulls_alike_in_one_update_and_in_many() {
    let (mut coarse, mut fine) = (held(exact(0.008)), held(exact(0.008)));
    let at_once = step(&mut coarse, 0.01, 1, 50.0);
    let mut mean = 0.0;
    for _ in 0..100 {
        mean += step(&mut fine, 1e-4, 1, 50.0) / 100.0;
    }
    let derived = 50.0 * (1.0 - 0.8 * (1.0 - libm::exp(-1.25)));
    assert!(
        (at_once - derived).abs() < 1e-12,
        "{at_once} N, not {derived} N"
    );
    assert!((mean - derived).abs() < 1e-11, "{mean} N, not {derived} N");
}

#[test]
fn a_pneumatic_drive_settles_at_its_command_with_the_pole_of_its_chamber() {
    let mut finger = held(pneumatic());
    finger.reset(Vector1::zeros(), flexor(20.0)).unwrap();
    let rest = step(&mut finger, 0.1, 1000, 20.0);
    assert!((rest - 20.0).abs() < 0.02, "{rest} N");
    // After 15 ms the valve has done, and the chamber goes on alone.
    let early = 22.0 - step(&mut finger, 0.015, 150, 22.0);
    let late = 22.0 - step(&mut finger, 0.010, 100, 22.0);
    let time_constant = 0.010 / libm::log(early / late);
    let pole_hz = 1.0 / (2.0 * core::f64::consts::PI * time_constant);
    assert!((17.0..21.0).contains(&pole_hz), "{pole_hz} Hz");
    let settled = step(&mut finger, 0.5, 5000, 22.0);
    assert!((settled - 22.0).abs() < 0.02, "{settled} N");
}

#[test]
fn a_growing_chamber_loses_pressure() {
    // Drawn in at 0.5 m/s, against still.
    let mut joint = free_joint();
    joint.friction.armature = 1e6;
    let mut moved = finger(ROD, joint, pneumatic());
    moved.reset(Vector1::zeros(), flexor(60.0)).unwrap();
    for update in 0..12_000 {
        let torque = Vector1::new(if update < 10_000 { 5e7 } else { 0.0 });
        moved
            .advance(1e-4, &flexor(60.0), &Vector3::zeros(), &torque)
            .unwrap();
    }
    let rate = moved.qd().x * 0.01;
    // Coulomb friction is all there at ten times the speed where it fades.
    assert!((rate - 0.5).abs() < 1e-3, "{rate} m/s");
    // P' = 0: 60 N / A - P = fill gamma (P + atmosphere) A s' / V, and friction on top.
    let area = 2.355e-4;
    let growth = 1.4 * area * rate / 1e-5 / (40.0 * core::f64::consts::PI);
    let pressure = (60.0 / area - growth * 101_325.0) / (1.0 + growth);
    let expected = pressure * area - 5.0 * rate - 1.0;
    let tension = moved.efforts()[0];
    assert!(
        (tension - expected).abs() < 0.02,
        "{tension} N, not {expected} N"
    );
}

#[test]
fn a_slack_tendon_never_pushes() {
    let mut finger = finger(ROD, free_joint(), pneumatic());
    finger.reset(Vector1::zeros(), flexor(10.0)).unwrap();
    let (mut slack, mut taut) = (0, 0);
    for update in 0..20_000 {
        // To and fro, with the drive asked for nothing half of the time.
        let torque = Vector1::new(if update / 1000 % 2 == 0 { 0.3 } else { -0.3 });
        let command = flexor(if update / 5000 % 2 == 0 { 0.0 } else { 3.0 });
        finger
            .advance(1e-4, &command, &Vector3::zeros(), &torque)
            .unwrap();
        let tensions = finger.efforts();
        assert!(
            tensions.iter().all(|&tension| tension >= 0.0),
            "{tensions:?}"
        );
        if tensions[0] == 0.0 {
            slack += 1;
        } else {
            taut += 1;
        }
    }
    assert!(slack > 1000 && taut > 1000, "{slack} and {taut}");
}

#[test]
fn what_is_no_number_is_no_command() {
    for drive in [exact(0.008), pneumatic()] {
        let (mut with, mut without) = (held(drive), held(drive));
        for (odd, even) in [
            (f64::NAN, 0.0),
            (f64::INFINITY, 130.0),
            (-5.0, 0.0),
            (500.0, 130.0),
        ] {
            let odd = step(&mut with, 2.5e-3, 25, odd);
            let even = step(&mut without, 2.5e-3, 25, even);
            assert_eq!(odd.to_bits(), even.to_bits());
            assert_eq!(with.q(), without.q());
        }
        assert!(step(&mut with, 0.1, 1000, 130.0) > 100.0);
    }
}

#[test]
fn drives_begin_with_the_effort_nearest_to_zero() {
    for (low, high, first) in [
        (0.0, 130.0, 0.0),
        (-2.0, 2.0, 0.0),
        (5.0, 9.0, 5.0),
        (-9.0, -3.0, -3.0),
    ] {
        let drive = SimDrive {
            low,
            high,
            ..exact(0.1)
        };
        let mut finger = held(drive);
        assert_eq!(*finger.efforts(), [first; 2]);
        finger
            .step(5.0, 5000, &[f64::MIN, f64::MAX], &Vector3::zeros())
            .unwrap();
        let [least, greatest] = *finger.efforts();
        assert!((least - low).abs() < 1e-9 && (greatest - high).abs() < 1e-9);
    }
}

#[test]
fn impossible_drives_are_refused_with_the_value() {
    let mut joint = free_joint();
    let parameters = |drive, joint| condor_hand::plant::FingerParameters {
        joints: [joint].into(),
        drives: [drive; 2].into(),
    };
    let tendons = own_tendons::<1, 2>(0.01);
    let new = |parameters| SimFinger::new(ROD, tendons, parameters, Vector1::zeros()).unwrap_err();
    let refused = new(parameters(exact(0.0), joint));
    assert_eq!(
        refused.to_string(),
        "the time constant of a drive, s is 0; it must be above 0"
    );
    let drive = SimDrive {
        low: 5.0,
        high: 4.0,
        ..exact(0.1)
    };
    let refused = new(parameters(drive, joint));
    assert_eq!(
        refused.to_string(),
        "the greatest effort of a drive is 4; it must be at least 5"
    );
    joint.range = (0.5, 0.5);
    let refused = new(parameters(exact(0.1), joint));
    assert_eq!(
        refused.to_string(),
        "the end of a joint's range, rad is 0.5; it must be above 0.5"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn any_commands_leave_a_finite_state(
        commands in prop::collection::vec(any::<f64>(), 32),
        start in -1.0_f64..1.0,
    ) {
        let mut joint = free_joint();
        joint.range = (-1.0, 1.0);
        joint.stop.stiffness = 50.0;
        joint.stop.damping = 0.05;
        joint.friction.armature = 1e-5;
        let mut finger = finger(ROD, joint, pneumatic());
        finger.reset(Vector1::new(start), flexor(4.0)).unwrap();
        for pair in commands.chunks(2) {
            let commands = [pair[0], pair[1]];
            finger.step(2.5e-3, 25, &commands, &Vector3::new(0.0, 0.0, -9.81)).unwrap();
            prop_assert!(finger.q().x.abs() < 3.0, "{}", finger.q().x);
            prop_assert!(finger.qd().x.is_finite());
            prop_assert!((0.0..1e3).contains(&finger.efforts()[0]));
        }
    }
}
