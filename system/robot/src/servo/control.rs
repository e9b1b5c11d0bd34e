//! [`Control`]: what the servos of a processor compute, of what is measured now or was once.

use condor_hand::config::{Channel, Finger};
use condor_hand::controller::{FingerController, FingerSensors, FingerTick, write_finger};
use condor_hand::grasp::distributed::{DistributedGrasp, FingerControllers, HandJoints};
use condor_hand::servo::FingerReadings;
use nalgebra::Vector3;
use zerocopy::FromZeros as _;

use crate::failure::Failure;
use crate::recording::{INPUTS_OF_FINGER, Inputs, ServoOutputs, TickInputs};
use crate::{ACTUATORS, Actuators, FINGERS, JOINTS, Mechanism, RobotDescription, joints};

/// The readings of the sensors of a hand's fingers; nothing for fingers of other processors.
pub(crate) struct HandReadings {
    pub(crate) sensed: OfFingers<FingerReadings<JOINTS, ACTUATORS>>,
    pub(crate) joints: HandJoints<FINGERS, JOINTS>,
    pub(crate) inputs: Inputs,
}

/// Something of each finger of the hand that a processor serves.
pub(crate) type OfFingers<T> = [Option<T>; FINGERS];

/// The controllers of the fingers, which do what they are asked for before each tick.
pub(crate) trait Servos: FingerControllers<JOINTS> {
    /// One tick of a finger of the hand; none if the processor does not serve it.
    fn tick(
        &mut self,
        finger: usize,
        sensed: &FingerReadings<JOINTS, ACTUATORS>,
        gravity: &Vector3<f64>,
        period_s: f64,
    ) -> Option<FingerTick<JOINTS, ACTUATORS>>;
}

/// The servos of a processor, but for their controllers: from counts to counts.
pub(crate) struct Control<'r> {
    hand: &'r RobotDescription,
    served: [bool; FINGERS],
    sensors: OfFingers<FingerSensors<JOINTS, ACTUATORS>>,
    grasp: DistributedGrasp<Mechanism, FINGERS, JOINTS>,
    /// The rates of the last tick, rad/s.
    velocity: [[f64; JOINTS]; FINGERS],
}

impl<'r> Control<'r> {
    /// Before the first tick of a processor, which serves these fingers.
    ///
    /// # Errors
    /// [`Failure::Controller`] for arms or sensors that the description's check would have refused.
    pub(crate) fn new(
        hand: &'r RobotDescription,
        served: [bool; FINGERS],
    ) -> Result<Self, Failure> {
        let absent = joints::absent();
        let fingers = joints::with_mechanisms(hand, &absent);
        let mut sensors = [None; FINGERS];
        let all = sensors.iter_mut().zip(&hand.fingers).zip(served);
        for (finger, ((place, entry), served)) in all.enumerate() {
            if served {
                let failed = |error| Failure::Controller { finger, error };
                *place = Some(FingerSensors::new(entry).map_err(failed)?);
            }
        }
        Ok(Self {
            hand,
            served,
            sensors,
            grasp: DistributedGrasp::new(fingers, served),
            velocity: [[0.0; JOINTS]; FINGERS],
        })
    }

    pub(crate) const fn grasp(&self) -> &DistributedGrasp<Mechanism, FINGERS, JOINTS> {
        &self.grasp
    }

    /// The entries of the fingers that are served.
    fn entries(&self) -> OfFingers<&'r Finger<JOINTS, ACTUATORS>> {
        let mut entries = [None; FINGERS];
        for ((place, entry), served) in entries.iter_mut().zip(&self.hand.fingers).zip(self.served)
        {
            *place = served.then_some(entry);
        }
        entries
    }

    /// Returns the readings of the sensors, a period after the last tick; `read` returns the counts of each
    /// channel in the order of [`Inputs`], whose number it gets too.
    pub(crate) fn measure(
        &self,
        period_s: f64,
        controllers: &mut impl FingerControllers<JOINTS>,
        mut read: impl FnMut(usize, Channel) -> Option<u32>,
    ) -> HandReadings {
        let mut inputs = Inputs::new_zeroed();
        let mut first = 0;
        let sensed = self.sensors.each_ref().map(|sensors| {
            let mut number = first;
            first += INPUTS_OF_FINGER;
            Some(sensors.as_ref()?.read(|channel| {
                let counts = read(number, channel);
                inputs.set(number, counts);
                number += 1;
                counts
            }))
        });
        let position =
            sensed.map(|sensed| sensed.map_or([f64::NAN; JOINTS], |it| it.position.into()));
        let grasp = &self.grasp;
        HandReadings {
            sensed,
            joints: grasp.joints(position, self.velocity, period_s, controllers),
            inputs,
        }
    }

    /// Computes one tick.
    pub(crate) fn step(
        &mut self,
        measured: &HandReadings,
        given: &TickInputs,
        servos: &mut impl Servos,
    ) -> OfFingers<FingerTick<JOINTS, ACTUATORS>> {
        let gravity = self.gravity(given.acceleration);
        let (joints, period_s) = (&measured.joints, given.period_s);
        self.grasp
            .step(joints, &given.grasp, &gravity, period_s, servos);
        let mut finger = 0;
        let ticks = measured.sensed.map(|sensed| {
            let number = finger;
            finger += 1;
            servos.tick(number, &sensed?, &gravity, period_s)
        });
        for (tick, velocity) in ticks.iter().zip(&mut self.velocity) {
            if let Some(tick) = tick {
                *velocity = tick.output.velocity.into();
            }
        }
        ticks
    }

    /// Writes the commands of the actuators; `write` takes the counts of each channel.
    pub(crate) fn output(
        &self,
        ticks: &OfFingers<FingerTick<JOINTS, ACTUATORS>>,
        mut write: impl FnMut(Channel, u32),
    ) -> ServoOutputs {
        let mut output = ServoOutputs::default();
        let (counts, _) = output.counts.as_chunks_mut::<ACTUATORS>();
        let (command, _) = output.command.as_chunks_mut::<ACTUATORS>();
        let fingers = self.entries().into_iter().zip(ticks);
        for ((finger, counts), command) in fingers.zip(counts).zip(command) {
            let (Some(entry), Some(tick)) = finger else {
                continue;
            };
            *command = tick.output.command;
            let mut kept = counts.iter_mut();
            write_finger(entry, &tick.output.command, |channel, counts| {
                write(channel, counts);
                if let Some(place) = kept.next() {
                    // A converter has 16 bits at most.
                    *place = counts as u16;
                }
            });
        }
        output
    }

    /// In the axes of the palm, less its acceleration, m/s².
    fn gravity(&self, acceleration: [f64; 3]) -> Vector3<f64> {
        let gravity = Vector3::from(self.hand.gravity);
        if acceleration.iter().all(|part| part.is_finite()) {
            gravity - Vector3::from(acceleration)
        } else {
            gravity
        }
    }
}

/// The controllers of the fingers that a processor serves.
pub(crate) type Controllers = OfFingers<FingerController<Mechanism, Actuators, JOINTS, ACTUATORS>>;
