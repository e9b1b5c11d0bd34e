//! The configuration of a hand, in one file.
//!
//! The file assigns joints to processors, and A/D and D/A channels to joints and actuators, and has every number
//! that a controller uses. If a wire moves to another connector, edit the file; no program is
//! changed or compiled again. Section 4.2 of A. I. Memo 977 proposes such a central file.
//!
//! # For a controller
//!
//! The host turns the text into an image; a processor loads the image, or has it linked in. So a
//! processor parses no text and allocates nothing. Both readers check everything that [`Mistake`]
//! lists.
//!
//! ```
//! # #[cfg(feature = "text")] {
//! use condor_hand::config::Hand;
//!
//! type UtahMit = Hand<4, 4, 8>;
//!
//! // On the host:
//! let text = include_str!("../hands/utah-mit.toml");
//! let hand = UtahMit::from_toml(text, "utah-mit.toml").unwrap();
//! let mut image = [0; 16384];
//! let len = hand.to_image(&mut image).unwrap();
//!
//! // On a processor:
//! let hand = UtahMit::from_image(&image[..len]).unwrap();
//! for (index, finger) in hand.fingers_on(2) {
//!     let transmission = finger.transmission().unwrap();
//!     println!("finger {index}, {}: moment arms {:?} m", finger.name, transmission.arms());
//! }
//! # }
//! ```
//!
//! # For people: the file
//!
//! The file is TOML; the fields of [`Hand`] are its keys. Units are SI and radians; a key with
//! another unit ends in it. `hands/utah-mit.toml` in this package is a complete hand, whose
//! comments say which numbers are published and which are assumed.
//!
//! | table | content |
//! |---|---|
//! | the file itself | [`Hand`]: name, rates, gravity |
//! | `[faults]`, `[contact]` | [`FaultPolicy`], [`ContactSurface`] |
//! | `[[processors]]` | [`ControlProcessor`]: number, kind, rate, and how long its work takes |
//! | `[[table.axes]]` | [`Axis`] of the table that carries the hand, if there is one |
//! | `[[fingers]]` | [`Finger`]: name, base, form |
//! | `[[fingers.joints]]` | [`Joint`]: proximal first; its processor, sensor, servo and link |
//! | `[[fingers.followers]]` | [`Follower`]: a joint that follows another one |
//! | `[[fingers.actuators]]` | [`Actuator`]: the joints that it moves, limits, sensor, output, gains |
//! | `touch` of a finger | [`Touch`]: the tactile sensor of its tip, and the force of a contact; optional |
//! | `adc`, `encoder`, `dac` | [`InputChannel`] and [`OutputChannel`]: board, channel and calibration |
//!
//! A choice is a word or a table with one key, such as `shape = { cuboid = [0.04, 0.02, 0.02] }`: a [`Form`], a
//! [`Rotation`], a [`JointMotion`] and a [`Shape`].
//!
//! Joints and actuators need not repeat values. A value that a joint leaves out is taken from
//! `joint_defaults` of its finger, then from the joint at the same place of the finger that its
//! finger is `like`, and then from `joint_defaults` of the file; those of an actuator from
//! `actuator_defaults`. Tables are completed key by key; lists, `arms`, and tables that choose
//! another variant, are not completed. A finger that is `like` one above it takes everything
//! else from there, except its name and its channels, which no two fingers share.
//!
//! An error says where it is and what would be right:
//!
//! ```
//! # #[cfg(feature = "text")] {
//! # use condor_hand::config::Hand;
//! let text = "name = \"mine\"\nservo_rate_hz = 400\n";
//! let error = Hand::<4, 4, 8>::from_toml(text, "mine.toml").unwrap_err();
//! assert_eq!((error.line, error.column), (2, 1));
//! println!("{error}");
//! # }
//! ```

mod check;
mod fault_text;
mod finger;
mod hand;
mod image;
mod limits;
mod mistake;
#[cfg(feature = "text")]
mod motions;
#[cfg(feature = "text")]
mod text;
mod tunable;
mod units;
mod views;
mod wiring;

pub(crate) use tunable::{ActuatorNumbers, JointNumbers};

pub use crate::rotation::Rotation;
#[cfg(feature = "text")]
pub use condor_toml::TextError;
pub use fault_text::FaultText;
pub use finger::{
    Actuator, BASE, EffortFaults, EffortRange, Finger, Follower, Follows, Form, Joint,
    JointFriction, JointMotion, JointServo, LinkBody, Mount, Placement, ServoLaw, Shape,
    SoftStopSettings, Touch,
};
pub use hand::{
    Axis, AxisServoSettings, ContactSurface, ControlProcessor, FaultPolicy, Hand, PROCESSORS,
    ProcessorKind, TableSettings,
};
pub use limits::{Limits, MotionLimits};
pub use mistake::{Allowed, Mistake, MistakePath, MistakePlace, MistakeValue};
#[cfg(feature = "text")]
pub use text::line_of;
pub use tunable::{
    ActuatorNumber, AxisNumber, FaultNumber, JointNumber, MotionNumber, NumberName, NumberRange,
};
pub use views::FingerLink;
pub use wiring::{Channel, Converter, InputChannel, OutputChannel, Wire};

/// The name of a hand, a finger, a joint, an actuator or an axis: UTF-8 text of at most 64 bytes.
pub type Name = heapless::String<64, u8>;
