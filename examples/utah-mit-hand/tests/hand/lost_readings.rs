//! Sensors that fail while the hand makes the motions that ship: finger by finger, with the shipped
//! controllers around the simulated fingers, and readings as the converters make them.

use std::sync::LazyLock;

use condor_hand::controller::FingerController;
use condor_hand::fault::{Fault, FaultCode, FaultPlace};
use condor_hand::kinematics::PlanarFinger;
use condor_hand::math::{max, min};
use condor_hand::plant::{self, PlantModel};
use condor_hand::servo::{FingerReadings, ServoMode};
use condor_hand::trajectory::{Generator, Observations, SetPoint, StopGuard, motion};
use condor_robot::compile::joint_names;
use condor_robot::plant as plant_of_the_hand;
use condor_robot::{ACTUATORS, Actuators, FINGERS, JOINTS, RobotDescription};
use nalgebra::{SVector, Vector3};

const HAND: &str = include_str!("../../../../condor-hand/hands/utah-mit.toml");
const ALL: usize = FINGERS * JOINTS;
const PERIOD_S: f64 = 1.0 / 400.0;
const SUBSTEPS: usize = 8;

const MOTIONS: [(&str, &str); 7] = [
    ("open", include_str!("../../motions/open.toml")),
    ("fist", include_str!("../../motions/fist.toml")),
    ("pinch", include_str!("../../motions/pinch.toml")),
    ("tripod", include_str!("../../motions/tripod.toml")),
    ("counting", include_str!("../../motions/counting.toml")),
    ("wave", include_str!("../../motions/wave.toml")),
    ("grasp", include_str!("../../motions/grasp.toml")),
];

/// The robot of the hand system, updated at 10 kHz.
const MACHINE: PlantModel = PlantModel {
    updates: 25,
    ..plant_of_the_hand::MACHINE
};

fn hand() -> RobotDescription {
    RobotDescription::from_toml(HAND, "utah-mit.toml").unwrap()
}

/// What the sensor of a joint does to its reading, rad.
type Spoil = fn(reading: f64, before: f64) -> f64;

/// A finger, its controller, and what happened to it.
#[derive(Clone)]
struct Finger<'h> {
    entry: &'h condor_hand::config::Finger<JOINTS, ACTUATORS>,
    plant: plant::SimHand<PlanarFinger, Actuators, 1, JOINTS, ACTUATORS>,
    controller: FingerController<PlanarFinger, Actuators, JOINTS, ACTUATORS>,
    said: SVector<f64, JOINTS>,
    gravity: Vector3<f64>,
    fault: Option<Fault>,
}

impl<'h> Finger<'h> {
    fn new(hand: &'h RobotDescription, number: usize, q: SVector<f64, JOINTS>) -> Self {
        let entry = &hand.fingers[number];
        let mechanism = entry.planar().unwrap();
        let actuators = entry.transmission().unwrap();
        let plant = MACHINE.finger(entry, mechanism, actuators, q).unwrap();
        let mut finger = Self {
            entry,
            plant: plant::SimHand::new([plant], MACHINE.hand_parameters(hand)).unwrap(),
            controller: FingerController::new(hand, entry, mechanism, actuators).unwrap(),
            said: q,
            gravity: Vector3::from(hand.gravity),
            fault: None,
        };
        finger.tick(None);
        for joint in 0..JOINTS {
            finger
                .controller
                .set_mode(joint, ServoMode::Position)
                .unwrap();
        }
        finger.tick(None);
        finger
    }

    fn position(&self) -> SVector<f64, JOINTS> {
        *self.plant.fingers()[0].q()
    }

    /// One tick, in which the sensor of a joint may be spoilt.
    fn tick(&mut self, spoilt: Option<(usize, Spoil)>) {
        let counted =
            |input: &condor_hand::config::InputChannel, value| input.value(input.counts(value));
        let is = self.position();
        let efforts = *self.plant.fingers()[0].efforts();
        let mut sensed = FingerReadings {
            position: SVector::zeros(),
            actuator_position: [0.0; 8],
            effort: [0.0; ACTUATORS],
            touch: 0.0,
        };
        for (joint, entry) in self.entry.joints.iter().enumerate() {
            sensed.position[joint] = counted(entry.adc.as_ref().unwrap(), is[joint]);
        }
        for (actuator, entry) in self.entry.actuators.iter().enumerate() {
            sensed.effort[actuator] = counted(entry.adc.as_ref().unwrap(), efforts[actuator]);
        }
        if let Some((joint, spoil)) = spoilt {
            sensed.position[joint] = spoil(sensed.position[joint], self.said[joint]);
        }
        self.said = sensed.position;
        let tick = self.controller.tick(&sensed, &self.gravity, PERIOD_S);
        self.fault = tick.fault;
        self.plant.step(&[tick.output.command]).unwrap();
    }

    /// A tick of a motion, with the master's set-points where they come.
    fn go_on(
        &mut self,
        tick: usize,
        points: &[[SetPoint; JOINTS]],
        spoilt: Option<(usize, Spoil)>,
    ) {
        if tick.is_multiple_of(SUBSTEPS) {
            self.controller
                .follow(&points[tick / SUBSTEPS], &[StopGuard::NONE; JOINTS])
                .unwrap();
        }
        self.tick(spoilt);
    }
}

/// The set-points of each finger at each tick of the master, of a motion that begins where it ends.
fn set_points(hand: &RobotDescription, text: &str) -> [Vec<[SetPoint; JOINTS]>; FINGERS] {
    let names = joint_names(hand);
    let motions = motion::load::<ALL>(text, "motion", &names).unwrap();
    let joints = || hand.fingers.iter().flat_map(|finger| &finger.joints);
    let limits: Vec<_> = joints().map(|joint| joint.limits.with_jerk(2e5)).collect();
    let middles: Vec<_> = joints()
        .map(|joint| f64::midpoint(joint.limits.low, joint.limits.high))
        .collect();
    let (limits, middles) = (limits.try_into().unwrap(), middles.try_into().unwrap());
    let mut generator = Generator::<ALL, 32>::new(limits, middles, 0.02).unwrap();
    for motion in motions {
        generator.enqueue(motion).unwrap();
    }
    let mut points = [const { Vec::new() }; FINGERS];
    while !generator.is_idle() {
        let all = generator.tick(&Observations::none());
        for (points, finger) in points.iter_mut().zip(all.as_chunks::<JOINTS>().0) {
            points.push(*finger);
        }
    }
    points
}

/// What became of a finger after a sensor of it was spoilt.
struct Seen {
    joint: usize,
    fault: Option<Fault>,
    /// In which tick the fault was seen, from 1.
    named: usize,
    /// The largest distance of any joint from where it would have been, in [`WATCHED`] ticks, degrees.
    off_deg: f64,
    /// The least rate of the joint's set-points, in the sense of the first, until a failure is to have a
    /// name, rad/s.
    least_rate: f64,
}

/// So many ticks of a failure are watched.
const WATCHED: usize = 20;
/// Within so many ticks a failure is to have a name.
const NAMED: usize = 10;
/// Every so many ticks of a motion the sensors fail, one after another.
const EVERY: usize = 61;

/// A finger in a motion in which no sensor fails.
struct Undisturbed {
    /// The name of the motion.
    name: &'static str,
    points: Vec<[SetPoint; JOINTS]>,
    /// The finger before some of the ticks.
    states: Vec<(usize, Finger<'static>)>,
    /// The positions of the joints after each tick.
    track: Vec<SVector<f64, JOINTS>>,
}

/// The shipped hand.
static UTAH_MIT: LazyLock<RobotDescription> = LazyLock::new(hand);

/// All fingers in all motions, from which all tests begin.
static UNDISTURBED: LazyLock<Vec<Undisturbed>> = LazyLock::new(|| {
    let hand = &UTAH_MIT;
    let motions = MOTIONS.iter().flat_map(|(name, text)| {
        let fingers = set_points(hand, text).into_iter().enumerate();
        fingers.map(move |(number, points)| undisturbed(hand, name, number, points))
    });
    motions.collect()
});

fn undisturbed(
    hand: &'static RobotDescription,
    name: &'static str,
    number: usize,
    points: Vec<[SetPoint; JOINTS]>,
) -> Undisturbed {
    let start = points[0].map(|point| point.position);
    let mut finger = Finger::new(hand, number, start.into());
    for _ in 0..200 {
        finger.tick(None);
    }
    let (mut states, mut track) = (Vec::new(), Vec::new());
    for tick in 0..points.len() * SUBSTEPS {
        if tick % EVERY == 0 {
            states.push((tick, finger.clone()));
        }
        finger.go_on(tick, &points, None);
        assert_eq!(finger.fault, None, "{name}");
        track.push(finger.position());
    }
    Undisturbed {
        name,
        points,
        states,
        track,
    }
}

/// Spoils each sensor for some ticks at moments of all motions, each time from the state that the hand
/// would have had, and shows what became of it.
fn spoil_each(ticks: usize, spoil: Spoil, mut show: impl FnMut(&str, &Seen)) {
    for motion in &*UNDISTURBED {
        let points = &motion.points;
        for (begin, state) in &motion.states {
            let Some(undisturbed) = motion.track.get(*begin..begin + WATCHED) else {
                continue;
            };
            for joint in 0..JOINTS {
                let rate = |tick: usize| points[tick / SUBSTEPS][joint].velocity;
                let sense = rate(*begin).signum();
                // From a master's tick before the failure on.
                let first = begin.saturating_sub(SUBSTEPS);
                let rates = (first..begin + NAMED).map(|tick| rate(tick) * sense);
                let mut seen = Seen {
                    joint,
                    fault: None,
                    named: 0,
                    off_deg: 0.0,
                    least_rate: rates.fold(f64::MAX, min),
                };
                let mut finger = state.clone();
                for (tick, undisturbed) in undisturbed.iter().enumerate() {
                    let spoilt = (tick < ticks).then_some((joint, spoil));
                    finger.go_on(begin + tick, points, spoilt);
                    if seen.fault.is_none() {
                        seen.fault = finger.fault;
                        seen.named = tick + 1;
                    }
                    let off = (finger.position() - undisturbed).amax().to_degrees();
                    seen.off_deg = max(seen.off_deg, off);
                }
                show(motion.name, &seen);
            }
        }
    }
}

/// A failure of all ticks, which no finger gets through.
fn lose_all(spoil: Spoil, code: FaultCode) {
    let (mut runs, mut worst) = (0, 0.0);
    spoil_each(WATCHED, spoil, |name, seen| {
        let fault = seen.fault.expect(name);
        assert_eq!(
            (fault.code, fault.place),
            (code, FaultPlace::Joint(seen.joint))
        );
        assert!(seen.named <= NAMED, "{name}: {} ticks", seen.named);
        worst = max(worst, seen.off_deg);
        runs += 1;
    });
    println!("{runs} runs, {worst} degrees off at most");
    assert!(runs > 1000 && worst < 5.0, "{runs} runs: {worst} degrees");
}

#[test]
fn a_joint_whose_readings_are_lost_stays_where_it_was_to_be_until_the_fault_is_named() {
    lose_all(|_, _| f64::NAN, FaultCode::NotFinite);
}

#[test]
fn readings_that_jump_and_stay_there_are_lost_ones() {
    lose_all(|reading, _| reading + 0.3, FaultCode::Jump);
}

#[test]
fn a_reading_that_is_none_moves_nothing_and_is_no_fault() {
    for (spoil, most_deg) in [
        ((|_, _| f64::NAN) as Spoil, 0.2),
        (|reading, _| reading + 0.3, 0.2),
        // Not so far that the joint could not be there.
        (|reading, _| reading + 0.03, 3.0),
    ] {
        spoil_each(1, spoil, |name, seen| {
            assert_eq!(seen.fault, None, "{name}");
            assert!(seen.off_deg < most_deg, "{name}: {} degrees", seen.off_deg);
        });
    }
}

#[test]
fn a_sensor_that_freezes_in_motion_is_recognised_within_a_few_ticks() {
    let (mut runs, mut worst) = (0, 0.0);
    spoil_each(
        WATCHED,
        |_, before| before,
        |name, seen| {
            if seen.least_rate < 0.5 {
                return;
            }
            let fault = seen.fault.expect(name);
            assert_eq!(
                (fault.code, fault.place),
                (FaultCode::Stuck, FaultPlace::Joint(seen.joint))
            );
            assert!(seen.named <= NAMED, "{name}: {} ticks", seen.named);
            worst = max(worst, seen.off_deg);
            runs += 1;
        },
    );
    println!("{runs} runs, {worst} degrees off at most");
    assert!(runs > 200 && worst < 5.0, "{runs} runs: {worst} degrees");
}
