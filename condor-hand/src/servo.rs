//! The servos of a finger: from set points of its joints to commands of its actuators.
//!
//! One [`FingerServo`] runs the two lower levels of the controller in every tick of the servo loop:
//! joint servos compute torques, the tendons' level turns them into tensions, and a servo for each
//! tendon commands its actuator (memo, section 4.1). Every joint has a [`Mode`] of its own.
//!
//! # Changes of mode
//!
//! When a joint changes its mode, it keeps its present state: a position servo holds the present
//! position, a torque servo the present torque, a tension servo the present tensions. A remaining
//! step in the desired tensions is spread linearly over
//! [`transition_s`](FingerSettings::transition_s); tensions never jump.

mod finger;
mod joint;
mod law;
mod mode;
mod readings;
mod settings;

pub use finger::{FingerServo, Sensed, ServoOutput};
pub use law::{PositionLaw, SoftStop};
pub use mode::{JointTarget, Mode};
pub use settings::{FingerSettings, JointGains, JointSettings, SettingError, TargetError};
