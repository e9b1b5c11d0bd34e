//! The requests to the robot, and its responses.

use core::fmt;

use zerocopy::{FromBytes, Immutable, IntoBytes};

/// The operation that a [`PlantRequest`] asks the simulated robot for.
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

/// The part of a joint that a [`PlantRequest`] breaks: a sensor or a tendon.
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

/// The range of values that the robot accepts for a number of a [`PlantRequest`].
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
    /// The range of the radius of a ball, m.
    pub const RADIUS: Self = Self::new("the radius of the ball", "m", 0.005, 0.04);
    /// The range of the mass of a ball, kg.
    pub const MASS: Self = Self::new("the mass of the ball", "kg", 0.001, 1.0);
    /// The range of the position of a ball along each axis of the palm, m.
    pub const PLACE: Self = Self::new("the position of the ball", "m", -0.3, 0.3);
    /// The range of the force of a push along each axis of the palm, N.
    pub const FORCE: Self = Self::new("the force", "N", -20.0, 20.0);
    /// The range of the moment of a push about each axis of the palm, N m.
    pub const MOMENT: Self = Self::new("the moment", "N m", -1.0, 1.0);
    /// The range of the mass of a weight that hangs on a fingertip, kg. Its force is sent as a push.
    pub const WEIGHT: Self = Self::new("the weight", "kg", 0.0, 1.0);
    /// The range of the time within which the support lets go of a ball, s.
    pub const LET_GO: Self = Self::new("the time", "s", 0.0, 60.0);

    const fn new(name: &'static str, unit: &'static str, low: f64, high: f64) -> Self {
        Self {
            name,
            unit,
            low,
            high,
        }
    }

    /// Returns true if `value` is in the range, of which both ends are part; NaN is not in it.
    #[must_use]
    pub fn contains(&self, value: f64) -> bool {
        (self.low..=self.high).contains(&value)
    }
}

/// A request to the simulated robot, such as to place a ball or to break a tendon. It answers with a [`PlantResponse`].
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

/// The response of the simulated robot to a [`PlantRequest`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct PlantResponse {
    /// The number of a [`PlantRefusal`]; 0 if it is done.
    pub refusal: u32,
    /// A bit for each D/A board that rests.
    pub resting: u32,
}

/// The reason why the simulated robot refuses a [`PlantRequest`].
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
    /// Returns the refusal with the number `number`, which is in a [`PlantResponse`]. Returns `None` for 0, which means
    /// that the request is done, and for an unknown number.
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
    /// Returns the sensor or tendon with the number `number`, which is in a [`PlantRequest`]; `None` for an unknown
    /// number.
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
    /// Returns the operation with the number `number`, which is in a [`PlantRequest`]; `None` for an unknown number.
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
