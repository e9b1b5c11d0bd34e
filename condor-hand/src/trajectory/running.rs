//! One primitive in motion: its own time, which slows down to stop and speeds up to go on.
//!
//! All of its joints stay on their paths while they stop, so they keep to the limits of positions
//! and to one another. With the path q(s) and the rate r = ds/dt, velocity is q' r and acceleration
//! q'' r² + q' dr/dt. At a constant r <= 1 that is within the limits whenever the path is.

use super::path::Path;
use super::{Guards, MotionEnd, MotionTicket, OnEnd, ProfileLimits, SetPoint};
use crate::math::{abs, clamp, max};
use crate::number::tolerance;

#[derive(Clone, Debug)]
pub(super) struct Running {
    pub(super) ticket: MotionTicket,
    pub(super) mask: u32,
    /// Time on the path, s.
    pub(super) at: f64,
    /// Seconds of the path per second.
    pub(super) rate: f64,
    pub(super) duration: f64,
    /// Ticks since the start.
    pub(super) ticks: u32,
    pub(super) stop: Guards,
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
pub(super) struct Mover {
    pub(super) state: SetPoint,
    pub(super) path: Path,
    pub(super) limits: ProfileLimits,
    /// The number of the motion that moves it, or moved it last; 0 for none.
    pub(super) motion: u32,
    /// A servo has stopped it in that motion.
    pub(super) is_stopped: bool,
}

impl Mover {
    /// Rests at a position, without any motion.
    pub(super) fn rest(&mut self, position: f64) {
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

impl Running {
    pub(super) fn moves(&self, joint: usize) -> bool {
        self.mask >> joint & 1 == 1
    }

    /// Returns true if it only returns to the place at which a servo has stopped its joints.
    pub(super) fn returns(&self) -> bool {
        self.outcome != MotionEnd::Reached
    }

    /// The rest of the path at full rate, s.
    pub(super) fn remaining(&self) -> f64 {
        max(self.duration - self.at, 0.0)
    }

    /// Moves the joints by one tick; the reason once it has ended.
    pub(super) fn advance<const J: usize>(
        &mut self,
        joints: &mut [Mover; J],
        tick: f64,
        paused: bool,
    ) -> Option<MotionEnd> {
        let goal = if paused || self.ending.is_some() {
            0.0
        } else {
            1.0
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
        self.ending.filter(|_| self.rate == 0.0)
    }

    /// The time on the path and the rate after a tick in which the rate changes evenly.
    fn after(&self, change: f64, tick: f64) -> (f64, f64) {
        let rate = clamp(self.rate + change, 0.0, 1.0);
        let mean = (self.rate + rate) * 0.5;
        (self.at + mean * tick, rate)
    }

    /// The greatest change of the rate towards `goal` that all joints can follow.
    fn change<const J: usize>(&self, joints: &[Mover; J], tick: f64, goal: f64) -> f64 {
        let mut change = clamp(goal - self.rate, -GREATEST_CHANGE, GREATEST_CHANGE);
        for _ in 0..HALVINGS {
            if change == 0.0 || self.allows(joints, tick, change) {
                return change;
            }
            change *= 0.5;
        }
        0.0
    }

    fn allows<const J: usize>(&self, joints: &[Mover; J], tick: f64, change: f64) -> bool {
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

fn acceleration(point: &SetPoint, rate: f64, slope: f64) -> f64 {
    point.acceleration * rate * rate + point.velocity * slope
}
