use nalgebra::SVector;

use super::AXES;
use crate::NumberError;
use crate::config::{Channel, Finger, InputChannel, TableSettings};
use crate::servo::FingerReadings;
use crate::transmission::PositionSensing;

/// The sensors of a finger, with the converters through which they are read.
#[derive(Clone, Copy, Debug)]
pub struct FingerSensors<const N: usize, const A: usize> {
    joints: [Option<InputChannel>; N],
    efforts: [Option<InputChannel>; A],
    encoders: [Option<InputChannel>; A],
    touch: Option<InputChannel>,
    /// `None` if each joint has a sensor of its own.
    sensing: Option<PositionSensing<N, A>>,
}

impl<const N: usize, const A: usize> FingerSensors<N, A> {
    /// Takes the sensors from the description of a finger.
    ///
    /// # Errors
    /// [`NumberError`] for arms or sensors that [`Hand::check`](crate::config::Hand::check) would have refused.
    pub fn new(finger: &Finger<N, A>) -> Result<Self, NumberError> {
        let joint = |place: usize| finger.joints.get(place)?.adc;
        let are_all_sensed = finger.joints.iter().all(|joint| joint.adc.is_some());
        Ok(Self {
            joints: core::array::from_fn(joint),
            efforts: core::array::from_fn(|place| finger.actuators.get(place)?.adc),
            encoders: core::array::from_fn(|place| finger.actuators.get(place)?.encoder),
            touch: finger.touch.map(|touch| touch.adc),
            sensing: if are_all_sensed {
                None
            } else {
                Some(finger.position_sensing()?)
            },
        })
    }

    /// Reads all sensors. Returns positions of joints in rad, or m for a sliding joint, those of actuators if joints are
    /// computed from them, efforts in N or N m, and the
    /// force at the fingertip in N.
    ///
    /// `read` must return the counts of a channel, or `None` if the channel cannot be read. What depends on it is NaN
    /// then. A position or an effort that stays NaN becomes a fault of the finger.
    pub fn read(&self, mut read: impl FnMut(Channel) -> Option<u32>) -> FingerReadings<N, A> {
        let mut value = |input: &Option<InputChannel>| {
            let input = input.as_ref();
            input.map_or(0.0, |input| value(input, &mut read))
        };
        let mut sensed = FingerReadings::<N, A> {
            position: SVector::zeros(),
            actuator_position: [0.0; A],
            effort: [0.0; A],
            touch: 0.0,
        };
        for (input, position) in self.joints.iter().zip(sensed.position.iter_mut()) {
            *position = value(input);
        }
        for (input, effort) in self.efforts.iter().zip(&mut sensed.effort) {
            *effort = value(input);
        }
        sensed.touch = value(&self.touch);
        if let Some(sensing) = &self.sensing {
            let actuators = &mut sensed.actuator_position;
            for (input, position) in self.encoders.iter().zip(actuators.iter_mut()) {
                *position = value(input);
            }
            sensed.position = sensing.positions(&sensed.position, actuators);
        }
        sensed
    }
}

/// Converts `command` (N, or N m), the commands for the actuators of a finger, into counts, and calls
/// `write` with the channel and the counts of each actuator.
pub fn write_finger<const N: usize, const A: usize>(
    finger: &Finger<N, A>,
    command: &[f64; A],
    mut write: impl FnMut(Channel, u32),
) {
    for (actuator, &command) in finger.actuators.iter().zip(command) {
        write(actuator.dac.channel(), actuator.dac.counts(command));
    }
}

/// Reads the position sensors of a table through their converters, and returns the positions of its
/// axes in m; elements without an axis are zero.
///
/// `read` must return the counts of a channel, or `None` if the channel cannot be read; the
/// position is NaN then.
pub fn read_table(
    table: &TableSettings,
    mut read: impl FnMut(Channel) -> Option<u32>,
) -> [f64; AXES] {
    let mut positions = [0.0; AXES];
    for (axis, position) in table.axes.iter().zip(&mut positions) {
        *position = value(&axis.adc, &mut read);
    }
    positions
}

/// Converts `force` (N), the forces for the drives of a table, into counts, and calls `write` with
/// the channel and the counts of each drive.
pub fn write_table(
    table: &TableSettings,
    force: &[f64; AXES],
    mut write: impl FnMut(Channel, u32),
) {
    for (axis, &force) in table.axes.iter().zip(force) {
        write(axis.dac.channel(), axis.dac.counts(force));
    }
}

fn value(input: &InputChannel, read: &mut impl FnMut(Channel) -> Option<u32>) -> f64 {
    read(input.channel()).map_or(f64::NAN, |counts| input.value(counts))
}
