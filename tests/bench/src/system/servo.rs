//! [`Fingers`]: the tick of a servo processor, from the counts of its sensors to those of its drives.
//!
//! It does what a tick of the hand's program does, but for what other processors need: a grasp, the variables, the
//! acceleration of the table. Set-points come through shared memory in one tick of eight.

use std::array;

use condor_hand::config::{Channel, Finger};
use condor_hand::controller::{FingerController, FingerTick, read_finger, write_finger};
use condor_hand::kinematics::PlanarFinger;
use condor_hand::servo::ServoMode;
use condor_hand::trajectory::{SetPoint, StopGuard};
use condor_mbox::published::Publisher;
use condor_mbox::{Exclusion, MemoryWindow, Published, Region};
use condor_robot::message::{HandIdentity, HandLoop, ServoLayout, ServoObject, SetPoints};
use nalgebra::Vector3;

use crate::Result;
use crate::swing::{self, TICKS};

const FINGERS: usize = 4;
const JOINTS: usize = 4;
const TEXT: &str = include_str!("../../../../condor-hand/hands/utah-mit.toml");
/// The amplitude of the joints, as a part of their ranges.
const SWING: f64 = 0.2;
/// Boards and lines that a channel may name.
const BOARDS: usize = 8;
const LINES: usize = 64;

type Hand = condor_hand::config::Hand<FINGERS, JOINTS>;
/// The counts of all lines.
type Lines = [[u32; LINES]; BOARDS];
/// The published values of a tick: positions and velocities.
pub(super) type Joints = [[f64; 8]; FINGERS];

/// The parts that are prepared before the loop begins.
pub(super) struct Bench {
    hand: Hand,
    /// The positions of the joints in each tick, and how they move.
    motion: Vec<[[SetPoint<f64>; JOINTS]; FINGERS]>,
    /// The positions of the joints in each tick, as the counts of their sensors.
    counts: Vec<[[u32; JOINTS]; FINGERS]>,
}

impl Bench {
    /// Reads the shipped hand, with every filter that there is.
    pub(super) fn new() -> Result<Self> {
        let mut hand = Hand::from_toml(TEXT, "utah-mit.toml").map_err(|error| error.to_string())?;
        swing::filter_all(&mut hand);
        let servo_hz = f64::from(hand.servo_hz);
        let limits = array::from_fn(|finger: usize| hand.fingers[finger].limits());
        let motion = swing::motion(&limits, SWING, servo_hz);
        let counts = motion
            .iter()
            .map(|fingers| {
                array::from_fn(|finger| {
                    let (joints, points) = (&hand.fingers[finger].joints, &fingers[finger]);
                    array::from_fn(|joint| joints[joint].adc.counts(points[joint].position))
                })
            })
            .collect();
        Ok(Self {
            hand,
            motion,
            counts,
        })
    }

    fn entries(&self) -> [&Finger<JOINTS>; FINGERS] {
        array::from_fn(|finger| &self.hand.fingers[finger])
    }
}

/// The loop.
pub(super) struct Fingers<'b, W> {
    bench: &'b Bench,
    entries: [&'b Finger<JOINTS>; FINGERS],
    servos: HandLoop<'b, PlanarFinger, W, FINGERS, JOINTS>,
    points: Vec<SetPoints<W, JOINTS>>,
    joints: Publisher<Joints, Region<W>>,
    gravity: Vector3<f64>,
    /// The counts that the converters read, and those that they are given.
    inputs: Lines,
    outputs: Lines,
    ticks: usize,
    /// Ticks from one set-point to the next.
    substeps: usize,
    period_s: f64,
    faults: usize,
}

fn line(lines: &mut Lines, channel: Channel) -> &mut u32 {
    &mut lines[usize::from(channel.board) % BOARDS][usize::from(channel.channel) % LINES]
}

impl<'b, W: MemoryWindow + Clone> Fingers<'b, W> {
    /// Makes the loop of the fingers, which follow positions.
    pub(super) fn new<X: Exclusion>(
        bench: &'b Bench,
        object: &'b mut ServoObject<FINGERS, JOINTS>,
        region: &Region<W>,
        places: ServoLayout<FINGERS, JOINTS>,
        joints: Published<Joints>,
        exclusion: X,
    ) -> Result<Self> {
        let hand = &bench.hand;
        let mut controllers = Vec::new();
        for entry in bench.entries() {
            let mechanism = entry.planar().ok_or("a finger has another form")?;
            let mut controller = FingerController::new(hand, entry, mechanism)?;
            for joint in 0..JOINTS {
                controller.set_mode(joint, ServoMode::Position)?;
            }
            controllers.push(Some(controller));
        }
        let controllers = controllers
            .try_into()
            .map_err(|_| "another number of fingers")?;
        let identity = HandIdentity::new(&hand.name, [""; FINGERS], hand.servo_hz);
        let (_, servos) = object
            .split(identity, region, places, exclusion, controllers)
            .map_err(|error| error.to_string())?;
        let points = (0..FINGERS).map(|finger| places.set_points(finger, region));
        let points: std::result::Result<_, _> = points.collect();
        let mut this = Self {
            bench,
            entries: bench.entries(),
            servos,
            points: points.map_err(|error| error.to_string())?,
            joints: joints
                .publisher(region.clone())
                .map_err(|error| error.to_string())?,
            gravity: Vector3::from(hand.gravity),
            inputs: [[0; LINES]; BOARDS],
            outputs: [[0; LINES]; BOARDS],
            ticks: 0,
            substeps: (hand.servo_hz / hand.trajectory_hz) as usize,
            period_s: 1.0 / f64::from(hand.servo_hz),
            faults: 0,
        };
        for entry in bench.entries() {
            let least = entry.least_tensions();
            for (joint, least) in entry.joints.iter().zip(&least) {
                let (flexor, extensor) = (&joint.flexor.adc, &joint.extensor.adc);
                *line(&mut this.inputs, flexor.channel()) = flexor.counts(least.flexor);
                *line(&mut this.inputs, extensor.channel()) = extensor.counts(least.extensor);
            }
        }
        Ok(this)
    }

    /// Runs the loop once, from the counts of the sensors to those of the drives.
    pub(super) fn tick(&mut self) {
        self.follow();
        self.scan();
        let inputs = &mut self.inputs;
        let sensed = self
            .entries
            .map(|entry| read_finger(entry, |channel| Some(*line(inputs, channel))));
        let mut published: Joints = Default::default();
        let entries = self.entries;
        for (finger, (entry, sensed)) in entries.iter().zip(&sensed).enumerate() {
            // The loop has as many fingers.
            let Some(tick) = self
                .servos
                .tick(finger, sensed, &self.gravity, self.period_s)
            else {
                continue;
            };
            self.faults += usize::from(tick.fault.is_some());
            let outputs = &mut self.outputs;
            write_finger(entry, &tick.output.command, |channel, counts| {
                *line(outputs, channel) = counts;
            });
            let (position, velocity) = published[finger].split_at_mut(JOINTS);
            position.copy_from_slice(sensed.position.as_slice());
            velocity.copy_from_slice(tick.output.velocity.as_slice());
            self.pull(entry, &tick);
        }
        self.faults += usize::from(self.joints.publish(&published).is_err());
        self.ticks += 1;
    }

    /// Publishes the set-points of the master, in those ticks in which the master has a tick, too.
    fn follow(&mut self) {
        if !self.ticks.is_multiple_of(self.substeps) {
            return;
        }
        let points = &self.bench.motion[(self.ticks + self.substeps) % TICKS];
        for (place, points) in self.points.iter_mut().zip(points) {
            self.faults += usize::from(place.publish(points, &[StopGuard::NONE; JOINTS]).is_err());
        }
    }

    /// Copies the positions at this tick, as the boards show them.
    fn scan(&mut self) {
        let counts = &self.bench.counts[self.ticks % TICKS];
        for (entry, counts) in self.entries.iter().zip(counts) {
            for (joint, counts) in entry.joints.iter().zip(counts) {
                *line(&mut self.inputs, joint.adc.channel()) = *counts;
            }
        }
    }

    /// Moves the tendons, which reach their tensions at once.
    fn pull(&mut self, entry: &Finger<JOINTS>, tick: &FingerTick<JOINTS>) {
        for (joint, tension) in entry.joints.iter().zip(&tick.output.tension) {
            let (flexor, extensor) = (&joint.flexor.adc, &joint.extensor.adc);
            *line(&mut self.inputs, flexor.channel()) = flexor.counts(tension.flexor);
            *line(&mut self.inputs, extensor.channel()) = extensor.counts(tension.extensor);
        }
    }

    /// Checks that the ticks that ran were those of fingers that move.
    ///
    /// # Errors
    /// Returns an error if there were faults, or if nothing came to the drives.
    pub(super) fn check(&self) -> Result<()> {
        if self.faults > 0 {
            return Err(format!("{} faults in {} ticks", self.faults, self.ticks).into());
        }
        if self.ticks == 0 || self.outputs.iter().flatten().all(|counts| *counts == 0) {
            return Err(format!("no drive was told anything in {} ticks", self.ticks).into());
        }
        Ok(())
    }
}
