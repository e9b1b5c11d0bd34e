use heapless::{LinearMap, Vec};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::{InputChannel, Limits, Name, OutputChannel, Rotation};
use crate::Pose;
use crate::servo::EffortGains;
use crate::transmission::EffortLimits;

/// The configuration of one finger: a serial mechanism of joints, and the actuators that move them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Finger<const JOINTS: usize, const ACTUATORS: usize> {
    /// The name of the finger.
    pub name: Name,
    /// The base of the finger in the palm.
    pub base: Placement,
    /// The form of the finger's mechanism.
    pub form: Form,
    /// The tactile sensor of its fingertip; `None` if there is none.
    pub touch: Option<Touch>,
    /// The joints that move by themselves, proximal first.
    pub joints: Vec<Joint, JOINTS>,
    /// The joints that follow others, in any order. With `joints` they are at most `JOINTS`.
    #[serde(default = "Vec::new")]
    pub followers: Vec<Follower, JOINTS>,
    /// The actuators, in any order.
    pub actuators: Vec<Actuator<JOINTS>, ACTUATORS>,
}

/// The position and the axes of a frame relative to a parent frame, as the configuration file has
/// them. The base of a finger, for example, is placed in the frame of the palm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Placement {
    /// The origin of the frame, m.
    #[serde(default)]
    pub position: [f64; 3],
    /// The axes of the frame.
    #[serde(default)]
    pub rotation: Rotation,
}

/// The geometry of a finger: the standard planar finger, or any chain of joints, which may branch.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub enum Form {
    /// Four joints that the closed form solves: the first about the z axis of the base, the others
    /// about parallel y axes, with the links along x.
    Planar {
        /// The distances from each axis to the next, and from the last to the tip, m.
        lengths: [f64; 4],
    },
    /// Any joints, each with a mount of its own.
    Chain {
        /// The tip, in the frame of the joint that moves it, m.
        tip: [f64; 3],
        /// The joint that moves the tip, by its name; `None` for the last one of a finger without followers.
        on: Option<Name>,
    },
}

/// The configuration of the tactile sensor of a fingertip.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Touch {
    /// The sensor of the force along the normal of the surface that the tip touches, N.
    pub adc: InputChannel,
    /// The force above which the finger counts as in contact, N.
    pub contact_n: f64,
}

/// The configuration of one joint: its link, its servo and its position sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Joint {
    /// The name of the joint.
    pub name: Name,
    /// The number of the processor that serves the joint.
    pub processor: u8,
    /// Its place on the link that carries it, and its motion; `None` in a planar finger, whose form says
    /// both.
    pub mount: Option<Mount>,
    /// The body of its link; `None` if dynamics are not needed.
    pub body: Option<LinkBody>,
    /// The limits of its position and its motion.
    pub limits: Limits,
    /// The servo that holds it at its set-point.
    pub servo: JointServo,
    /// The soft stop that keeps it from its limits.
    #[serde(default)]
    pub stop: SoftStopSettings,
    /// The friction and the inertia of its drive.
    #[serde(default)]
    pub friction: JointFriction,
    /// The sensor of its position; `None` if sensors at its actuators tell it.
    pub adc: Option<InputChannel>,
}

/// The configuration of a joint that follows another one, as a tendon or a linkage couples them. No servo, no sensor
/// and no number in a motion belongs to it: it goes where the other joint takes it. Its friction counts as the other's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Follower {
    /// The name of the joint; no other joint of the finger has it.
    pub name: Name,
    /// The joint that it follows.
    pub follows: Follows,
    /// Its place on the link that carries it, and its motion.
    pub mount: Mount,
    /// The body of its link; `None` if dynamics are not needed.
    pub body: Option<LinkBody>,
}

/// The movement of a joint with another one: its position is `ratio` times that of the other joint, plus `offset`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Follows {
    /// The name of a joint that moves by itself.
    pub joint: Name,
    /// The change of the position for a unit of the other joint's, rad or m for rad or m.
    pub ratio: f64,
    /// The position where the other joint is at zero, rad or m.
    #[serde(default)]
    pub offset: f64,
}

/// The place of a joint on the link that carries it, and the way in which the joint moves. Only fingers
/// of the form [`Form::Chain`] have mounts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mount {
    /// The joint whose link carries it, by its name, or [`BASE`] for the base of the finger. `None` means the joint
    /// before it in the list, or the base for the first one; for a follower, the joint that it follows.
    pub on: Option<Name>,
    /// The position of the joint's frame at its zero, m.
    #[serde(default)]
    pub position: [f64; 3],
    /// The axes of the joint's frame at its zero.
    #[serde(default)]
    pub rotation: Rotation,
    /// The motion of the joint.
    pub motion: JointMotion,
}

/// The name of the base of a finger, where a joint can be mounted.
pub const BASE: &str = "base";

/// The motion of a joint: a rotation or a slide. The axis is a unit vector in the joint's own
/// frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum JointMotion {
    /// The joint rotates about this axis; its position is in rad.
    Revolute([f64; 3]),
    /// The joint slides along this axis; its position is in m.
    Prismatic([f64; 3]),
}

/// The mass and the inertia of a link, in the frame of the joint that moves the link.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinkBody {
    /// The mass of the link, kg.
    pub mass_kg: f64,
    /// The centre of mass, m.
    pub center: [f64; 3],
    /// The distribution of the mass.
    pub shape: Shape,
}

/// The distribution of a link's mass about the centre of mass, along the axes of the link's frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub enum Shape {
    /// The mass is uniform in a cuboid with these edges along x, y and z, m.
    Cuboid([f64; 3]),
    /// The mass is distributed in any way, with this inertia about the centre of mass.
    Inertia {
        /// Ixx, Iyy and Izz, kg m².
        moments: [f64; 3],
        /// Ixy, Ixz and Iyz: entries of the matrix, with their signs, kg m².
        #[serde(default)]
        products: [f64; 3],
    },
}

/// The gains and filters of the servo that holds a joint at its set-point.
///
/// Units are those of a rotating joint; for a sliding joint read N for N m and m for rad. The main
/// gain of the law (`kp` of the law `pd`, `bandwidth_hz` of the law `decoupled`) must be above
/// zero. Values that the law does not use may be left out.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointServo {
    /// The law that uses the gains.
    pub law: ServoLaw,
    /// The gain of the position error in the law `pd`, N m/rad.
    #[serde(default)]
    pub kp: f64,
    /// The gain of the velocity error in the law `pd`, N m s/rad.
    #[serde(default)]
    pub kv: f64,
    /// The gain of the integral of the position error, N m/(rad s).
    #[serde(default)]
    pub ki: f64,
    /// The largest torque of the integral, N m.
    #[serde(default)]
    pub integral_max: f64,
    /// The natural frequency of the law `decoupled`, Hz.
    #[serde(default)]
    pub bandwidth_hz: f64,
    /// The damping ratio of the law `decoupled`.
    #[serde(default)]
    pub zeta: f64,
    /// The gain of the torque error, N m/N m. The torque is computed from the measured efforts.
    #[serde(default)]
    pub k_tau: f64,
    /// The cutoff of the filter of the measured position, Hz; `None` means no filter.
    pub position_cutoff_hz: Option<f64>,
    /// The cutoff of the filter that differentiates the position, Hz.
    pub velocity_cutoff_hz: f64,
}

/// The control law of a joint in position mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ServoLaw {
    /// Proportional and derivative gains, with the weight of the links compensated.
    Pd,
    /// Computed torque: the inverse dynamics of the whole finger make every joint behave as if it
    /// were alone.
    Decoupled,
}

/// A virtual spring and damper before each limit of a joint, so that the joint does not reach its
/// mechanical stop.
///
/// The zone before a limit has the width `zone`. In it the servo pushes the joint back inwards. The
/// stiffness of the spring follows from `bandwidth_hz` and the joint's present inertia: a free
/// joint would swing on the spring at that frequency. Joints rest only between the zones, in
/// [`Joint::rest_range`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SoftStopSettings {
    /// The width of a zone before a limit, rad.
    pub zone: f64,
    /// The natural frequency of the joint on the spring, Hz. The rate of the servo, its filters and
    /// its actuators limit it.
    pub bandwidth_hz: f64,
    /// The damping ratio; 1 does not overshoot.
    pub damping_ratio: f64,
}

/// The friction of a joint, and the inertia of its drive; the inertia of the links is in
/// [`LinkBody`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointFriction {
    /// The inertia of the drive at the joint, kg m².
    #[serde(default)]
    pub armature: f64,
    /// The viscous friction, N m s/rad.
    #[serde(default)]
    pub viscous: f64,
    /// The Coulomb friction, N m.
    #[serde(default)]
    pub coulomb: f64,
    /// The rate below which Coulomb friction fades, rad/s.
    #[serde(default)]
    pub coulomb_rate: f64,
    /// The friction of a tendon on its pulley, for each newton of tension and metre of arm.
    #[serde(default)]
    pub tendon: f64,
}

/// The configuration of one actuator: the joints that it moves, its limits, its converters and its servo.
///
/// Its effort is a force, N, or a torque, N m: a tension for one that pulls a tendon.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Actuator<const JOINTS: usize> {
    /// The name of the actuator, such as that of its tendon.
    pub name: Name,
    /// Its arms at the joints that it moves, and at followers: the torque of the joint, N m, or N for a sliding joint,
    /// for a unit of its effort. A tendon has a moment arm, m, positive where it pulls to positive angles; a motor has its gear ratio.
    pub arms: LinearMap<Name, f64, JOINTS>,
    /// The limits of its effort.
    pub limits: EffortRange,
    /// The efforts that are faults.
    #[serde(default)]
    pub faults: EffortFaults,
    /// Its small-signal pole, Hz.
    pub pole_hz: f64,
    /// The sensor of its effort; `None` if its effort is not measured.
    pub adc: Option<InputChannel>,
    /// The sensor of its position, rad or m: the sum of its arms times the positions of the joints, so 0 where all
    /// joints are at 0. `None` if that is not measured.
    pub encoder: Option<InputChannel>,
    /// The output of its command.
    pub dac: OutputChannel,
    /// The cutoff of the filter of the measured effort, Hz; `None` means no filter.
    pub cutoff_hz: Option<f64>,
    /// The gains of its servo.
    #[serde(default)]
    pub gains: EffortGains,
}

/// The limits of the effort of an actuator, N or N m.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EffortRange {
    /// The least effort. A tendon always has a tension of 0 or more.
    pub low: f64,
    /// The greatest effort.
    pub high: f64,
    /// The preferred effort; `None` means the one nearest to zero. Of all efforts that give the torques the nearest to
    /// the preferred ones are used.
    pub bias: Option<f64>,
}

/// The efforts of an actuator that are faults, N or N m.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EffortFaults {
    /// A lesser effort is a fault: a tendon is slack or broken. `None` means none is.
    pub below: Option<f64>,
    /// A greater effort is a fault: a tendon may break. `None` means none is.
    pub above: Option<f64>,
}

impl Placement {
    /// Returns the same placement as a [`Pose`]: rotation matrix and origin (m) in the parent
    /// frame.
    #[must_use]
    pub fn pose(&self) -> Pose {
        Pose {
            rotation: self.rotation.matrix(),
            position: Vector3::from(self.position),
        }
    }
}

impl<const JOINTS: usize> Actuator<JOINTS> {
    /// Returns the limits of its effort, N or N m.
    #[must_use]
    pub fn limits(&self) -> EffortLimits {
        let EffortRange { low, high, bias } = self.limits;
        let limits = EffortLimits {
            low,
            high,
            bias: 0.0,
        };
        EffortLimits {
            bias: bias.unwrap_or(limits.at_rest()),
            ..limits
        }
    }

    /// Returns its arm at a joint or a follower of this name: m, or a gear ratio; 0 where it has none.
    #[must_use]
    pub fn arm(&self, joint: &Name) -> f64 {
        self.arms.get(joint).copied().unwrap_or(0.0)
    }
}
