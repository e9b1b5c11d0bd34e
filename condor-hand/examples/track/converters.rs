//! Between controllers and a plant: the counts of the converters that the configuration names.

use std::collections::BTreeMap;

use condor_hand::config::{Channel, Input, Output};
use condor_hand::controller::{read_finger, write_finger};
use condor_hand::servo::Sensed;
use condor_hand::tendon::{Pair, Pairs};

use super::rig::{Configuration, FINGERS, HandState, JOINTS, OfJoints, Plant, Result};

/// A plant with wires: what controllers know of it are counts of 12 bits, or as many as are
/// configured.
pub(crate) struct Converters<P> {
    configuration: Configuration,
    plant: P,
    /// What the sensors would say without converters.
    truth: HandState,
}

/// What is on the boards of one direction.
type Boards = BTreeMap<(u8, u8), u32>;

fn place(channel: Channel) -> (u8, u8) {
    (channel.board, channel.channel)
}

impl<P: Plant> Converters<P> {
    pub(crate) fn new(configuration: &Configuration, plant: P) -> Self {
        Self {
            configuration: configuration.clone(),
            plant,
            truth: [Sensed {
                position: nalgebra::SVector::zeros(),
                tension: [Pair::both(0.0); JOINTS],
            }; FINGERS],
        }
    }

    pub(crate) fn truth(&self) -> &HandState {
        &self.truth
    }

    /// What controllers read of the plant.
    fn read(&self) -> HandState {
        let mut boards = Boards::new();
        let mut convert = |input: &Input, value| {
            boards.insert(place(input.channel()), input.counts(value));
        };
        for (finger, truth) in self.configuration.fingers.iter().zip(&self.truth) {
            let positions = finger.joints.iter().zip(truth.position.iter());
            for ((joint, &position), tension) in positions.zip(&truth.tension) {
                convert(&joint.adc, position);
                convert(&joint.flexor.adc, tension.flexor);
                convert(&joint.extensor.adc, tension.extensor);
            }
        }
        std::array::from_fn(|finger| {
            let finger = &self.configuration.fingers[finger];
            read_finger(finger, |channel| boards.get(&place(channel)).copied())
        })
    }
}

impl<P: Plant> Plant for Converters<P> {
    fn reset(&mut self, positions: &OfJoints<f64>) -> Result<HandState> {
        self.truth = self.plant.reset(positions)?;
        Ok(self.read())
    }

    fn step(&mut self, commands: &[Pairs<f64, JOINTS>; FINGERS]) -> Result<HandState> {
        let mut boards = Boards::new();
        for (finger, command) in self.configuration.fingers.iter().zip(commands) {
            write_finger(finger, command, |channel, counts| {
                boards.insert(place(channel), counts);
            });
        }
        let newtons = |output: &Output| {
            let counts = boards.get(&place(output.channel())).copied();
            value_of(output, counts.unwrap_or(0))
        };
        let held = std::array::from_fn(|finger| {
            std::array::from_fn(|joint| {
                let joint = &self.configuration.fingers[finger].joints[joint];
                Pair {
                    flexor: newtons(&joint.flexor.dac),
                    extensor: newtons(&joint.extensor.dac),
                }
            })
        });
        self.truth = self.plant.step(&held)?;
        Ok(self.read())
    }
}

/// What an actuator makes of counts, N.
fn value_of(output: &Output, counts: u32) -> f64 {
    (f64::from(counts) - output.offset) / output.gain
}
