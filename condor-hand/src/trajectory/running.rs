//! One primitive in motion: its own time, which slows down to stop and speeds up to go on.
//!
//! All of its joints stay on their paths while they stop, so they keep to the limits of positions
//! and to one another. With the path q(s) and the rate r = ds/dt, velocity is q' r and acceleration
//! q'' r² + q' dr/dt. At a constant r <= 1 that is within the limits whenever the path is.

use super::path::Path;
use super::{Guards, MotionEnd, MotionTicket, OnEnd, ProfileLimits, SetPoint};
use crate::math::{Real, abs, clamp, max, real};
use crate::number::tolerance;

#[derive(Clone, Debug)]
pub(super) struct Running<T> {
    pub(super) ticket: MotionTicket,
    pub(super) mask: u32,
    /// Time on the path, s.
    pub(super) at: T,
    /// Seconds of the path per second.
    pub(super) rate: T,
    pub(super) duration: T,
    /// Ticks since the start.
    pub(super) ticks: u32,
    pub(super) stop: Guards<T>,
    pub(super) on_end: OnEnd,
    /// The reason why it stops; `None` if it does not stop.
    pub(super) ending: Option<MotionEnd>,
    /// The end of the motion when its path is over: not `Reached` if it only returns to the place at which a
    /// servo has stopped its joints.
    pub(super) outcome: MotionEnd,
    /// Its end has been told.
    pub(super) is_told: bool,
}

/// A joint: its present set-point, and the path of whatever moves it.
#[derive(Clone, Debug)]
pub(super) struct Mover<T: Real> {
    pub(super) state: SetPoint<T>,
    pub(super) path: Path<T>,
    pub(super) limits: ProfileLimits<T>,
    /// The number of the motion that moves it, or moved it last; 0 for none.
    pub(super) motion: u32,
    /// A servo has stopped it in that motion.
    pub(super) is_stopped: bool,
}

impl<T: Real> Mover<T> {
    /// Rests at a position, without any motion.
    pub(super) fn rest(&mut self, position: T) {
        self.state = SetPoint::rest(position);
        self.path = Path::Still(position);
        self.motion = 0;
        self.is_stopped = false;
    }
}

/// The greatest change of the rate in one tick: a stop is spread over a few ticks even where the limits
/// would allow less.
const GREATEST_CHANGE: f64 = 0.25;
/// The number of times that the change is halved before the rate is left alone for this tick.
const HALVINGS: u8 = 40;

impl<T: Real> Running<T> {
    pub(super) fn moves(&self, joint: usize) -> bool {
        self.mask >> joint & 1 == 1
    }

    /// Returns true if it only returns to the place at which a servo has stopped its joints.
    pub(super) fn returns(&self) -> bool {
        self.outcome != MotionEnd::Reached
    }

    /// The rest of the path at full rate, s.
    pub(super) fn remaining(&self) -> T {
        max(self.duration - self.at, T::zero())
    }

    /// Moves the joints by one tick; the reason once it has ended.
    pub(super) fn advance<const J: usize>(
        &mut self,
        joints: &mut [Mover<T>; J],
        tick: T,
        paused: bool,
    ) -> Option<MotionEnd> {
        let goal = if paused || self.ending.is_some() {
            T::zero()
        } else {
            T::one()
        };
        let change = self.change(joints, tick, goal);
        let next = self.after(change, tick);
        let slope = change / tick;
        self.ticks = self.ticks.saturating_add(1);
        self.at = next.0;
        self.rate = next.1;
        let over = self.at >= self.duration;
        for (joint, mover) in joints.iter_mut().enumerate() {
            if !self.moves(joint) {
                continue;
            }
            let point = mover.path.at(self.at);
            mover.state = if over {
                SetPoint::rest(point.position)
            } else {
                SetPoint {
                    position: point.position,
                    velocity: point.velocity * self.rate,
                    acceleration: acceleration(&point, self.rate, slope),
                }
            };
        }
        if over {
            return Some(self.ending.unwrap_or(self.outcome));
        }
        self.ending.filter(|_| self.rate == T::zero())
    }

    /// The time on the path and the rate after a tick in which the rate changes evenly.
    fn after(&self, change: T, tick: T) -> (T, T) {
        let rate = clamp(self.rate + change, T::zero(), T::one());
        let mean = (self.rate + rate) * real::<T>(0.5);
        (self.at + mean * tick, rate)
    }

    /// The greatest change of the rate towards `goal` that all joints can follow.
    fn change<const J: usize>(&self, joints: &[Mover<T>; J], tick: T, goal: T) -> T {
        let greatest = real::<T>(GREATEST_CHANGE);
        let mut change = clamp(goal - self.rate, -greatest, greatest);
        for _ in 0..HALVINGS {
            if change == T::zero() || self.allows(joints, tick, change) {
                return change;
            }
            change *= real::<T>(0.5);
        }
        T::zero()
    }

    fn allows<const J: usize>(&self, joints: &[Mover<T>; J], tick: T, change: T) -> bool {
        let slope = change / tick;
        let next = self.after(change, tick);
        joints.iter().enumerate().all(|(joint, mover)| {
            !self.moves(joint)
                || [(self.at, self.rate), next].into_iter().all(|(at, rate)| {
                    let point = mover.path.at(at);
                    let most = mover.limits.acceleration;
                    abs(acceleration(&point, rate, slope)) <= most + tolerance(most)
                })
        })
    }
}

fn acceleration<T: Real>(point: &SetPoint<T>, rate: T, slope: T) -> T {
    point.acceleration * rate * rate + point.velocity * slope
}
