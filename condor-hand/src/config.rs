//! One file that says everything about a hand.

mod check;
mod finger;
mod hand;
mod image;
mod mistake;
mod rotation;
#[cfg(feature = "text")]
mod text;
mod views;
mod wiring;

pub use finger::{
    Body, Crossing, Finger, Form, Friction, Joint, JointServo, Motion, Mount, Placement,
    Rectification, ServoLaw, Shape, SoftStop, Tendon, TensionGains,
};
pub use hand::{
    Axis, AxisServo, Contact, FaultPolicy, Hand, Limits, PROCESSORS, Processor, ProcessorKind,
    Table,
};
pub use image::ImageError;
pub use mistake::{Field, Mistake, Owner, Place, WireEnd, WirePart};
pub use rotation::Rotation;
#[cfg(feature = "text")]
pub use text::{Problem, TextError};
pub use views::FingerLimits;
pub use wiring::{Channel, Converter, Input, Output, Wire};

/// What a hand, a finger, a joint or an axis is called: at most 15 bytes.
pub type Name = heapless::String<15, u8>;
