use heapless::Vec;
use serde::{Deserialize, Serialize};

use super::{Finger, Input, Name, Output};
use crate::trajectory;

/// How many processors a hand can name.
pub const PROCESSORS: usize = 16;

/// A hand: its fingers, the processors that serve them, and every number that a controller needs.
///
/// `FINGERS` and `JOINTS` are capacities: of fingers, and of the joints of one finger. A hand with
/// less fits too.
///
/// A value that was made in code, or changed, is worth what [`check`](Self::check) says of it; the
/// readers of text and of images have asked already.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hand<const FINGERS: usize, const JOINTS: usize> {
    /// What the hand is called.
    pub name: Name,
    /// The rate of a servo or table processor that names no other, Hz.
    pub servo_hz: u32,
    /// The rate of the trajectories, and of a master that names no other, Hz.
    pub trajectory_hz: u32,
    /// How long a step of tensions takes that a change of mode or gains would make at once, s.
    #[serde(default = "transition_s")]
    pub transition_s: f64,
    /// Gravity in the axes of the palm, m/s².
    pub gravity: [f64; 3],
    /// When a controller gives up, and how.
    pub faults: FaultPolicy,
    /// What fingertips are expected to touch.
    pub contact: Option<Contact>,
    /// The processors.
    pub processors: Vec<ControlProcessor, PROCESSORS>,
    /// The table that carries the hand, or the palm.
    pub table: Option<Table>,
    /// The fingers.
    pub fingers: Vec<Finger<JOINTS>, FINGERS>,
}

/// A tenth of a second.
fn transition_s() -> f64 {
    0.1
}

/// A control processor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControlProcessor {
    /// The number by which joints and axes name it.
    pub number: u8,
    /// What it does.
    pub kind: ProcessorKind,
    /// How often its loop runs, Hz, where that is not the hand's rate for its kind.
    pub rate_hz: Option<u32>,
    /// How long one run of its loop takes without any joint, µs.
    pub loop_us: f64,
    /// How long each joint or axis adds to that, µs.
    #[serde(default)]
    pub joint_us: f64,
    /// The part of the processor's time that the loop may take, 0 to 1.
    pub budget: f64,
}

/// What a processor does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ProcessorKind {
    /// Serves the joints of whole fingers.
    Servo,
    /// Serves the axes of the table.
    Table,
    /// Makes the trajectories.
    Master,
}

/// Axes that carry the hand.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Table {
    /// The axes.
    pub axes: Vec<Axis, 3>,
}

/// One prismatic axis of a table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Axis {
    /// What the axis is called.
    pub name: Name,
    /// The unit vector along which it moves the palm, in the palm's axes.
    pub direction: [f64; 3],
    /// The processor that serves it.
    pub processor: u8,
    /// The sensor of its position, m.
    pub adc: Input,
    /// The output of its drive, N.
    pub dac: Output,
    /// Where it may go, m.
    pub limits: Limits,
    /// Where it goes to when it is started, m.
    #[serde(default)]
    pub home: f64,
    /// What it moves, kg.
    pub mass_kg: f64,
    /// Its viscous friction, N s/m.
    #[serde(default)]
    pub viscous: f64,
    /// The largest force of its drive, N.
    pub max_n: f64,
    /// The gains of its servo.
    pub servo: AxisServo,
}

/// How an axis of the table is held to its set-point.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AxisServo {
    /// Of the position error, N/m.
    pub kp: f64,
    /// Of the velocity error, N s/m.
    pub kv: f64,
    /// Of the integral of the position error, N/(m s).
    #[serde(default)]
    pub ki: f64,
    /// The largest force of the integral, N.
    #[serde(default)]
    pub integral_max: f64,
    /// The cutoff of the filter that makes velocity of position, Hz.
    pub velocity_cutoff_hz: f64,
}

/// Where a joint or an axis may go, and how fast: rad, or m for what slides.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Limits {
    /// The lowest position.
    pub low: f64,
    /// The highest position.
    pub high: f64,
    /// The largest velocity, rad/s or m/s.
    pub velocity: f64,
    /// The largest acceleration, rad/s² or m/s².
    pub acceleration: f64,
}

impl Limits {
    /// The limits of a trajectory with this jerk to both sides, rad/s³ or m/s³.
    #[must_use]
    pub const fn with_jerk(&self, jerk: f64) -> trajectory::Limits<f64> {
        trajectory::Limits {
            low: self.low,
            high: self.high,
            velocity: self.velocity,
            acceleration: self.acceleration,
            jerk,
        }
    }
}

/// What fingertips are expected to touch.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Contact {
    /// The coefficient of Coulomb friction.
    pub friction: f64,
    /// The twist that a soft tip can pass on, as a part of the normal force, m.
    #[serde(default)]
    pub torsion_m: f64,
    /// By how much a grasp squeezes more than it must: at least 1.
    pub safety: f64,
}

/// When a controller gives up, and how.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FaultPolicy {
    /// How long tensions take to the least ones after a fault, s.
    pub safe_s: f64,
    /// The age from which a set-point is stale, s.
    pub stale_s: f64,
    /// How many samples in a row make a tendon slack or broken.
    pub tension_samples: u16,
    /// How many samples in a row make a tension's sensor stuck, any sensor out of its range, and a joint
    /// past its limit.
    pub sensor_samples: u16,
    /// After how many samples in a row that say nothing, or what cannot be, a sensor is lost. Until then
    /// a joint goes on as it went.
    pub lost_samples: u16,
    /// How far the set-point of a joint may go while its sensor shows no motion at all, rad. A joint that
    /// something rigid holds fast looks the same: whoever presses on things does so with torques.
    pub frozen_rad: f64,
    /// The position error that is a fault, rad.
    pub tracking_rad: f64,
    /// For how many samples in a row.
    pub tracking_samples: u16,
    /// How far past a limit a joint may be, rad.
    pub overtravel_rad: f64,
    /// The deadlines in a row that must not be missed; a long time without any tick misses several.
    pub missed_deadlines: u16,
}
