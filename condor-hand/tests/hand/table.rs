//! The controller of the table, on the simulated one.

#![allow(clippy::float_cmp, reason = "no force is exactly none")]

use condor_hand::config::Hand;
use condor_hand::controller::{
    AXES, AxisServo, FingerController, TableController, TableState, read_table, write_table,
};
use condor_hand::math::max;
use condor_hand::plant::{self, PlantModel};
use condor_hand::servo::{FingerReadings, ServoMode};
use condor_hand::trajectory::{
    MotionError, MotionProgress, Pace, Primitive, Profile, SetPoint, Target,
};
use condor_hand::{NumberError, Subject};
use nalgebra::{Vector3, Vector4};
use proptest::prelude::*;

const TEXT: &str = include_str!("../../hands/utah-mit.toml");
const PERIOD_S: f64 = 1.0 / 400.0;
const UPDATES: u32 = 5;
const MOST_N: f64 = 200.0;
const HIGH: f64 = 0.2;

fn hand() -> Hand<4, 4, 8> {
    Hand::from_toml(TEXT, "utah-mit.toml").unwrap()
}

fn machine() -> PlantModel {
    PlantModel {
        updates: UPDATES,
        ..PlantModel::default()
    }
}

/// A table under control.
struct Rig {
    controller: TableController,
    plant: plant::SimTable,
}

impl Rig {
    fn of(hand: &Hand<4, 4, 8>) -> Self {
        Self {
            controller: TableController::new(hand).unwrap().unwrap(),
            plant: machine().table(hand.table.as_ref().unwrap()).unwrap(),
        }
    }

    fn push(&mut self, force: [f64; AXES]) {
        for _ in 0..UPDATES {
            let dt = PERIOD_S / f64::from(UPDATES);
            self.plant.advance(dt, &force.into()).unwrap();
        }
    }

    /// One tick with exact sensors.
    fn tick(&mut self) -> condor_hand::controller::TableTick {
        let tick = self
            .controller
            .tick(&(*self.plant.position()).into(), PERIOD_S);
        self.push(tick.force);
        tick
    }

    fn until_ready(&mut self) {
        self.controller.start(0.5).unwrap();
        for _ in 0..4000 {
            if self.tick().state == TableState::Ready {
                return;
            }
        }
        panic!("never at home: {:?}", self.controller.state());
    }
}

fn stroke(profile: Profile, pace: Pace, to: [f64; AXES]) -> Primitive<AXES> {
    let mut motion = Primitive::new(pace, profile);
    for (axis, to) in to.into_iter().enumerate() {
        motion = motion.with(axis, Target::Absolute(to)).unwrap();
    }
    motion
}

#[test]
fn the_table_follows_its_motions_and_says_how_it_is_accelerated() {
    for profile in [Profile::MinimumJerk, Profile::Trapezoid] {
        let mut rig = Rig::of(&hand());
        rig.until_ready();
        let to = [0.15, -0.1, 0.05];
        let motion = stroke(profile, Pace::Duration(0.8), to);
        let ticket = rig.controller.enqueue(motion).unwrap();
        let (mut peak, mut wrong, mut fastest) = (0.0, 0.0, 0.0);
        for _ in 0..400 {
            let before = *rig.plant.position();
            let velocity = *rig.plant.velocity();
            let tick = rig.tick();
            let target = Vector3::from(tick.target.map(|point| point.position));
            peak = max(peak, (target - before).amax());
            let felt = (rig.plant.velocity() - velocity) / PERIOD_S;
            wrong = max(wrong, (felt - tick.acceleration).amax());
            fastest = max(fastest, tick.acceleration.amax());
        }
        assert_eq!(rig.controller.trajectory().progress(ticket), None);
        assert!(peak < 1e-3, "{profile:?}: {peak} m on the way");
        let rest = (rig.plant.position() - Vector3::from(to)).amax();
        assert!(rest < 1e-4, "{profile:?}: {rest} m at rest");
        assert!(fastest > 1.0);
        assert!(wrong < 0.25 * fastest, "{profile:?}: {wrong} of {fastest}");
    }
}

#[test]
fn counts_of_the_converters_are_enough() {
    let hand = hand();
    let table = hand.table.as_ref().unwrap();
    let mut rig = Rig::of(&hand);
    rig.until_ready();
    let to = [0.15, -0.1, 0.05];
    let motion = stroke(Profile::MinimumJerk, Pace::Duration(0.8), to);
    rig.controller.enqueue(motion).unwrap();
    for _ in 0..800 {
        let position = *rig.plant.position();
        let read = read_table(table, |channel| {
            let mut wires = table.axes.iter().zip(position.iter());
            let (axis, &position) = wires.find(|(axis, _)| axis.adc.channel() == channel)?;
            Some(axis.adc.counts(position))
        });
        assert!((Vector3::from(read) - position).amax() <= 0.5001e-4);
        let tick = rig.controller.tick(&read, PERIOD_S);
        let mut force = [0.0; AXES];
        write_table(table, &tick.force, |channel, counts| {
            let axis = table
                .axes
                .iter()
                .position(|axis| axis.dac.channel() == channel)
                .unwrap();
            let dac = &table.axes[axis].dac;
            force[axis] = (f64::from(counts) - dac.offset) / dac.gain;
        });
        rig.push(force);
    }
    let rest = (rig.plant.position() - Vector3::from(to)).amax();
    assert!(rest < 1.5e-4, "{rest} m");
}

#[test]
fn a_table_takes_motions_only_within_its_limits_and_after_it_has_been_home() {
    let mut hand = hand();
    hand.table.as_mut().unwrap().axes[1].home = 0.12;
    hand.check().unwrap();
    let mut rig = Rig::of(&hand);
    let motion = stroke(Profile::MinimumJerk, Pace::Speed(0.5), [0.1, 0.0, 0.0]);
    assert_eq!(
        rig.controller.enqueue(motion.clone()),
        Err(MotionError::NotReady)
    );
    assert_eq!(rig.controller.state(), TableState::Off);
    assert_eq!(rig.tick().force, [0.0; AXES]);
    rig.until_ready();
    let away = rig.plant.position() - Vector3::new(0.0, 0.12, 0.0);
    assert!(away.amax() < 1e-3, "{away:?}");
    rig.controller.enqueue(motion).unwrap();
    let beyond = stroke(Profile::MinimumJerk, Pace::Speed(0.5), [0.0, 0.0, 0.201]);
    assert!(matches!(
        rig.controller.enqueue(beyond),
        Err(MotionError::Number(NumberError { at: Subject::Joint(2), value, .. })) if value > HIGH
    ));
    assert!(matches!(
        rig.controller.start(1.5),
        Err(MotionError::Number(error)) if error.value > 1.0
    ));
    hand.table.as_mut().unwrap().axes.pop();
    let mut two = Rig::of(&hand);
    two.until_ready();
    let third = stroke(Profile::MinimumJerk, Pace::Speed(0.5), [0.0; AXES]);
    assert!(matches!(
        two.controller.enqueue(third),
        Err(MotionError::Mask { joints: 2, .. })
    ));
    hand.table = None;
    assert!(TableController::new(&hand).unwrap().is_none());
}

#[test]
fn it_comes_home_from_beyond_a_limit_and_is_never_driven_further_out() {
    let mut rig = Rig::of(&hand());
    for _ in 0..800 {
        rig.push([MOST_N, 0.0, 0.0]);
        // As long as it is off, it watches.
        rig.controller
            .tick(&(*rig.plant.position()).into(), PERIOD_S);
    }
    assert!(rig.plant.position().x > HIGH + 0.0015);
    rig.controller.start(0.3).unwrap();
    for _ in 0..2000 {
        let before = rig.plant.position().x;
        let tick = rig.tick();
        if before > HIGH {
            assert!(tick.force[0] <= 0.0, "{tick:?} at {before} m");
        }
        if tick.state == TableState::Ready {
            assert!(rig.plant.position().amax() < 1e-3);
            return;
        }
    }
    panic!("never at home");
}

#[test]
fn the_integral_takes_away_a_steady_load_and_stays_within_its_limit() {
    let mut hand = hand();
    let axis = &mut hand.table.as_mut().unwrap().axes[0];
    axis.servo.ki = 20_000.0;
    axis.servo.integral_max = 30.0;
    for (load, left) in [(20.0, 1e-5), (50.0, 20.0 / 4000.0 + 1e-5)] {
        let mut rig = Rig::of(&hand);
        rig.until_ready();
        for _ in 0..1600 {
            let tick = rig
                .controller
                .tick(&(*rig.plant.position()).into(), PERIOD_S);
            rig.push([tick.force[0] - load, tick.force[1], tick.force[2]]);
        }
        let error = rig.plant.position().x.abs();
        assert!(error <= left, "{load} N leave {error} m");
        assert!(error >= 0.9 * (left - 1e-5), "{load} N leave {error} m");
    }
}

#[test]
fn a_stop_on_the_way_home_keeps_the_table_where_it_stops() {
    let mut hand = hand();
    hand.table.as_mut().unwrap().axes[0].home = 0.18;
    let mut rig = Rig::of(&hand);
    rig.controller.start(0.5).unwrap();
    for _ in 0..160 {
        assert_eq!(rig.tick().state, TableState::Homing);
    }
    rig.controller.stop();
    for _ in 0..400 {
        rig.tick();
    }
    assert_eq!(rig.controller.state(), TableState::Stopped);
    let there = rig.plant.position().x;
    assert!(0.01 < there && there < 0.17, "{there} m");
    assert!(rig.plant.velocity().amax() < 1e-6);
    rig.until_ready();
    assert!((rig.plant.position().x - 0.18).abs() < 1e-3);
    rig.controller.disable();
    assert_eq!(rig.tick().force, [0.0; AXES]);
    assert_eq!(rig.controller.state(), TableState::Off);
}

#[test]
fn a_lost_reading_is_bridged_and_a_lost_sensor_ends_all_force() {
    let mut rig = Rig::of(&hand());
    rig.until_ready();
    let motion = stroke(Profile::MinimumJerk, Pace::Duration(0.8), [0.15, 0.0, 0.0]);
    let ticket = rig.controller.enqueue(motion).unwrap();
    for tick in 0..160 {
        let mut seen: [f64; AXES] = (*rig.plant.position()).into();
        if tick % 20 == 10 {
            seen[0] = f64::NAN;
        }
        let tick = rig.controller.tick(&seen, PERIOD_S);
        assert_eq!(tick.state, TableState::Ready);
        rig.push(tick.force);
    }
    assert!(matches!(
        rig.controller.trajectory().progress(ticket),
        Some(MotionProgress::Running { .. })
    ));
    let samples = hand().faults.sensor_samples;
    for sample in 1..=samples {
        let tick = rig.controller.tick(&[0.05, f64::INFINITY, 0.0], PERIOD_S);
        let failed = TableState::Failed { axis: 1 };
        assert_eq!(tick.state == failed, sample == samples, "{sample}");
        assert_eq!(tick.force == [0.0; AXES], sample == samples);
    }
    assert!(rig.controller.start(0.5).is_err());
    rig.controller.clear();
    assert_eq!(rig.controller.state(), TableState::Off);
    for _ in 0..400 {
        rig.tick();
    }
    rig.until_ready();
}

#[test]
fn a_table_whose_loop_stood_still_is_driven_no_further() {
    let mut rig = Rig::of(&hand());
    rig.until_ready();
    let motion = stroke(Profile::MinimumJerk, Pace::Duration(0.8), [0.1, 0.0, 0.0]);
    rig.controller.enqueue(motion).unwrap();
    for _ in 0..100 {
        assert_eq!(rig.tick().state, TableState::Ready);
    }
    let positions = (*rig.plant.position()).into();
    let tick = rig.controller.tick(&positions, 0.5);
    assert_eq!((tick.state, tick.force), (TableState::Late, [0.0; AXES]));
    assert!(rig.controller.start(0.5).is_err());
    rig.controller.clear();
    rig.until_ready();
}

/// A finger that holds its position on a palm that moves: the largest error, rad.
fn shaken(feed_forward: bool) -> f64 {
    let hand = hand();
    let finger = &hand.fingers[0];
    let machine = machine();
    let posture = Vector4::new(0.0, 0.6, 0.8, 0.7);
    let mut plant = plant::SimHand::new(
        [machine
            .finger(
                finger,
                finger.planar().unwrap(),
                finger.transmission().unwrap(),
                posture,
            )
            .unwrap()],
        machine.hand_parameters(&hand),
    )
    .unwrap()
    .with_table(machine.table(hand.table.as_ref().unwrap()).unwrap());
    let mut controller = FingerController::new(
        &hand,
        finger,
        finger.planar().unwrap(),
        finger.transmission().unwrap(),
    )
    .unwrap();
    for joint in 0..4 {
        controller.set_mode(joint, ServoMode::Position).unwrap();
    }
    let mut table = TableController::new(&hand).unwrap().unwrap();
    table.start(1.0).unwrap();
    let mut worst = 0.0;
    for tick in 0..800 {
        if tick == 200 {
            let motion = stroke(
                Profile::MinimumJerk,
                Pace::Duration(0.7),
                [0.15, 0.1, -0.15],
            );
            table.enqueue(motion).unwrap();
        }
        let moved = table.tick(&(*plant.table().unwrap().position()).into(), PERIOD_S);
        plant.drive_table(moved.force.into()).unwrap();
        let gravity = Vector3::from(hand.gravity)
            - if feed_forward {
                moved.acceleration
            } else {
                Vector3::zeros()
            };
        let of_finger = &plant.fingers()[0];
        let sensed = FingerReadings {
            position: *of_finger.q(),
            actuator_position: [0.0; 8],
            effort: *of_finger.efforts(),
            touch: 0.0,
        };
        let done = controller.tick(&sensed, &gravity, PERIOD_S);
        assert_eq!(done.fault, None);
        plant.step(&[done.output.command]).unwrap();
        if tick >= 200 {
            worst = max(worst, (plant.fingers()[0].q() - posture).amax());
        }
    }
    worst
}

#[test]
fn a_finger_that_knows_of_the_table_stays_where_it_is() {
    let (blind, knowing) = (shaken(false), shaken(true));
    assert!(blind > 0.002, "the table does not shake: {blind} rad");
    assert!(knowing < blind / 8.0, "{knowing} rad of {blind} rad");
}

#[test]
fn a_servo_of_an_axis_needs_no_table() {
    let hand = hand();
    let axis = &hand.table.as_ref().unwrap().axes[0];
    let mut servo = AxisServo::new(axis, 400.0).unwrap();
    let at_rest = servo.update(&SetPoint::rest(0.01), 0.0, PERIOD_S);
    assert!((at_rest - axis.servo.kp * 0.01).abs() < 1e-9);
    // Beyond the limit nothing leads further out.
    let outwards = SetPoint::rest(0.3);
    let forces = [(); 400].map(|()| servo.update(&outwards, HIGH + 0.001, PERIOD_S));
    assert!(forces.iter().all(|&force| force <= 0.0));
    assert_eq!(forces.last(), Some(&0.0));
    let mut wrong = axis.clone();
    wrong.servo.kv = -1.0;
    assert!(AxisServo::new(&wrong, 400.0).is_err());
}

proptest! {
    #[test]
    fn forces_are_finite_and_within_what_drives_have(
        readings in prop::collection::vec(prop::array::uniform3(any::<f64>()), 200),
        near in prop::collection::vec(prop::array::uniform3(-0.3..0.3), 200),
        calls in prop::collection::vec((0_u8..12, any::<f64>(), any::<u32>()), 200),
    ) {
        let mut table = TableController::new(&hand()).unwrap().unwrap();
        for ((reading, near), (call, value, mask)) in readings.iter().zip(&near).zip(calls) {
            match call {
                0..4 => { let _ = table.start(0.7); }
                4 => { let _ = table.start(value); }
                5 => table.stop(),
                6 => table.pause(),
                7 => table.resume(),
                8 => table.disable(),
                9 => table.clear(),
                _ => {
                    let pace = Pace::Duration(value);
                    let mut motion = stroke(Profile::Cubic, pace, *near);
                    motion.mask = mask;
                    let _ = table.enqueue(motion);
                }
            }
            for positions in [near, reading] {
                let tick = table.tick(positions, PERIOD_S);
                for force in tick.force {
                    prop_assert!(force.abs() <= MOST_N, "{force}");
                }
                for point in tick.target {
                    prop_assert!(point.position.is_finite() && point.velocity.is_finite());
                }
                prop_assert!(tick.acceleration.iter().all(|part| part.is_finite()));
            }
        }
    }
}
