//! The requests to the robot, and its responses.

use core::fmt;

use zerocopy::{FromBytes, Immutable, IntoBytes};

/// The operation of a request to the robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
#[non_exhaustive]
pub enum PlantOperation {
    /// Nothing but an answer.
    Status = 0,
    /// Pushes the ball until the next push: numbers 0 to 2 are the force (N), 3 to 5 the moment about
    /// its centre (N m).
    Push = 1,
    /// Puts a ball in the place of any former one: numbers 0 to 2 are its centre (m), 3 its radius
    /// (m), 4 its mass (kg). A support holds the ball there until [`LetGo`](Self::LetGo).
    PlaceBall = 2,
    /// Makes the support let go of the ball, within the time in number 0 (s).
    LetGo = 3,
    /// Takes the ball away.
    RemoveBall = 4,
    /// A sensor stays as it is: `finger`, `joint`, `which`.
    StickSensor = 5,
    /// A tendon breaks: `finger`, `joint`, `which`.
    CutTendon = 6,
    /// All sensors and tendons are whole again. If the simulation has failed, or a joint is far beyond
    /// its limits, the robot is as at its start again, without a ball and pushes.
    Mend = 7,
    /// Pushes a fingertip until the next such push: `finger`, and numbers as for a push.
    PushTip = 8,
}

/// A sensor or a tendon of a joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum PlantTarget {
    /// The sensor of the position.
    Position = 0,
    /// The flexor, or the sensor of its tension.
    Flexor = 1,
    /// The extensor, or the sensor of its tension.
    Extensor = 2,
}

/// The values that a number of a request may have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NumberRange {
    /// The name of the number, for errors.
    pub name: &'static str,
    /// The unit of the number, for errors.
    pub unit: &'static str,
    /// The least value.
    pub low: f64,
    /// The greatest value.
    pub high: f64,
}

impl NumberRange {
    /// The radius of a ball.
    pub const RADIUS: Self = Self::new("the radius of the ball", "m", 0.005, 0.04);
    /// The mass of a ball.
    pub const MASS: Self = Self::new("the mass of the ball", "kg", 0.001, 1.0);
    /// The position of a ball, along each axis of the palm.
    pub const PLACE: Self = Self::new("the position of the ball", "m", -0.3, 0.3);
    /// The force of a push, along each axis of the palm.
    pub const FORCE: Self = Self::new("the force", "N", -20.0, 20.0);
    /// The moment of a push, about each axis of the palm.
    pub const MOMENT: Self = Self::new("the moment", "N m", -1.0, 1.0);
    /// The mass of a weight, whose force is that of a push.
    pub const WEIGHT: Self = Self::new("the weight", "kg", 0.0, 1.0);
    /// The time in which the support lets go of a ball.
    pub const LET_GO: Self = Self::new("the time", "s", 0.0, 60.0);

    const fn new(name: &'static str, unit: &'static str, low: f64, high: f64) -> Self {
        Self {
            name,
            unit,
            low,
            high,
        }
    }

    /// Returns whether the value is in the range; NaN is not.
    #[must_use]
    pub fn contains(&self, value: f64) -> bool {
        (self.low..=self.high).contains(&value)
    }
}

/// A request to the robot.
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct PlantRequest {
    /// The number of a [`PlantOperation`].
    pub operation: u32,
    /// The finger, from 0.
    pub finger: u32,
    /// The joint, from 0.
    pub joint: u32,
    /// The number of a [`PlantTarget`].
    pub which: u32,
    /// The numbers that the operation needs.
    pub numbers: [f64; 6],
}

/// The response of the robot to a [`PlantRequest`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct PlantResponse {
    /// The number of a [`PlantRefusal`]; 0 if it is done.
    pub refusal: u32,
    /// A bit for each D/A board that rests.
    pub resting: u32,
}

/// The reason why the robot refuses a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
#[non_exhaustive]
pub enum PlantRefusal {
    /// The number of the operation is unknown.
    Operation = 1,
    /// The robot is busy with another request: ask again.
    Busy = 2,
    /// There is no such finger, joint, sensor or tendon.
    NoSuchPart = 3,
    /// A number is not in its [`NumberRange`].
    Number = 4,
    /// There is no ball.
    NoBall = 5,
}

impl fmt::Display for PlantRefusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Operation => "it does not know this operation",
            Self::Busy => "it is busy with another request: ask again",
            Self::NoSuchPart => "there is no such finger, joint, sensor or tendon",
            Self::Number => "a number is out of its range",
            Self::NoBall => "there is no ball",
        })
    }
}

impl PlantRefusal {
    /// Returns the refusal with this number; `None` for 0, and for an unknown number.
    #[must_use]
    pub const fn from_number(number: u32) -> Option<Self> {
        match number {
            1 => Some(Self::Operation),
            2 => Some(Self::Busy),
            3 => Some(Self::NoSuchPart),
            4 => Some(Self::Number),
            5 => Some(Self::NoBall),
            _ => None,
        }
    }
}

impl PlantTarget {
    /// Returns the sensor or tendon that has this number in requests; `None` if there is none.
    #[must_use]
    pub const fn from_number(number: u32) -> Option<Self> {
        match number {
            0 => Some(Self::Position),
            1 => Some(Self::Flexor),
            2 => Some(Self::Extensor),
            _ => None,
        }
    }
}

impl PlantOperation {
    /// Returns the operation that has this number in requests; `None` if there is none.
    #[must_use]
    pub const fn from_number(number: u32) -> Option<Self> {
        match number {
            0 => Some(Self::Status),
            1 => Some(Self::Push),
            2 => Some(Self::PlaceBall),
            3 => Some(Self::LetGo),
            4 => Some(Self::RemoveBall),
            5 => Some(Self::StickSensor),
            6 => Some(Self::CutTendon),
            7 => Some(Self::Mend),
            8 => Some(Self::PushTip),
            _ => None,
        }
    }
}
