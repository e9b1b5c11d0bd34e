//! The whole tick of the servo loop, for sixteen joints.
//!
//! Every finger has its controller with the filters of all its twelve sensors, the checks for
//! faults, and the servos of its eight tendons, and its tip with the Jacobian is found anew. In one
//! tick of eight a set-point of the master comes; the joints follow it by the inverse dynamics.

use std::array;
use std::f64::consts::TAU;
use std::hint::black_box;

use condor_hand::config::MotionLimits;
use condor_hand::controller::FingerController;
use condor_hand::kinematics::{Kinematics as _, PlanarFinger};
use condor_hand::servo::{FingerReadings, ServoMode};
use condor_hand::trajectory::{SetPoint, StopGuard};
use condor_hand::transmission::Linear;
use nalgebra::SVector;

use super::laws::{Tips, no_tips};
use super::subject::{ACTUATORS, FINGERS, GRAVITY, JOINTS, Joints, Subject};
use crate::Result;
use crate::race::Race;

/// The amplitude of the joints, as a part of their ranges.
const SWING: f64 = 0.2;
/// Ticks after which the motion begins anew.
const TICKS: usize = 512;
/// Cutoffs of all filters, Hz.
const CUTOFF_HZ: f64 = 100.0;

type Controllers =
    [FingerController<PlanarFinger, Linear<JOINTS, ACTUATORS>, JOINTS, ACTUATORS>; FINGERS];

/// This task, and its row.
pub(super) const TICK: &str = "tick, with tips and Jacobians";
pub(super) const POSITIONS: &str = "FingerController, positions";

/// A hand in motion: sensors say what was asked of them.
struct Hand {
    controllers: Controllers,
    /// The positions of the joints in each tick, and their velocities.
    motion: Vec<[[SetPoint; JOINTS]; FINGERS]>,
    efforts: [[f64; ACTUATORS]; FINGERS],
    /// The positions of the last tick.
    position: Joints,
    tips: Tips,
    ticks: usize,
    /// Ticks from one set-point to the next.
    substeps: usize,
    period_s: f64,
    faults: usize,
}

impl Hand {
    /// Swings about the middle of all ranges, with every sensor filtered, and has followed positions for a
    /// tick.
    fn new(subject: &Subject) -> Result<Self> {
        let mut config = subject.config.clone();
        for finger in &mut config.fingers {
            for joint in &mut finger.joints {
                joint.servo.position_cutoff_hz = Some(CUTOFF_HZ);
            }
            for actuator in &mut finger.actuators {
                actuator.cutoff_hz = Some(CUTOFF_HZ);
            }
        }
        let servo_hz = f64::from(config.servo_hz);
        let mut controllers = Vec::new();
        for (finger, planar) in config.fingers.iter().zip(&subject.planar) {
            let mut controller =
                FingerController::new(&config, finger, *planar, finger.transmission()?)?;
            for joint in 0..JOINTS {
                controller.set_mode(joint, ServoMode::Position)?;
            }
            controllers.push(controller);
        }
        let limits = array::from_fn(|finger: usize| config.fingers[finger].limits());
        let motion = motion(&limits, servo_hz);
        let start = motion[0].map(|finger| SVector::from(finger.map(|joint| joint.position)));
        let mut hand = Self {
            controllers: controllers
                .try_into()
                .map_err(|_| "the hand has another number of fingers")?,
            motion,
            efforts: array::from_fn(|finger| config.fingers[finger].efforts_at_rest()),
            position: start,
            tips: no_tips(),
            ticks: 0,
            substeps: (config.servo_hz / config.trajectory_hz) as usize,
            period_s: 1.0 / servo_hz,
            faults: 0,
        };
        hand.servo();
        Ok(hand)
    }

    /// Passes the set-points of the master on, in those ticks in which the master has a tick, too.
    fn follow(&mut self) {
        if !self.ticks.is_multiple_of(self.substeps) {
            return;
        }
        let points = &self.motion[(self.ticks + self.substeps) % TICKS];
        for (controller, points) in self.controllers.iter_mut().zip(points) {
            let guards = [black_box(StopGuard::NONE); JOINTS];
            self.faults += usize::from(controller.follow(points, &guards).is_err());
        }
    }

    /// Computes commands from sensors.
    fn servo(&mut self) {
        let now = &self.motion[self.ticks % TICKS];
        for (finger, controller) in self.controllers.iter_mut().enumerate() {
            let sensed = FingerReadings {
                position: SVector::from(now[finger].map(|joint| joint.position)),
                actuator_position: [0.0; 8],
                effort: self.efforts[finger],
                touch: 0.0,
            };
            let tick = controller.tick(&sensed, &GRAVITY, self.period_s);
            self.faults += usize::from(tick.fault.is_some());
            self.efforts[finger] = tick.output.effort;
            self.position[finger] = tick.output.position;
            black_box(&tick.output.command);
        }
        self.ticks += 1;
    }

    /// Runs a tick of joints that follow positions.
    fn tick(&mut self) {
        self.follow();
        self.servo();
        for (finger, tip) in self.tips.iter_mut().enumerate() {
            let mechanism = self.controllers[finger].mechanism();
            *tip = mechanism.kinematics(&self.position[finger]);
        }
        black_box(&mut self.tips);
    }
}

/// Returns the positions of the joints in each tick, and their velocities and accelerations, when joints
/// with these limits swing about the middle.
fn motion(
    limits: &[MotionLimits<JOINTS>; FINGERS],
    servo_hz: f64,
) -> Vec<[[SetPoint; JOINTS]; FINGERS]> {
    let point = |tick: usize, finger: usize, joint: usize| {
        let (low, high) = (limits[finger].low[joint], limits[finger].high[joint]);
        // Whole swings in all ticks.
        let swings = (1 + (finger + joint) % 3) as f64;
        let angle = TAU * (swings * tick as f64 / TICKS as f64 + 0.1 * joint as f64);
        let rate = TAU * swings * servo_hz / TICKS as f64;
        let size = SWING * (high - low);
        SetPoint {
            position: f64::midpoint(low, high) + size * angle.sin(),
            velocity: size * rate * angle.cos(),
            acceleration: -size * rate * rate * angle.sin(),
        }
    };
    let points = |tick| array::from_fn(|finger| array::from_fn(|joint| point(tick, finger, joint)));
    (0..TICKS).map(points).collect()
}

/// Lets the ticks take part.
///
/// # Errors
/// Returns an error if the hand has no controllers, or if a tick finds a fault.
pub(super) fn enter(race: &mut Race<'_>, subject: &Subject) -> Result<()> {
    let mut hand = Hand::new(subject)?;
    race.enter_failing(TICK, POSITIONS, move |_| {
        hand.tick();
        match hand.faults {
            0 => Ok(()),
            faults => Err(format!("{faults} faults in {} ticks", hand.ticks).into()),
        }
    });
    Ok(())
}
