use heapless::Vec;
use serde::{Deserialize, Serialize};

use super::{Finger, InputChannel, Limits, Name, OutputChannel};

/// The greatest number of processors that the configuration of a hand can have.
pub const PROCESSORS: usize = 16;

/// The whole configuration of a hand: its fingers, the processors that serve them, and every number
/// that a controller needs.
///
/// `FINGERS` is the greatest number of fingers, `JOINTS` the greatest number of joints of a finger, and
/// `ACTUATORS` of its actuators. A hand may have fewer.
///
/// Call [`check`](Self::check) after you have made or changed a hand in code. Hands that were read
/// from text or from an image are checked already.
///
/// ```
/// use condor_hand::config::Hand;
///
/// let text = std::fs::read_to_string("hands/utah-mit.toml")?;
/// let hand = Hand::<4, 4, 8>::from_toml(&text, "utah-mit.toml")?;
/// for finger in &hand.fingers {
///     println!("{}: {} joints", finger.name, finger.joints.len());
/// }
/// # Ok::<_, Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hand<const FINGERS: usize, const JOINTS: usize, const ACTUATORS: usize> {
    /// The name of the hand.
    pub name: Name,
    /// The rate of servo and table processors that have none of their own, Hz.
    pub servo_hz: u32,
    /// The rate of the trajectories, and of masters that have none of their own, Hz.
    pub trajectory_hz: u32,
    /// The time over which a step of efforts is spread when a mode or gains change, and over which the
    /// mean efforts of a joint are taken that a change of mode keeps, s.
    #[serde(default = "transition_s")]
    pub transition_s: f64,
    /// Gravity in the axes of the palm, m/s².
    pub gravity: [f64; 3],
    /// The conditions of faults, and the reaction to one.
    pub faults: FaultPolicy,
    /// The surface that fingertips are expected to touch; `None` if it is not known.
    pub contact: Option<ContactSurface>,
    /// The control processors.
    pub processors: Vec<ControlProcessor, PROCESSORS>,
    /// The table that moves the palm; `None` if there is none.
    pub table: Option<TableSettings>,
    /// The fingers, in the order of their indices, from 0.
    pub fingers: Vec<Finger<JOINTS, ACTUATORS>, FINGERS>,
}

/// A tenth of a second.
fn transition_s() -> f64 {
    0.1
}

/// A processor that runs one loop of the hand's control, with the run time of that loop.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControlProcessor {
    /// The number of the processor, by which joints and axes name it.
    pub number: u8,
    /// The kind of its work.
    pub kind: ProcessorKind,
    /// The rate of its loop, Hz, if that is not the hand's rate for its kind.
    pub rate_hz: Option<u32>,
    /// The run time of its loop without any joint, µs.
    pub loop_us: f64,
    /// The run time that each joint or axis adds, µs.
    #[serde(default)]
    pub joint_us: f64,
    /// The fraction of the processor's time that the loop may take, 0 to 1.
    pub budget: f64,
}

/// The work that the control loop of a processor does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ProcessorKind {
    /// Serves the joints of whole fingers.
    Servo,
    /// Serves the axes of the table.
    Table,
    /// Computes the trajectories of all joints.
    Master,
}

/// The configuration of the table: up to three sliding axes that carry the hand and move its palm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TableSettings {
    /// The axes, in the order of their indices, from 0.
    pub axes: Vec<Axis, 3>,
}

/// The configuration of one sliding axis of a table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Axis {
    /// The name of the axis.
    pub name: Name,
    /// The unit vector along which it moves the palm, in the palm's axes.
    pub direction: [f64; 3],
    /// The number of the processor that serves the axis.
    pub processor: u8,
    /// The sensor of its position, m.
    pub adc: InputChannel,
    /// The output of its drive, N.
    pub dac: OutputChannel,
    /// The limits of its position and its motion, m.
    pub limits: Limits,
    /// The position to which it goes when it is started, m.
    #[serde(default)]
    pub home: f64,
    /// The mass that it moves, kg.
    pub mass_kg: f64,
    /// Its viscous friction, N s/m.
    #[serde(default)]
    pub viscous: f64,
    /// The largest force of its drive, N.
    pub max_n: f64,
    /// The gains of its servo.
    pub servo: AxisServoSettings,
}

/// The gains and filters of the servo of a table axis.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AxisServoSettings {
    /// The gain of the position error, N/m.
    pub kp: f64,
    /// The gain of the velocity error, N s/m.
    pub kv: f64,
    /// The gain of the integral of the position error, N/(m s).
    #[serde(default)]
    pub ki: f64,
    /// The largest force of the integral, N.
    #[serde(default)]
    pub integral_max: f64,
    /// The cutoff of the filter that computes the velocity from the position, Hz.
    pub velocity_cutoff_hz: f64,
}

/// The surface of objects that the fingertips are expected to touch. A grasp uses it to compute how
/// hard to squeeze.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ContactSurface {
    /// The coefficient of Coulomb friction.
    pub friction: f64,
    /// The safety factor of the squeeze of a grasp: at least 1.
    pub safety: f64,
}

/// The conditions that count as faults of a finger, and the time in which its efforts go to rest
/// after a fault.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FaultPolicy {
    /// The time in which the efforts go to rest after a fault, s.
    pub safe_s: f64,
    /// The age from which a set-point is stale, s.
    pub stale_s: f64,
    /// The number of samples in a row with an effort that is a fault.
    pub effort_samples: u16,
    /// The number of samples in a row after which an effort's sensor counts as stuck, any sensor as
    /// out of its range, and a joint as past its limit.
    pub sensor_samples: u16,
    /// The number of invalid or implausible samples in a row after which a sensor counts as lost.
    /// Until then a joint continues at its rate.
    pub lost_samples: u16,
    /// The distance that the set-point of a joint may go while its sensor shows no motion at all,
    /// rad. A joint that something rigid holds fast looks the same; so press on things with
    /// torques.
    pub frozen_rad: f64,
    /// The position error that is a fault, rad.
    pub tracking_rad: f64,
    /// The number of samples in a row with such a position error that is a fault.
    pub tracking_samples: u16,
    /// The distance past a limit that is a fault, rad.
    pub overtravel_rad: f64,
    /// The number of missed deadlines in a row (ticks that came too late) that is a fault. A long
    /// time without any tick counts as several.
    pub missed_deadlines: u16,
}
