//! The whole tick of the servo loop, for sixteen joints.
//!
//! Every finger has its controller with the filters of all its twelve sensors, the checks for
//! faults, and the servos of its eight tendons, and its tip with the Jacobian is found anew. In one
//! tick of eight a set-point of the master comes; the joints follow it by the inverse dynamics. Once more
//! every joint has all guards, none of which stops it.

use std::array;
use std::hint::black_box;

use condor_hand::controller::FingerController;
use condor_hand::kinematics::{Kinematics as _, PlanarFinger};
use condor_hand::servo::{FingerReadings, ServoMode};
use condor_hand::tendon::TendonPairs;
use condor_hand::trajectory::{SetPoint, StopGuard};
use nalgebra::SVector;

use super::kinematics::{Tips, no_tips};
use super::subject::{FINGERS, GRAVITY, JOINTS, Joints, Subject};
use crate::Result;
use crate::race::Race;
use crate::swing::{self, TICKS};

/// The amplitude of the joints, as a part of their ranges.
const SWING: f64 = 0.2;

type Controllers = [FingerController<PlanarFinger, JOINTS>; FINGERS];

/// This task, in one of its ways.
pub(super) const TICK: &str = "tick, with tips and Jacobians";
pub(super) const POSITIONS: &str = "FingerController, positions";
const GUARDED: &str = "the same, with guards";

/// All conditions, beyond what the swing has of torque, N m, and tension, N.
const GUARD: StopGuard = StopGuard {
    motion: 1,
    torque: 10.0,
    tension: 1e3,
    contact: true,
};

/// A hand in motion: sensors say what was asked of them.
struct Hand {
    controllers: Controllers,
    /// The positions of the joints in each tick, and their velocities.
    motion: Vec<[[SetPoint<f64>; JOINTS]; FINGERS]>,
    tensions: [TendonPairs<f64, JOINTS>; FINGERS],
    /// The positions of the last tick.
    position: Joints,
    tips: Tips,
    guard: StopGuard,
    ticks: usize,
    /// Ticks from one set-point to the next.
    substeps: usize,
    period_s: f64,
    faults: usize,
}

impl Hand {
    /// Swings about the middle of all ranges, each joint with this guard, and has followed positions for a
    /// tick.
    fn new(subject: &Subject, guard: StopGuard) -> Result<Self> {
        let mut config = subject.config.clone();
        swing::filter_all(&mut config);
        let servo_hz = f64::from(config.servo_hz);
        let mut controllers = Vec::new();
        for (finger, planar) in config.fingers.iter().zip(&subject.planar) {
            let mut controller = FingerController::new(&config, finger, *planar)?;
            for joint in 0..JOINTS {
                controller.set_mode(joint, ServoMode::Position)?;
            }
            controllers.push(controller);
        }
        let limits = array::from_fn(|finger: usize| config.fingers[finger].limits());
        let motion = swing::motion(&limits, SWING, servo_hz);
        let start = motion[0].map(|finger| SVector::from(finger.map(|joint| joint.position)));
        let mut hand = Self {
            controllers: controllers
                .try_into()
                .map_err(|_| "the hand has another number of fingers")?,
            motion,
            tensions: array::from_fn(|finger| config.fingers[finger].least_tensions()),
            position: start,
            tips: no_tips(),
            guard,
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
            let guards = [self.guard; JOINTS];
            self.faults += usize::from(controller.follow(points, &guards).is_err());
        }
    }

    /// Computes commands from sensors.
    fn servo(&mut self) {
        let now = &self.motion[self.ticks % TICKS];
        for (finger, controller) in self.controllers.iter_mut().enumerate() {
            let sensed = FingerReadings {
                position: SVector::from(now[finger].map(|joint| joint.position)),
                tension: self.tensions[finger],
                touch: 0.0,
            };
            let tick = controller.tick(&sensed, &GRAVITY, self.period_s);
            self.faults += usize::from(tick.fault.is_some());
            self.tensions[finger] = tick.output.tension;
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

/// Lets the ticks take part.
///
/// # Errors
/// Returns an error if the hand has no controllers, or if a tick finds a fault.
pub(super) fn enter(race: &mut Race<'_>, subject: &Subject) -> Result<()> {
    for (name, guard) in [(POSITIONS, StopGuard::NONE), (GUARDED, GUARD)] {
        let mut hand = Hand::new(subject, guard)?;
        race.enter_failing(TICK, name, move |_| {
            hand.tick();
            match hand.faults {
                0 => Ok(()),
                faults => Err(format!("{faults} faults in {} ticks", hand.ticks).into()),
            }
        });
    }
    Ok(())
}
