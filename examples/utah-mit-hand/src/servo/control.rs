//! [`Control`]: what the servos of a processor compute, of what is measured now or was once.

use condor_hand::config::Channel;
use condor_hand::controller::{FingerController, Tick, read_finger, write_finger};
use condor_hand::kinematics::PlanarFinger;
use condor_hand::servo::{Sensed, ServoOutput};
use condor_hand::tendon::Pair;
use nalgebra::{Vector3, Vector4};

use crate::grasp::{Felt, GraspLaw, Own, Told};
use crate::recording::{Inputs, Output};
use crate::{Failure, JOINTS, SERVED, UtahMit};

/// What the controllers are given in a tick besides what is measured and what messages ask for.
#[derive(Clone, Debug)]
pub(crate) struct Given {
    /// The time since the last tick, s; for the first one, a period.
    pub(crate) period_s: f64,
    /// That of the palm, in its own axes, m/s².
    pub(crate) acceleration: [f64; 3],
    pub(crate) told: Told,
}

/// What the converters of the sensors say.
pub(crate) struct Measured {
    pub(crate) sensed: [Sensed<f64, JOINTS>; SERVED],
    pub(crate) felt: Felt,
    pub(crate) inputs: Inputs,
}

/// The controllers of the fingers, which do what they are asked for before each tick.
pub(crate) trait Servos: Own {
    /// One tick of the finger at a place; none if there is none.
    fn tick(
        &mut self,
        place: usize,
        sensed: &Sensed<f64, JOINTS>,
        gravity: &Vector3<f64>,
        period_s: f64,
    ) -> Option<Tick<JOINTS>>;
}

/// The servos of a processor, but for their controllers: from counts to counts.
pub(crate) struct Control<'r> {
    hand: &'r UtahMit,
    served: [usize; SERVED],
    grasp: GraspLaw,
    /// Of the last tick, rad/s.
    velocity: [Vector4<f64>; SERVED],
}

impl<'r> Control<'r> {
    /// Before the first tick of a processor, which serves these fingers.
    pub(crate) fn new(
        hand: &'r UtahMit,
        number: u8,
        served: [usize; SERVED],
    ) -> Result<Self, Failure> {
        Ok(Self {
            hand,
            served,
            grasp: GraspLaw::new(hand, number)?,
            velocity: [Vector4::zeros(); SERVED],
        })
    }

    pub(crate) const fn grasp(&self) -> &GraspLaw {
        &self.grasp
    }

    /// What the sensors say; `read` is asked for the counts of each channel in the order of
    /// [`Inputs`], whose number it gets too.
    pub(crate) fn measure(&self, mut read: impl FnMut(usize, Channel) -> Option<u32>) -> Measured {
        let mut inputs = Inputs::default();
        let mut place = 0;
        let sensed = self.served.map(|finger| {
            let mut number = place * JOINTS * 3;
            place += 1;
            let Some(entry) = self.hand.fingers.get(finger) else {
                return Sensed {
                    position: Vector4::repeat(f64::NAN),
                    tension: [Pair::both(f64::NAN); JOINTS],
                };
            };
            read_finger(entry, |channel| {
                let counts = read(number, channel);
                inputs.set(number, counts);
                number += 1;
                counts
            })
        });
        let felt = Felt {
            position: sensed.map(|sensed| sensed.position),
            velocity: self.velocity,
        };
        Measured {
            sensed,
            felt,
            inputs,
        }
    }

    /// One tick.
    pub(crate) fn step(
        &mut self,
        measured: &Measured,
        given: &Given,
        servos: &mut impl Servos,
    ) -> [Tick<JOINTS>; SERVED] {
        let gravity = self.gravity(given.acceleration);
        self.grasp.step(&measured.felt, &gravity, given, servos);
        let mut place = 0;
        let ticks = measured.sensed.map(|sensed| {
            let tick = servos.tick(place, &sensed, &gravity, given.period_s);
            place += 1;
            // There are as many fingers in the loop.
            tick.unwrap_or_else(nothing)
        });
        for (tick, velocity) in ticks.iter().zip(&mut self.velocity) {
            *velocity = tick.output.velocity;
        }
        ticks
    }

    /// What the actuators get; `write` is given the counts of each channel.
    pub(crate) fn output(
        &self,
        ticks: &[Tick<JOINTS>; SERVED],
        mut write: impl FnMut(Channel, u32),
    ) -> Output {
        let mut output = Output::default();
        let (counts, _) = output.counts.as_chunks_mut::<{ 2 * JOINTS }>();
        let (command, _) = output.command.as_chunks_mut::<{ 2 * JOINTS }>();
        let places = self.served.iter().zip(ticks).zip(counts).zip(command);
        for (((&finger, tick), kept), command) in places {
            let pairs = tick.output.command.iter();
            let tensions = pairs.flat_map(|pair| [pair.flexor, pair.extensor]);
            for (place, tension) in command.iter_mut().zip(tensions) {
                *place = tension;
            }
            let Some(entry) = self.hand.fingers.get(finger) else {
                continue;
            };
            let mut kept = kept.iter_mut();
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
pub(crate) type Controllers = [FingerController<PlanarFinger, JOINTS>; SERVED];

/// What a finger that there is not does.
fn nothing() -> Tick<JOINTS> {
    Tick {
        output: ServoOutput {
            command: [Pair::both(0.0); JOINTS],
            tension: [Pair::both(0.0); JOINTS],
            torque: Vector4::zeros(),
            position: Vector4::zeros(),
            velocity: Vector4::zeros(),
            saturated: 0,
            lost: 0,
        },
        target: [None; JOINTS],
        fault: None,
    }
}
