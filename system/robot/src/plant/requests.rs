//! The requests to the robot, and its responses.

use core::fmt;

use serde::{Deserialize, Serialize};

/// A request to the simulated robot. Fingers, joints and actuators are counted from 0; vectors are in the axes of the palm.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum PlantRequest {
    /// Pushes the ball until the next push.
    Push {
        /// The force on its centre, N.
        force: [f64; 3],
        /// The moment about its centre, N m.
        moment: [f64; 3],
    },
    /// Pushes a fingertip until the next such push.
    PushTip {
        /// The finger whose tip is pushed.
        finger: u32,
        /// The force on its tip, N.
        force: [f64; 3],
        /// The moment about its tip, N m.
        moment: [f64; 3],
    },
    /// Puts a ball in the place of any former one. A support holds the ball there until [`LetGo`](Self::LetGo).
    PlaceBall {
        /// The position of its centre, m.
        center: [f64; 3],
        /// Its radius, m.
        radius: f64,
        /// Its mass, kg.
        mass: f64,
    },
    /// Makes the support let go of the ball.
    LetGo {
        /// The time within which its force vanishes, s.
        seconds: f64,
    },
    /// Takes the ball away.
    RemoveBall,
    /// Makes a sensor stay as it is.
    StickSensor {
        /// The finger that has the sensor.
        finger: u32,
        /// The sensor that stays as it is.
        sensor: PlantSensor,
    },
    /// Takes the effort of an actuator away, as if its tendon or its wire were cut.
    CutDrive {
        /// The finger that has the actuator.
        finger: u32,
        /// The number of the actuator in its finger.
        actuator: u32,
    },
    /// Makes all sensors and drives whole again. If the simulation has failed, or a joint is far beyond its limits, the
    /// robot is as at its start again, without a ball and pushes.
    Mend,
}

/// The response of the simulated robot to a [`PlantRequest`].
pub type PlantResponse = Result<(), PlantRefusal>;

/// A sensor of a finger that a [`PlantRequest`] breaks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum PlantSensor {
    /// The sensor of the position of the joint of this number.
    Position(u32),
    /// The sensor of the position of the actuator of this number.
    Encoder(u32),
    /// The sensor of the effort of the actuator of this number.
    Effort(u32),
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

/// The reason why the simulated robot refuses a [`PlantRequest`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum PlantRefusal {
    /// The robot is busy with another request: ask again.
    Busy,
    /// There is no such finger, joint, sensor or actuator.
    NoSuchPart,
    /// A number is not in its [`NumberRange`].
    Number,
    /// There is no ball.
    NoBall,
}

impl fmt::Display for PlantRefusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Busy => "it is busy with another request: ask again",
            Self::NoSuchPart => "there is no such finger, joint, sensor or actuator",
            Self::Number => "a number is out of its range, which `help` of the command tells",
            Self::NoBall => "there is no ball: `ball` adds one",
        })
    }
}
