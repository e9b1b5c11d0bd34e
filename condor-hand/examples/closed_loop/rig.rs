//! The shipped hand's controllers around a plant.

use std::error::Error;

use condor_hand::config;
use condor_hand::controller::{FingerController, FingerTick};
use condor_hand::kinematics::PlanarFinger;
use condor_hand::plant::{DriveKind, PlantModel, SimFinger, SimHand};
use condor_hand::servo::{FingerReadings, ServoMode};
use condor_hand::trajectory::{SetPoint, StopGuard};
use condor_hand::transmission::Linear;
use nalgebra::{SVector, Vector3};

pub(crate) type Result<T> = std::result::Result<T, Box<dyn Error>>;

pub(crate) const FINGERS: usize = 4;
/// Of a finger.
pub(crate) const JOINTS: usize = 4;

pub(crate) const ACTUATORS: usize = 8;

pub(crate) type Configuration = config::Hand<FINGERS, JOINTS, ACTUATORS>;

pub(crate) type Tendons = Linear<JOINTS, ACTUATORS>;

/// Something of each joint of the hand.
pub(crate) type OfJoints<T> = [[T; JOINTS]; FINGERS];

/// An effort of each actuator of the hand, N: flexors and extensors in turn.
pub(crate) type OfActuators = [[f64; ACTUATORS]; FINGERS];

/// The configuration in the package.
pub(crate) fn shipped() -> Result<Configuration> {
    let text = include_str!("../../hands/utah-mit.toml");
    Ok(Configuration::from_toml(text, "utah-mit.toml")?)
}

/// A hand that takes commands of actuators, and returns positions and efforts.
pub(crate) trait Plant {
    /// Puts the joints at rest at these positions, rad, without effort.
    fn reset(&mut self, positions: &OfJoints<f64>) -> Result<HandState>;

    /// Holds commands (N) for one period of the servos.
    fn step(&mut self, commands: &OfActuators) -> Result<HandState>;
}

/// The readings of all sensors of a hand.
pub(crate) type HandState = [FingerReadings<JOINTS, ACTUATORS>; FINGERS];

/// The plant of this package, with the integration of `MuJoCo`.
pub(crate) struct Simulated {
    hand: SimHand<PlanarFinger, Tendons, FINGERS, JOINTS, ACTUATORS>,
}

impl Simulated {
    pub(crate) fn new(configuration: &Configuration) -> Result<Self> {
        let machine = PlantModel {
            actuator: DriveKind::euler,
            ..PlantModel::default()
        };
        let fingers = each(|finger| {
            let finger = &configuration.fingers[finger];
            let mechanism = finger.planar().ok_or("a finger is not planar")?;
            let q = SVector::from(posture());
            let tendons = finger.transmission()?;
            let still = machine.finger(finger, mechanism, tendons, q)?;
            Ok::<_, Box<dyn Error>>(still)
        })?;
        let parameters = machine.hand_parameters(configuration);
        Ok(Self {
            hand: SimHand::new(fingers, parameters)?,
        })
    }

    fn state(&self) -> HandState {
        self.hand.fingers().each_ref().map(SimFinger::readings)
    }
}

impl Plant for Simulated {
    fn reset(&mut self, positions: &OfJoints<f64>) -> Result<HandState> {
        for (finger, &positions) in self.hand.fingers_mut().iter_mut().zip(positions) {
            finger.reset(positions.into(), [0.0; ACTUATORS])?;
        }
        Ok(self.state())
    }

    fn step(&mut self, commands: &OfActuators) -> Result<HandState> {
        self.hand.step(commands)?;
        Ok(self.state())
    }
}

/// In the middle of the joints' ranges, rad.
pub(crate) fn posture() -> [f64; JOINTS] {
    [0.0, 0.6, 0.8, 0.7]
}

/// Controllers, a plant, and what its sensors said last.
pub(crate) struct Rig<P> {
    plant: P,
    pub(crate) fingers: [FingerController<PlanarFinger, Tendons, JOINTS, ACTUATORS>; FINGERS],
    pub(crate) state: HandState,
    gravity: Vector3<f64>,
    period_s: f64,
    substeps: u32,
}

impl<P: Plant> Rig<P> {
    /// All joints in position mode in [`posture`].
    pub(crate) fn new(configuration: &Configuration, mut plant: P) -> Result<Self> {
        let mut fingers = each(|finger| {
            let finger = &configuration.fingers[finger];
            let mechanism = finger.planar().ok_or("a finger is not planar")?;
            let tendons = finger.transmission()?;
            let controller = FingerController::new(configuration, finger, mechanism, tendons)?;
            Ok::<_, Box<dyn Error>>(controller)
        })?;
        for controller in &mut fingers {
            for joint in 0..JOINTS {
                controller.set_mode(joint, ServoMode::Position)?;
            }
        }
        let mut rig = Self {
            state: plant.reset(&[posture(); FINGERS])?,
            plant,
            fingers,
            gravity: Vector3::from(configuration.gravity),
            period_s: 1.0 / f64::from(configuration.servo_hz),
            substeps: configuration.servo_hz / configuration.trajectory_hz,
        };
        // With which the modes begin.
        rig.tick()?;
        Ok(rig)
    }

    /// Ticks of the servos in one of the master.
    pub(crate) fn substeps(&self) -> u32 {
        self.substeps
    }

    /// Ticks of the servos in so many seconds.
    #[allow(clippy::cast_sign_loss, reason = "no time is negative")]
    pub(crate) fn ticks_in(&self, seconds: f64) -> u32 {
        (seconds / self.period_s).round() as u32
    }

    /// The period of the master, s.
    pub(crate) fn master_period_s(&self) -> f64 {
        self.period_s * f64::from(self.substeps)
    }

    /// Sets the set-points of all fingers for the next tick of the master.
    pub(crate) fn follow(&mut self, points: &OfJoints<SetPoint>) -> Result<()> {
        for (controller, points) in self.fingers.iter_mut().zip(points) {
            controller.follow(points, &[StopGuard::NONE; JOINTS])?;
        }
        Ok(())
    }

    /// One tick of the servos, on what the sensors said last, and the period after it.
    pub(crate) fn tick(&mut self) -> Result<[FingerTick<JOINTS, ACTUATORS>; FINGERS]> {
        let mut loops = self.fingers.iter_mut().zip(&self.state);
        let done = each(|finger| {
            let (controller, sensed) = loops.next().ok_or("a finger without sensors")?;
            let tick = controller.tick(sensed, &self.gravity, self.period_s);
            match tick.fault {
                Some(fault) => Err(format!("finger {finger}: {fault:?}").into()),
                None => Ok::<_, Box<dyn Error>>(tick),
            }
        })?;
        self.state = self.plant.step(&done.map(|tick| tick.output.command))?;
        Ok(done)
    }
}

/// Something of each finger, or the first thing that is wrong.
fn each<T>(make: impl FnMut(usize) -> Result<T>) -> Result<[T; FINGERS]> {
    let all: Result<Vec<T>> = (0..FINGERS).map(make).collect();
    all?.try_into()
        .map_err(|_| "another number of fingers".into())
}
