use core::fmt;

use serde::{Deserialize, Serialize};

use crate::math::{clamp, round};

/// A channel of an analogue-to-digital converter, with the calibration of its sensor:
/// `value = gain * counts + offset`, where counts go from 0 to 2^bits - 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InputChannel {
    /// The number of the board.
    pub board: u8,
    /// The number of the channel on the board.
    pub channel: u8,
    /// The width of the converter, in bits.
    pub bits: u8,
    /// The change of the value (rad, N, N m or m) for each count; negative if the sensor is mounted the
    /// other way round.
    pub gain: f64,
    /// The value at zero counts, rad, N, N m or m.
    pub offset: f64,
}

/// A channel of a digital-to-analogue converter, with the calibration of its actuator:
/// `counts = round(gain * value + offset)`, limited to 0 to 2^bits - 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OutputChannel {
    /// The number of the board.
    pub board: u8,
    /// The number of the channel on the board.
    pub channel: u8,
    /// The width of the converter, in bits.
    pub bits: u8,
    /// The change of the counts for each newton or newton metre; negative if the drive is connected the other way
    /// round.
    pub gain: f64,
    /// The counts for a value of zero.
    #[serde(default)]
    pub offset: f64,
}

/// The direction of a converter: A/D for sensors, D/A for actuators.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Converter {
    /// Analogue to digital: a sensor.
    Adc,
    /// Digital to analogue: a drive.
    Dac,
}

impl fmt::Display for Converter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Adc => "A/D",
            Self::Dac => "D/A",
        })
    }
}

/// A channel of a converter board, to which one sensor or actuator is wired.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Channel {
    /// The kind of the board: A/D or D/A.
    pub converter: Converter,
    /// The number of the board; the boards of each direction are numbered separately.
    pub board: u8,
    /// The number of the channel on the board.
    pub channel: u8,
}

/// The sensor or actuator at the other end of a wire from a converter, by the indices of its finger
/// and joint in the configuration, from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wire {
    /// The position of a joint.
    Position {
        /// The index of the finger in the hand.
        finger: usize,
        /// The index of the joint in its finger.
        joint: usize,
    },
    /// An actuator: the sensor of its effort if the channel is an [`Adc`](Converter::Adc), its command if it is a
    /// [`Dac`](Converter::Dac).
    Actuator {
        /// The index of the finger in the hand.
        finger: usize,
        /// The index of the actuator in its finger.
        actuator: usize,
    },
    /// The position of an actuator.
    Encoder {
        /// The index of the finger in the hand.
        finger: usize,
        /// The index of the actuator in its finger.
        actuator: usize,
    },
    /// The tactile sensor of a fingertip.
    Touch {
        /// The index of the finger in the hand.
        finger: usize,
    },
    /// An axis of the table: its position, or its drive.
    Axis {
        /// The index of the axis in the table.
        axis: usize,
    },
}

impl InputChannel {
    /// Returns board and channel number of this input, without its calibration.
    #[must_use]
    pub const fn channel(&self) -> Channel {
        Channel {
            converter: Converter::Adc,
            board: self.board,
            channel: self.channel,
        }
    }

    /// Returns the measured value (rad, N, N m or m) that a reading of `counts` means.
    #[inline]
    #[must_use]
    pub fn value(&self, counts: u32) -> f64 {
        self.gain * f64::from(counts) + self.offset
    }

    /// Returns the reading that the converter shows for a true `value` (rad, N, N m or m): the nearest
    /// number of counts in its range, and 0 for a NaN.
    #[must_use]
    pub fn counts(&self, value: f64) -> u32 {
        whole(self.exact_counts(value), self.full_scale())
    }

    /// The counts of a value, not rounded, and also beyond what the converter has.
    pub(super) fn exact_counts(&self, value: f64) -> f64 {
        (value - self.offset) / self.gain
    }

    /// Returns the largest reading of the converter, in counts: 2^bits - 1.
    #[must_use]
    pub const fn full_scale(&self) -> u32 {
        full_scale(self.bits)
    }
}

impl OutputChannel {
    /// Returns board and channel number of this output, without its calibration.
    #[must_use]
    pub const fn channel(&self) -> Channel {
        Channel {
            converter: Converter::Dac,
            board: self.board,
            channel: self.channel,
        }
    }

    /// Returns the counts to write for a command of `value` (N, or N m), limited to the range of the
    /// converter. A NaN counts as a command of 0, and not as 0 counts, which can mean the full
    /// force of a drive.
    #[inline]
    #[must_use]
    pub fn counts(&self, value: f64) -> u32 {
        let value = if value.is_nan() { 0.0 } else { value };
        whole(self.gain * value + self.offset, self.full_scale())
    }

    /// Returns the command (N, or N m) that `counts` mean. A simulated drive uses it to read back what a
    /// controller wrote.
    #[must_use]
    pub fn value(&self, counts: u32) -> f64 {
        (f64::from(counts) - self.offset) / self.gain
    }

    /// Returns the largest number of counts that can be written: 2^bits - 1.
    #[must_use]
    pub const fn full_scale(&self) -> u32 {
        full_scale(self.bits)
    }
}

/// The nearest of the counts from 0 to `full_scale`; 0 for a NaN.
fn whole(counts: f64, full_scale: u32) -> u32 {
    #[allow(clippy::cast_sign_loss, reason = "clamped to what is not negative")]
    let counts = clamp(round(counts), 0.0, f64::from(full_scale)) as u32;
    counts
}

/// The largest number of so many bits, at most 32.
const fn full_scale(bits: u8) -> u32 {
    match 1_u32.checked_shl(bits as u32) {
        Some(steps) => steps - 1,
        None => u32::MAX,
    }
}
