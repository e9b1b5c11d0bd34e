use nalgebra::SVector;

use crate::config::{Channel, Finger};
use crate::servo::Sensed;
use crate::tendon::{Pair, Pairs};

/// What the converters of a finger's sensors read, in radians and newtons; `read` gives the counts of
/// a channel, or none if it cannot be read, which becomes NaN: a fault once it lasts.
pub fn read_finger<const N: usize>(
    finger: &Finger<N>,
    mut read: impl FnMut(Channel) -> Option<u32>,
) -> Sensed<f64, N> {
    let mut sensed = Sensed {
        position: SVector::zeros(),
        tension: [Pair::both(0.0); N],
    };
    for ((joint, position), tension) in finger
        .joints
        .iter()
        .zip(sensed.position.iter_mut())
        .zip(&mut sensed.tension)
    {
        let mut value = |input: &crate::config::Input| {
            read(input.channel()).map_or(f64::NAN, |counts| input.value(counts))
        };
        *position = value(&joint.adc);
        tension.flexor = value(&joint.flexor.adc);
        tension.extensor = value(&joint.extensor.adc);
    }
    sensed
}

/// Gives the converters of a finger's actuators the counts of its commands (N).
pub fn write_finger<const N: usize>(
    finger: &Finger<N>,
    command: &Pairs<f64, N>,
    mut write: impl FnMut(Channel, u32),
) {
    for (joint, command) in finger.joints.iter().zip(command) {
        let (flexor, extensor) = (&joint.flexor.dac, &joint.extensor.dac);
        write(flexor.channel(), flexor.counts(command.flexor));
        write(extensor.channel(), extensor.counts(command.extensor));
    }
}
