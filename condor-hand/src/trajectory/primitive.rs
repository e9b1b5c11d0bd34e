use core::fmt;

use heapless::Vec;
use thiserror::Error;

use crate::Subject;
use crate::math::{abs, is_finite};
use crate::number::{NumberError, Requirement, check, finite, not_negative, positive};

/// The greatest number of via points that a [`Primitive`] can have.
pub const MAX_VIAS: usize = 16;

/// One motion of some of J joints, from their present state to rest at their targets. A
/// [`Generator`](super::Generator) runs it.
#[derive(Clone, Debug, PartialEq)]
pub struct Primitive<const J: usize> {
    /// The joints that it moves: bit i is joint i.
    pub mask: u32,
    /// The target of each joint in the mask.
    pub targets: [Target; J],
    /// The duration or the speed.
    pub pace: Pace,
    /// The shape of the motion.
    pub profile: Profile,
    /// Points to pass without stopping; only with [`Profile::Cubic`].
    pub vias: Vec<Via<J>, MAX_VIAS>,
    /// The condition under which its turn comes.
    pub begin: Begin,
    /// The time by which it may begin before the end of the primitive for which it waits, s.
    pub blend: f64,
    /// The conditions of its start, when its turn has come: it begins as soon as one of them holds;
    /// without conditions, at once.
    pub start: Guards,
    /// The conditions of its stop: it ends as soon as one of them holds.
    pub stop: Guards,
    /// The reaction to its end.
    pub on_end: OnEnd,
}

/// The target of a joint in a [`Primitive`]: a position, or a displacement.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum Target {
    /// The joint goes to this position, rad.
    Absolute(f64),
    /// The joint goes by this displacement from its set-point at the start of the motion, rad.
    Relative(f64),
}

/// The pace of a [`Primitive`]: its duration, or its speed.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum Pace {
    /// The motion takes this duration, s.
    Duration(f64),
    /// The joints move at this fraction (above 0, at most 1) of their limits of velocity; the joint
    /// that takes longest determines the duration.
    Speed(f64),
}

/// The shape of a motion in time: how its velocity grows and falls between start and end.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Profile {
    /// Cubic Hermite; with via points, the clamped cubic spline.
    Cubic,
    /// The quintic of least squared jerk, which starts and ends without acceleration.
    MinimumJerk,
    /// Constant acceleration, velocity and deceleration.
    Trapezoid,
    /// A trapezoid of velocity with limited jerk.
    JerkLimited,
}

impl fmt::Display for Profile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Cubic => "cubic",
            Self::MinimumJerk => "minimum-jerk",
            Self::Trapezoid => "trapezoid",
            Self::JerkLimited => "jerk-limited",
        })
    }
}

/// A via point: positions that a motion passes without stopping, and the time at which it does so.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Via<const J: usize> {
    /// Its time as a fraction of the duration, above 0 and below 1.
    pub at: f64,
    /// The positions there, rad: absolute or relative as the target of the same joint.
    pub positions: [f64; J],
}

/// The condition under which the turn of a [`Primitive`] comes, once it is the first one in the
/// queue.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Begin {
    /// All primitives before it have ended.
    #[default]
    After,
    /// All primitives that move one of its joints have ended; it may run beside the others.
    Beside,
    /// Its turn comes at once: it takes its joints from other primitives, in their present state.
    Now,
}

/// The reaction of a [`Generator`](super::Generator) to the end of a primitive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OnEnd {
    /// The next primitive of the queue follows.
    #[default]
    Next,
    /// Nothing follows until [`Generator::proceed`](super::Generator::proceed) is called.
    Hold,
}

/// Conditions that start or stop a primitive, such as a torque or a contact of its joints. One
/// condition that holds is enough.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Guards {
    /// The condition holds if the torque of any of its joints, to either side, is above this, N m;
    /// `None` means no such condition.
    pub torque: Option<f64>,
    /// The condition holds if the effort of any actuator of its joints is above this, N or N m; `None`
    /// means no such condition.
    pub effort: Option<f64>,
    /// The condition holds when this time has passed, s; `None` means no such condition.
    pub time: Option<f64>,
    /// True if a contact of the finger of any of its joints is a condition.
    #[serde(default)]
    pub contact: bool,
}

/// The condition of [`Guards`] that held, and so started or stopped a primitive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MotionGuard {
    /// The torque of this joint was above its limit.
    Torque {
        /// The joint, from 0.
        joint: usize,
    },
    /// The effort of an actuator of this joint was above its limit.
    Effort {
        /// The joint, from 0.
        joint: usize,
    },
    /// The time had passed.
    Time,
    /// The finger of this joint was in contact.
    Contact {
        /// The joint, from 0.
        joint: usize,
    },
}

/// The sensor readings of one tick with which a [`Generator`](super::Generator) compares the
/// conditions of primitives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observations<const J: usize> {
    /// Measured torque of each joint, N m.
    pub torques: [f64; J],
    /// The greatest effort of the actuators of each joint, to either side, N or N m.
    pub efforts: [f64; J],
    /// Bit i is set if the finger of joint i is in contact.
    pub contacts: u32,
}

impl<const J: usize> Observations<J> {
    /// Returns observations in which nothing is measured: zero torques and efforts, and no
    /// contacts.
    #[must_use]
    pub fn none() -> Self {
        Self {
            torques: [0.0; J],
            efforts: [0.0; J],
            contacts: 0,
        }
    }
}

impl Guards {
    /// Returns guards without any condition.
    #[must_use]
    pub const fn none() -> Self {
        Self {
            torque: None,
            effort: None,
            time: None,
            contact: false,
        }
    }

    pub(super) fn is_none(&self) -> bool {
        self.torque.is_none() && self.effort.is_none() && self.time.is_none() && !self.contact
    }

    /// The first condition that holds for certain: a reading that is not finite starts nothing.
    pub(super) fn holds<const J: usize>(
        &self,
        mask: u32,
        elapsed: f64,
        seen: &Observations<J>,
    ) -> Option<MotionGuard> {
        self.first(mask, elapsed, seen, |value, limit| value > limit)
    }

    /// The first condition that does not fail for certain: a reading that is not finite stops the motion.
    pub(super) fn may_hold<const J: usize>(
        &self,
        mask: u32,
        elapsed: f64,
        seen: &Observations<J>,
    ) -> Option<MotionGuard> {
        self.first(mask, elapsed, seen, |value, limit| {
            !is_finite(value) || value > limit
        })
    }

    fn first<const J: usize>(
        &self,
        mask: u32,
        elapsed: f64,
        seen: &Observations<J>,
        above: impl Fn(f64, f64) -> bool,
    ) -> Option<MotionGuard> {
        let values = seen.torques.iter().zip(&seen.efforts);
        for (joint, (&torque, &effort)) in values.enumerate() {
            if mask >> joint & 1 == 0 {
                continue;
            }
            if self.torque.is_some_and(|limit| above(abs(torque), limit)) {
                return Some(MotionGuard::Torque { joint });
            }
            if self.effort.is_some_and(|limit| above(effort, limit)) {
                return Some(MotionGuard::Effort { joint });
            }
            if self.contact && seen.contacts >> joint & 1 == 1 {
                return Some(MotionGuard::Contact { joint });
            }
        }
        self.is_over(elapsed).then_some(MotionGuard::Time)
    }

    /// Returns true if the time has passed.
    pub(super) fn is_over(&self, elapsed: f64) -> bool {
        self.time.is_some_and(|time| elapsed >= time)
    }
}

impl<const J: usize> Primitive<J> {
    /// Makes a primitive that moves no joints yet; add them with [`with`](Self::with). It begins
    /// after the primitives before it, and has no conditions.
    #[must_use]
    pub fn new(pace: Pace, profile: Profile) -> Self {
        Self {
            mask: 0,
            targets: [Target::Relative(0.0); J],
            pace,
            profile,
            vias: Vec::new(),
            begin: Begin::After,
            blend: 0.0,
            start: Guards::none(),
            stop: Guards::none(),
            on_end: OnEnd::Next,
        }
    }

    /// Returns the primitive with the target of one more joint; `joint` is counted from 0.
    ///
    /// # Errors
    /// [`MotionError::NoJoint`] if the joint does not exist.
    pub fn with(mut self, joint: usize, target: Target) -> Result<Self, MotionError> {
        let bit = u32::try_from(joint).ok().and_then(|n| 1_u32.checked_shl(n));
        let (Some(place), Some(bit)) = (self.targets.get_mut(joint), bit) else {
            return Err(MotionError::NoJoint { joint, joints: J });
        };
        *place = target;
        self.mask |= bit;
        Ok(self)
    }

    /// The joints of the mask with their targets.
    pub(super) fn joints(&self) -> impl Iterator<Item = (usize, Target)> + '_ {
        let all = self.targets.iter().copied().enumerate();
        all.filter(|(joint, _)| self.mask >> joint & 1 == 1)
    }

    /// Checks the primitive as far as the joints' states and limits do not matter.
    pub(super) fn check(&self) -> Result<(), MotionError> {
        let beyond = u32::try_from(J).ok().and_then(|n| u32::MAX.checked_shl(n));
        if self.mask & beyond.unwrap_or(0) != 0 || self.mask == 0 {
            return Err(MotionError::Mask {
                mask: self.mask,
                joints: J,
            });
        }
        for (joint, target) in self.joints() {
            let (Target::Absolute(value) | Target::Relative(value)) = target;
            check_goal(joint, value)?;
        }
        match self.pace {
            Pace::Duration(value) => positive("the duration, s,", value)?,
            Pace::Speed(value) => {
                positive("the speed", value)?;
                check("the speed", value, Requirement::AtMost(1.0))?;
            }
        }
        not_negative("the blend, s,", self.blend)?;
        for guards in [&self.start, &self.stop] {
            for limit in [guards.torque, guards.effort, guards.time] {
                finite("the limit of a guard", limit.unwrap_or(0.0))?;
            }
        }
        if !self.vias.is_empty() && self.profile != Profile::Cubic {
            return Err(MotionError::ViaProfile {
                profile: self.profile,
            });
        }
        let mut last = 0.0;
        for (index, via) in self.vias.iter().enumerate() {
            let what = "the time, as a fraction of the duration,";
            check(what, via.at, Requirement::Above(last))
                .and_then(|()| check(what, via.at, Requirement::Below(1.0)))
                .map_err(|error| error.at(Subject::Via(index as u16)))?;
            last = via.at;
            for (joint, _) in self.joints() {
                let value = via.positions.get(joint).copied().unwrap_or(0.0);
                check_goal(joint, value)?;
            }
        }
        Ok(())
    }
}

fn check_goal(joint: usize, position: f64) -> Result<(), NumberError> {
    finite("the position, rad,", position).map_err(|error| error.at(Subject::Joint(joint as u16)))
}

/// The reason why a motion is refused; joints are counted from 0.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum MotionError {
    /// The queue is full.
    #[error("the queue of {capacity} motions is full; wait until one has ended")]
    Full {
        /// The number of motions for which it has room.
        capacity: usize,
    },
    /// The mask has no joint, or one that does not exist.
    #[error(
        "the mask {mask:#x} must have a bit of at least one joint, and none beyond the {joints} joints"
    )]
    Mask {
        /// The mask that was given: bit *i* is joint *i*.
        mask: u32,
        /// The number of joints.
        joints: usize,
    },
    /// The joint does not exist.
    #[error("joint {joint} does not exist: there are {joints}, numbered from 0")]
    NoJoint {
        /// The joint that was named.
        joint: usize,
        /// The number of joints.
        joints: usize,
    },
    /// A number is not possible: a duration, a speed, a blend, the limit of a condition, the time of a via point,
    /// or a position or rate that a joint would have.
    #[error(transparent)]
    Number(#[from] NumberError),
    /// There are via points, but the profile does not pass any.
    #[error("via points need the cubic profile, not {profile}")]
    ViaProfile {
        /// The profile that was given.
        profile: Profile,
    },
    /// The table has failed, or has not been home.
    #[error("the table is not ready to move; clear its failure if it has one, and bring it home")]
    NotReady,
}

impl MotionError {
    /// Returns the error for display with the name of a joint in place of its number; `names[i]` is that of joint i.
    pub fn named<'n, N: AsRef<str>>(&'n self, names: &'n [N]) -> impl fmt::Display + 'n {
        NamedMotionError { error: self, names }
    }
}

struct NamedMotionError<'n, N> {
    error: &'n MotionError,
    names: &'n [N],
}

impl<N: AsRef<str>> fmt::Display for NamedMotionError<'_, N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let MotionError::Number(error) = *self.error
            && let Subject::Joint(joint) = error.at
            && let Some(name) = self.names.get(usize::from(joint))
        {
            return write!(f, "{}: {}", name.as_ref(), error.at(Subject::Whole));
        }
        self.error.fmt(f)
    }
}
