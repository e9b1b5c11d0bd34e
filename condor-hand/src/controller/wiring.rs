use nalgebra::SVector;

use super::AXES;
use crate::config::{Channel, Finger, InputChannel, TableSettings};
use crate::servo::FingerReadings;

/// Reads all sensors of a finger through their converters. Returns positions in radians,
/// efforts in newtons or newton metres, and the force at the fingertip in newtons.
///
/// `read` must return the counts of a channel, or `None` if the channel cannot be read. The value
/// is then NaN. A position or an effort that stays NaN becomes a fault of the finger.
pub fn read_finger<const N: usize, const A: usize>(
    finger: &Finger<N, A>,
    mut read: impl FnMut(Channel) -> Option<u32>,
) -> FingerReadings<N, A> {
    let mut sensed = FingerReadings::<N, A> {
        position: SVector::zeros(),
        effort: [0.0; A],
        touch: 0.0,
    };
    for (joint, position) in finger.joints.iter().zip(sensed.position.iter_mut()) {
        *position = value(&joint.adc, &mut read);
    }
    for (actuator, effort) in finger.actuators.iter().zip(&mut sensed.effort) {
        if let Some(adc) = &actuator.adc {
            *effort = value(adc, &mut read);
        }
    }
    if let Some(touch) = &finger.touch {
        sensed.touch = value(&touch.adc, &mut read);
    }
    sensed
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
