use heapless::Vec;
use thiserror::Error;

use super::{ProfileError, Quantity};
use crate::decimal::Decimal;
use crate::math::{Real, abs, is_finite};

/// The most via points of a primitive.
pub const MAX_VIAS: usize = 16;

/// One motion of some of J joints, from wherever they are to rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Primitive<const J: usize, T: Real = f64> {
    /// The joints that it moves: bit i is joint i.
    pub mask: u32,
    /// Where each joint of the mask goes.
    pub targets: [Target<T>; J],
    /// How long it takes.
    pub pace: Pace<T>,
    /// The shape of the motion.
    pub profile: Profile,
    /// Points to pass without stopping; only with [`Profile::Cubic`].
    pub vias: Vec<Via<J, T>, MAX_VIAS>,
    /// When its turn comes.
    pub begin: Begin,
    /// How long before the end of what it waits for it may begin already, s.
    pub blend: T,
    /// Once it is its turn: begin as soon as one of these holds; without any, at once.
    pub start: Guards<T>,
    /// End as soon as one of these holds.
    pub stop: Guards<T>,
    /// What comes after it.
    pub on_end: OnEnd,
}

/// Where a joint goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target<T> {
    /// To this position, rad.
    Absolute(T),
    /// By so much from the set-point at the start of the motion, rad.
    Relative(T),
}

/// How long a primitive takes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pace<T> {
    /// So many seconds.
    Duration(T),
    /// As long as the joint that needs most, at this fraction (above 0, at most 1) of the limits of
    /// velocity.
    Speed(T),
}

/// The shape of a motion in time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Profile {
    /// Cubic Hermite; with via points the clamped cubic spline.
    Cubic,
    /// The quintic of least squared jerk, which starts and ends without acceleration.
    MinimumJerk,
    /// Constant acceleration, velocity and deceleration.
    Trapezoid,
    /// The same with a limit of jerk.
    JerkLimited,
}

/// A point to pass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Via<const J: usize, T: Real = f64> {
    /// When, as a fraction of the duration, above 0 and below 1.
    pub at: T,
    /// Where, rad: absolute or relative as the target of the same joint.
    pub positions: [T; J],
}

/// When the turn of a primitive comes, once it is the first of the queue.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Begin {
    /// When everything before it has ended.
    #[default]
    After,
    /// When everything that moves one of its joints has ended; it may run beside the others.
    Beside,
    /// Now: it takes its joints from whatever moves them, in the state that they are in.
    Now,
}

/// What comes after a primitive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OnEnd {
    /// The next of the queue.
    #[default]
    Next,
    /// Nothing, until the generator is told to proceed.
    Hold,
}

/// Conditions of what sensors say of the joints of a primitive; any one is enough.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Guards<T> {
    /// The torque of any of its joints, to either side, is above this, N m.
    pub torque: Option<T>,
    /// The tension of any tendon of its joints is above this, N.
    pub tension: Option<T>,
    /// So much time has passed, s.
    pub time: Option<T>,
    /// Any of its joints belongs to a finger in contact.
    #[serde(default)]
    pub contact: bool,
}

/// What a guard saw.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Guard {
    /// The torque of this joint.
    Torque {
        /// The joint, from 0.
        joint: usize,
    },
    /// The tension of a tendon of this joint.
    Tension {
        /// The joint, from 0.
        joint: usize,
    },
    /// The time.
    Time,
    /// A contact of the finger of this joint.
    Contact {
        /// The joint, from 0.
        joint: usize,
    },
}

/// What the guards look at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observations<const J: usize, T: Real = f64> {
    /// Measured torque of each joint, N m.
    pub torques: [T; J],
    /// The greater tension of the two tendons of each joint, N.
    pub tensions: [T; J],
    /// Bit i: the finger of joint i is in contact.
    pub contacts: u32,
}

impl<const J: usize, T: Real> Observations<J, T> {
    /// Nothing pulls and nothing touches.
    #[must_use]
    pub fn none() -> Self {
        Self {
            torques: [T::zero(); J],
            tensions: [T::zero(); J],
            contacts: 0,
        }
    }
}

impl<T: Real> Guards<T> {
    /// No condition.
    #[must_use]
    pub const fn none() -> Self {
        Self {
            torque: None,
            tension: None,
            time: None,
            contact: false,
        }
    }

    pub(super) fn is_none(&self) -> bool {
        self.torque.is_none() && self.tension.is_none() && self.time.is_none() && !self.contact
    }

    /// The first condition that holds for certain: a sensor that gives no number starts nothing.
    pub(super) fn holds<const J: usize>(
        &self,
        mask: u32,
        elapsed: T,
        seen: &Observations<J, T>,
    ) -> Option<Guard> {
        self.first(mask, elapsed, seen, |value, limit| value > limit)
    }

    /// The first condition that does not fail for certain: a sensor that gives no number stops.
    pub(super) fn may_hold<const J: usize>(
        &self,
        mask: u32,
        elapsed: T,
        seen: &Observations<J, T>,
    ) -> Option<Guard> {
        self.first(mask, elapsed, seen, |value, limit| {
            !is_finite(value) || value > limit
        })
    }

    fn first<const J: usize>(
        &self,
        mask: u32,
        elapsed: T,
        seen: &Observations<J, T>,
        above: impl Fn(T, T) -> bool,
    ) -> Option<Guard> {
        let values = seen.torques.iter().zip(&seen.tensions);
        for (joint, (&torque, &tension)) in values.enumerate() {
            if mask >> joint & 1 == 0 {
                continue;
            }
            if self.torque.is_some_and(|limit| above(abs(torque), limit)) {
                return Some(Guard::Torque { joint });
            }
            if self.tension.is_some_and(|limit| above(tension, limit)) {
                return Some(Guard::Tension { joint });
            }
            if self.contact && seen.contacts >> joint & 1 == 1 {
                return Some(Guard::Contact { joint });
            }
        }
        let over = self.time.is_some_and(|time| elapsed >= time);
        over.then_some(Guard::Time)
    }

    fn is_finite(&self) -> bool {
        let all = [self.torque, self.tension, self.time];
        all.into_iter().flatten().all(is_finite)
    }
}

impl<const J: usize, T: Real> Primitive<J, T> {
    /// A motion of no joints, after what is before it, with nothing after it to wait for.
    #[must_use]
    pub fn new(pace: Pace<T>, profile: Profile) -> Self {
        Self {
            mask: 0,
            targets: [Target::Relative(T::zero()); J],
            pace,
            profile,
            vias: Vec::new(),
            begin: Begin::After,
            blend: T::zero(),
            start: Guards::none(),
            stop: Guards::none(),
            on_end: OnEnd::Next,
        }
    }

    /// The same with one joint more.
    ///
    /// # Errors
    ///
    /// A joint beyond the last.
    pub fn with(mut self, joint: usize, target: Target<T>) -> Result<Self, PrimitiveError> {
        let bit = u32::try_from(joint).ok().and_then(|n| 1_u32.checked_shl(n));
        let (Some(place), Some(bit)) = (self.targets.get_mut(joint), bit) else {
            return Err(PrimitiveError::Joint { joint, joints: J });
        };
        *place = target;
        self.mask |= bit;
        Ok(self)
    }

    /// The joints of the mask with their targets.
    pub(super) fn joints(&self) -> impl Iterator<Item = (usize, Target<T>)> + '_ {
        let all = self.targets.iter().copied().enumerate();
        all.filter(|(joint, _)| self.mask >> joint & 1 == 1)
    }

    /// What can be told without the joints' states and limits.
    pub(super) fn check(&self) -> Result<(), PrimitiveError> {
        let beyond = u32::try_from(J).ok().and_then(|n| u32::MAX.checked_shl(n));
        if self.mask & beyond.unwrap_or(0) != 0 || self.mask == 0 {
            return Err(PrimitiveError::Mask {
                mask: self.mask,
                joints: J,
            });
        }
        for (joint, target) in self.joints() {
            let (Target::Absolute(value) | Target::Relative(value)) = target;
            if !is_finite(value) {
                let value = value.to_f64();
                return Err(PrimitiveError::Target { joint, value });
            }
        }
        match self.pace {
            Pace::Duration(value) if !(is_finite(value) && value > T::zero()) => {
                return Err(PrimitiveError::Duration {
                    value: value.to_f64(),
                });
            }
            Pace::Speed(value) if !(value > T::zero() && value <= T::one()) => {
                return Err(PrimitiveError::Speed {
                    value: value.to_f64(),
                });
            }
            _ => {}
        }
        if !(is_finite(self.blend) && self.blend >= T::zero()) {
            return Err(PrimitiveError::Blend {
                value: self.blend.to_f64(),
            });
        }
        if !(self.start.is_finite() && self.stop.is_finite()) {
            return Err(PrimitiveError::Guard);
        }
        if !self.vias.is_empty() && self.profile != Profile::Cubic {
            return Err(PrimitiveError::ViaProfile {
                profile: self.profile,
            });
        }
        let mut last = T::zero();
        for (index, via) in self.vias.iter().enumerate() {
            let at = via.at;
            if !(at > last && at < T::one()) {
                let at = at.to_f64();
                return Err(PrimitiveError::ViaTime { index, at });
            }
            last = at;
            for (joint, _) in self.joints() {
                let value = via.positions.get(joint).copied().unwrap_or(T::zero());
                if !is_finite(value) {
                    let value = value.to_f64();
                    return Err(PrimitiveError::Target { joint, value });
                }
            }
        }
        Ok(())
    }
}

/// Why a primitive is refused; joints are counted from 0.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum PrimitiveError {
    /// The queue has no place.
    #[error("the queue of {capacity} primitives is full")]
    Full {
        /// How many it takes.
        capacity: usize,
    },
    /// No joint, or one that does not exist.
    #[error("the mask {mask:#x} must name at least one of {joints} joints and no other")]
    Mask {
        /// The mask.
        mask: u32,
        /// How many joints there are.
        joints: usize,
    },
    /// A joint beyond the last.
    #[error("joint {joint} does not exist: there are {joints}")]
    Joint {
        /// The joint.
        joint: usize,
        /// How many joints there are.
        joints: usize,
    },
    /// A position that is not finite.
    #[error("joint {joint} is to go to {value} rad", value = Decimal(*.value))]
    Target {
        /// The joint.
        joint: usize,
        /// The position or displacement, rad.
        value: f64,
    },
    /// A duration that is not above zero.
    #[error("a duration of {value} s must be above zero and finite", value = Decimal(*.value))]
    Duration {
        /// s
        value: f64,
    },
    /// A fraction of speed outside of its range.
    #[error("a speed of {value} must be above 0 and at most 1", value = Decimal(*.value))]
    Speed {
        /// Of the limits of velocity.
        value: f64,
    },
    /// A blend that is negative or not finite.
    #[error("a blend of {value} s must be at least zero and finite", value = Decimal(*.value))]
    Blend {
        /// s
        value: f64,
    },
    /// A guard whose limit is not finite.
    #[error("the limits of guards must be finite")]
    Guard,
    /// Via points with a profile that does not pass points.
    #[error("via points need the cubic profile, not {profile:?}")]
    ViaProfile {
        /// The profile that was given.
        profile: Profile,
    },
    /// Via points that are not in order.
    #[error(
        "via point {index} is at {at} of the duration; it must be after the one before, below 1",
        at = Decimal(*.at),
    )]
    ViaTime {
        /// The via point, from 0.
        index: usize,
        /// Its time as a fraction of the duration.
        at: f64,
    },
    /// A joint would leave its range.
    #[error(
        "joint {joint} would go to {value} rad; it may be in {low}..={high} rad",
        value = Decimal(*.value),
        low = Decimal(*.low),
        high = Decimal(*.high),
    )]
    Position {
        /// The joint.
        joint: usize,
        /// The position furthest beyond, rad.
        value: f64,
        /// The least position, rad.
        low: f64,
        /// The greatest position, rad.
        high: f64,
    },
    /// A joint would be too fast.
    #[error(
        "joint {joint} would reach a {quantity} of {value}; its limit is {limit}",
        value = Decimal(*.value),
        limit = Decimal(*.limit),
    )]
    Rate {
        /// The joint.
        joint: usize,
        /// Which derivative.
        quantity: Quantity,
        /// The greatest value.
        value: f64,
        /// The limit.
        limit: f64,
    },
    /// A joint has no such profile.
    #[error("joint {joint}: {error}")]
    Profile {
        /// The joint.
        joint: usize,
        /// Why not.
        error: ProfileError,
    },
}
