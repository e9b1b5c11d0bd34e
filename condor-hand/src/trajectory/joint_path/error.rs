use core::error::Error;
use core::fmt;

use crate::decimal::Decimal;
use crate::kinematics::Side;
use crate::number::{NumberError, Subject};

/// A deviation of a tip from the pose that it should have: a distance and an angle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PathDeviation {
    /// The distance, m.
    pub position: f64,
    /// The angle, rad.
    pub rotation: f64,
}

/// The reason why no joints take a tip along a path. `fraction` is the place on the path, from 0 to 1; joints are counted
/// from 0.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum JointPathError {
    /// A number is not possible.
    Number(NumberError),
    /// No joint is at a limit, and yet the tip does not come to the path: the pose there is out of reach, or singular.
    OutOfReach {
        /// The place on the path.
        fraction: f64,
        /// The error that remains there.
        off: PathDeviation,
    },
    /// A limit of a joint keeps the tip off the path.
    Limit {
        /// The place on the path.
        fraction: f64,
        /// The joint that is at a limit.
        joint: usize,
        /// The limit at which it is.
        side: Side,
        /// The error that remains there; none if the joint would pass the limit between two postures.
        off: PathDeviation,
    },
    /// A joint would have to jump: the path passes a singular posture, or the end of a branch.
    Jump {
        /// The place on the path.
        fraction: f64,
        /// The joint that moves most.
        joint: usize,
        /// The change of its position within a short part of the path, rad or m.
        by: f64,
    },
    /// Between the via points that a motion can have the tip would leave the path by too much.
    Deviation {
        /// The place on the path.
        fraction: f64,
        /// The deviation there.
        off: PathDeviation,
    },
}

impl JointPathError {
    /// Returns the error for display with the name of a joint in place of its number; `names[i]` is that of joint i of the
    /// mechanism.
    pub fn named<'n, N: AsRef<str>>(&'n self, names: &'n [N]) -> impl fmt::Display + 'n {
        NamedJointPathError { error: self, names }
    }
}

impl fmt::Display for JointPathError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.named::<&str>(&[]).fmt(f)
    }
}

impl Error for JointPathError {}

impl From<NumberError> for JointPathError {
    fn from(error: NumberError) -> Self {
        Self::Number(error)
    }
}

struct NamedJointPathError<'n, N> {
    error: &'n JointPathError,
    names: &'n [N],
}

impl<N: AsRef<str>> fmt::Display for NamedJointPathError<'_, N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let who = |joint| Who(joint, self.names.get(joint).map(AsRef::as_ref));
        match *self.error {
            JointPathError::Number(error) => match error.at {
                Subject::Joint(joint) => {
                    let who = who(usize::from(joint));
                    write!(f, "{who}: {}", error.at(Subject::Whole))
                }
                _ => error.fmt(f),
            },
            JointPathError::OutOfReach { fraction, off } => write!(
                f,
                "at {} the tip comes no nearer than {off}; move the path into the reach of the mechanism",
                Place(fraction)
            ),
            JointPathError::Limit {
                fraction,
                joint,
                side,
                off,
            } => {
                let (place, who, side) = (Place(fraction), who(joint), side.name());
                if off == PathDeviation::default() {
                    write!(f, "at {place} {who} would pass its {side} limit")?;
                } else {
                    write!(
                        f,
                        "at {place} {who} is at its {side} limit, which keeps the tip {off} off"
                    )?;
                }
                f.write_str("; start from another posture, or move the path")
            }
            JointPathError::Jump {
                fraction,
                joint,
                by,
            } => write!(
                f,
                "at {} {} would have to jump by {:.3} rad: a singular posture is near; start from another posture, or move the path",
                Place(fraction),
                who(joint),
                Decimal(by)
            ),
            JointPathError::Deviation { fraction, off } => write!(
                f,
                "at {} the tip would be {off} off; divide the path, or permit more",
                Place(fraction)
            ),
        }
    }
}

/// A joint by its name, or by its number.
struct Who<'n>(usize, Option<&'n str>);

impl fmt::Display for Who<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.1 {
            Some(name) => f.write_str(name),
            None => write!(f, "joint {}", self.0),
        }
    }
}

/// A place on a path.
struct Place(f64);

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.3} of the path", Decimal(self.0))
    }
}

/// The distance, and the angle if there is one.
impl fmt::Display for PathDeviation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.9} m", Decimal(self.position))?;
        if self.rotation > 0.0 {
            write!(f, " and {:.9} rad", Decimal(self.rotation))?;
        }
        Ok(())
    }
}

impl Side {
    /// The name of the side in an error.
    const fn name(self) -> &'static str {
        match self {
            Self::Low => "lower",
            Self::High => "upper",
        }
    }
}
