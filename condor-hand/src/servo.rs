//! The servos of a finger: from set-points of its joints to commands of its actuators.
//!
//! One [`FingerServo`] runs the two lower levels of the controller in every tick of the servo loop:
//! joint servos compute torques, the [transmission](crate::transmission) turns them into efforts, and a servo for each
//! actuator commands it (memo, section 4.1). Every joint has a [`ServoMode`] of its own; in the memo the actuators pull
//! tendons, and their efforts are tensions.
//!
//! An actuator belongs to the [last joint](crate::transmission::Linear::joint_of) that it moves: the efforts that a
//! user sets in [`ServoMode::Effort`] are those of the actuators that belong to the joint. A joint that is off asks for
//! no torque, and its actuators prefer to be at rest; if all joints of a finger are off, all actuators are at rest.
//!
//! # Changes of mode
//!
//! When a joint changes its mode, it keeps what it has: a position servo holds the present position, an
//! effort servo the efforts, a torque servo their torque, and an impedance servo both the position and,
//! unless the joint was off, the torque. A remaining step in the desired efforts is spread linearly over
//! [`transition_s`](FingerSettings::transition_s); efforts never jump. In that time, too, a joint in
//! [`ServoMode::Impedance`] goes from one impedance to the next.
//!
//! What a joint keeps are the efforts that it was given, or the mean of those for which its law asked.
//! The mean is over the last ticks: as many as `transition_s` has, or at least half as many; over fewer if
//! the mode or the target has changed since then. A law answers each count of a position sensor with a
//! torque that a later tick takes back. The efforts of one tick would move a joint whose new mode does
//! not take them back. The difference between the last tick and the mean is worked off within four ticks.
//!
//! # Impedance
//!
//! In [`ServoMode::Impedance`] a joint has the torque
//!
//! ```text
//! stiffness (position - q) - damping q̇ + gravity
//! ```
//!
//! within the limits of its actuators, plus that of its soft stop (N. Hogan, Impedance Control: An
//! Approach to Manipulation, Parts I-III, ASME J. Dynamic Systems, Measurement, and Control 107, 1985;
//! here joint by joint, without shaping the inertia). It feeds no friction forward, since it asks for no
//! rate, and it has no integral: a load moves the joint by load / stiffness, and friction adds to the
//! damping. In [`ServoMode::Torque`] nothing is added but the soft stop, so a torque that holds a weight
//! must hold the links, too.
//!
//! The stiffness and damping may be at most those by which the joint's [`PositionLaw`] holds a
//! position: `kp` and `kv`, or `J w²` and `2 zeta w J`. J is the least inertia of the joint with all
//! others free, in three postures: all joints at their lower limits, halfway, at their upper limits.
//! The servo checks a target against the gains of that moment; other gains do not change it later.

mod effort;
mod finger;
mod impedance;
mod joint;
mod law;
mod mode;
mod readings;
mod refusal;
mod settings;
mod transition;

pub use effort::{EffortGains, EffortServos};
pub use finger::{FingerReadings, FingerServo, ServoOutput};
pub use law::{PositionLaw, SoftStop};
pub use mode::{JointTarget, ServoMode};
pub use refusal::{ServoRefusal, TargetQuantity};
pub(crate) use settings::JointCutoffs;
pub use settings::{ActuatorSettings, FingerSettings, JointGains, JointSettings};
