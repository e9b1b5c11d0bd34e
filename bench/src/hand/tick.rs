//! The whole tick of the servo loop, for sixteen joints.
//!
//! Every finger has its controller with the filters of all its twelve sensors, the checks for
//! faults, and the servos of its eight tendons, and its tip with the Jacobian is found anew. In one
//! tick of eight a set-point of the master comes. The joints follow positions by the inverse
//! dynamics, or make the torques of a grasp with a stiffness.

use std::array;
use std::hint::black_box;

use condor_hand::controller::FingerController;
use condor_hand::dynamics::Dynamics as _;
use condor_hand::grasp::{
    FingerState, Friction, GraspOutput, GraspStiffness, GraspTuning, Posture, SpatialGain, Squeeze,
    Surface, TorqueLimits, Wrench,
};
use condor_hand::kinematics::{Kinematics as _, PlanarFinger};
use condor_hand::servo::{JointTarget, Mode, Sensed};
use condor_hand::tendon::Pairs;
use condor_hand::trajectory::SetPoint;
use nalgebra::{SVector, Vector3};

use super::kinematics::{Tips, no_tips};
use super::race::Race;
use super::subject::{FINGERS, GRAVITY, JOINTS, Joints, Subject};
use crate::Result;
use crate::mbox::arena::count;
use crate::swing::{self, TICKS};

/// Ticks that are watched for allocations.
const WATCHED: usize = 4 * TICKS;

type Controllers = [FingerController<PlanarFinger, JOINTS>; FINGERS];
type Grasp = GraspStiffness<f64, FINGERS, JOINTS>;

/// This task, in one of its ways.
pub(super) const TICK: &str = "tick, with tips and Jacobians";
pub(super) const POSITIONS: &str = "FingerController, positions";

/// A hand in motion: sensors say what was asked of them.
struct Hand {
    controllers: Controllers,
    /// Where the joints are in each tick, and how fast they move.
    motion: Vec<[[SetPoint<f64>; JOINTS]; FINGERS]>,
    tensions: [Pairs<f64, JOINTS>; FINGERS],
    /// Of the last tick.
    position: Joints,
    velocity: Joints,
    tips: Tips,
    ticks: usize,
    /// Ticks from one set-point to the next.
    substeps: usize,
    period_s: f64,
    faults: usize,
}

impl Hand {
    /// Swings about the middle of all ranges, so far as part of them.
    fn new(subject: &Subject, swing: f64) -> Result<Self> {
        let mut config = subject.config.clone();
        swing::filter_all(&mut config);
        let servo_hz = f64::from(config.servo_hz);
        let mut controllers = Vec::new();
        for (finger, planar) in config.fingers.iter().zip(&subject.planar) {
            controllers.push(FingerController::new(&config, finger, *planar)?);
        }
        let limits = array::from_fn(|finger: usize| config.fingers[finger].limits());
        let motion = swing::motion(&limits, swing, servo_hz);
        let start = motion[0].map(|finger| SVector::from(finger.map(|joint| joint.position)));
        Ok(Self {
            controllers: controllers
                .try_into()
                .map_err(|_| "the hand has another number of fingers")?,
            motion,
            tensions: array::from_fn(|finger| config.fingers[finger].least_tensions()),
            position: start,
            velocity: [SVector::zeros(); FINGERS],
            tips: no_tips(),
            ticks: 0,
            substeps: (config.servo_hz / config.trajectory_hz) as usize,
            period_s: 1.0 / servo_hz,
            faults: 0,
        })
    }

    /// Gives all joints a mode, in which they have been for a while.
    fn begin(&mut self, mode: Mode) -> Result<()> {
        for controller in &mut self.controllers {
            for joint in 0..JOINTS {
                controller.set_mode(joint, mode)?;
            }
        }
        self.tick();
        Ok(())
    }

    /// The set-points of the master, where its tick is.
    fn follow(&mut self) {
        if !self.ticks.is_multiple_of(self.substeps) {
            return;
        }
        let points = &self.motion[(self.ticks + self.substeps) % TICKS];
        for (controller, points) in self.controllers.iter_mut().zip(points) {
            self.faults += usize::from(controller.follow(points).is_err());
        }
    }

    /// From sensors to commands.
    fn tick(&mut self) {
        let now = &self.motion[self.ticks % TICKS];
        for (finger, controller) in self.controllers.iter_mut().enumerate() {
            let sensed = Sensed {
                position: SVector::from(now[finger].map(|joint| joint.position)),
                tension: self.tensions[finger],
            };
            let tick = controller.tick(&sensed, &GRAVITY, self.period_s);
            self.faults += usize::from(tick.fault.is_some());
            self.tensions[finger] = tick.output.tension;
            self.position[finger] = tick.output.position;
            self.velocity[finger] = tick.output.velocity;
            black_box(&tick.output.command);
        }
        self.ticks += 1;
    }

    /// A tick of joints that follow positions.
    fn tick_positions(&mut self) {
        self.follow();
        self.tick();
        for (finger, tip) in self.tips.iter_mut().enumerate() {
            let mechanism = self.controllers[finger].mechanism();
            *tip = mechanism.kinematics(&self.position[finger]);
        }
        black_box(&mut self.tips);
    }

    fn states(&self) -> [FingerState<f64, JOINTS>; FINGERS] {
        array::from_fn(|finger| {
            let mechanism = self.controllers[finger].mechanism();
            let (q, qd) = (&self.position[finger], &self.velocity[finger]);
            FingerState::new(mechanism, q, qd, &mechanism.gravity_torque(q, &GRAVITY))
        })
    }

    /// A tick of fingers that hold something.
    fn tick_grasp(&mut self, grasp: &mut Grasp) {
        match grasp.update(&self.states()) {
            Ok(GraspOutput { torques, .. }) => {
                for (controller, torques) in self.controllers.iter_mut().zip(&torques) {
                    for (joint, &torque) in torques.iter().enumerate() {
                        let set = controller.set_target(joint, JointTarget::Grasp(torque));
                        self.faults += usize::from(set.is_err());
                    }
                }
            }
            Err(_) => self.faults += 1,
        }
        self.tick();
    }
}

/// A grasp of what the fingers have between them.
fn grasp(hand: &Hand) -> Result<Grasp> {
    let states = hand.states();
    let center = states.iter().map(|state| state.tip).sum::<Vector3<f64>>() / FINGERS as f64;
    Ok(GraspStiffness::engage(
        &states,
        GraspTuning {
            stiffness: SpatialGain::diagonal([200.0, 200.0, 200.0, 0.1, 0.1, 0.1])?,
            damping: SpatialGain::diagonal([2.0, 2.0, 2.0, 1e-3, 1e-3, 1e-3])?,
            center,
            feed_forward: Wrench::zero(),
            squeeze: Squeeze::equal(0.5)?,
            surface: Surface::Ball(center),
            friction: Friction::point(0.8)?,
            posture: Posture {
                stiffness: 0.05,
                damping: 1e-3,
            },
            limits: [TorqueLimits::none(); FINGERS],
        },
    )?)
}

/// Watches many ticks, and times them later.
///
/// # Errors
/// A tick that allocates, or finds a fault.
fn watched(
    name: &'static str,
    mut hand: Hand,
    mut tick: impl FnMut(&mut Hand) + 'static,
) -> Result<impl FnMut(usize) -> Result<f64> + 'static> {
    let before = count();
    for _ in 0..WATCHED {
        tick(&mut hand);
    }
    let made = count() - before;
    if made != 0 {
        return Err(format!("{WATCHED} ticks of {name} made {made} allocations").into());
    }
    let mut turn = move |calls| {
        let began = std::time::Instant::now();
        for _ in 0..calls {
            tick(&mut hand);
        }
        let ns = began.elapsed().as_nanos() as f64;
        match hand.faults {
            0 => Ok(ns),
            faults => Err(format!("{faults} faults in {} ticks of {name}", hand.ticks).into()),
        }
    };
    turn(0)?;
    Ok(turn)
}

/// Watches the ticks, and lets them take part.
///
/// # Errors
/// A tick that allocates, or finds a fault.
pub(super) fn enter(race: &mut Race, subject: &Subject) -> Result<()> {
    let mut following = Hand::new(subject, 0.2)?;
    following.begin(Mode::Position)?;
    let mut holding = Hand::new(subject, 0.01)?;
    holding.begin(Mode::Grasp)?;
    let mut grasp = grasp(&holding)?;
    let positions = watched("positions", following, Hand::tick_positions)?;
    let grasp = watched("the grasp", holding, move |hand| {
        hand.tick_grasp(&mut grasp);
    })?;
    race.enter_timed(TICK, POSITIONS, positions);
    race.enter_timed(TICK, "FingerController, grasp stiffness", grasp);
    Ok(())
}
