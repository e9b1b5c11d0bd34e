use thiserror::Error;

use super::{Bounds, Polynomial, ProfileError, Quantity, Segments, SetPoint, TrajectoryError};
use crate::math::{Real, abs, is_finite, min, real};

/// The set-points of J joints at the servo's rate, between those of the master's ticks.
///
/// Between ticks it follows the cubic Hermite polynomial through positions and velocities. If the
/// next tick is late it holds the last velocity for the length of one tick at most, and brakes then.
/// When ticks come again it joins the new motion without a step of position or velocity: what is
/// between the joint and the motion is a motion of its own, within its own bounds, that is added.
#[derive(Clone, Debug)]
pub struct Interpolator<const J: usize, T: Real = f64> {
    substeps: u32,
    /// From step to step, s.
    period: T,
    /// Steps from the beginning of the polynomial, and its length in steps.
    step: u32,
    length: u32,
    /// Steps since its end.
    late: u32,
    joints: [Joint<T>; J],
}

#[derive(Clone, Debug)]
struct Joint<T: Real> {
    bounds: Bounds<T>,
    to: SetPoint<T>,
    /// The way to there, since the first tick came.
    way: Option<Polynomial<T>>,
    gap: Option<Segments<T>>,
    /// Time on the way through the gap, s.
    gap_at: T,
}

/// Whether ticks come in time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Timing {
    /// They do.
    Timely,
    /// The next one is late by less than a tick: joints keep their velocities.
    Holding,
    /// It is later: joints brake, or stand.
    Braking,
}

/// A set-point that no joint can follow.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum SetPointError {
    /// Not a number, or too large.
    #[error("joint {joint} is to be at {position} rad with {velocity} rad/s")]
    NotFinite {
        /// The joint, from 0.
        joint: usize,
        /// rad
        position: f64,
        /// rad/s
        velocity: f64,
    },
}

impl<const J: usize, T: Real> Interpolator<J, T> {
    /// At rest at `positions` (rad); a tick of `tick_s` seconds has `substeps` servo periods. `bounds`
    /// are for braking and for what is added to rejoin a motion, so joints move by up to their
    /// sum with the motion's own.
    ///
    /// # Errors
    ///
    /// No substeps, bounds that are not above zero, what is not finite.
    pub fn new(
        substeps: u16,
        tick_s: T,
        positions: [T; J],
        bounds: [Bounds<T>; J],
    ) -> Result<Self, TrajectoryError> {
        if substeps == 0 {
            return Err(TrajectoryError::Substeps);
        }
        if !(is_finite(tick_s) && tick_s > T::zero()) {
            let value = tick_s.to_f64();
            return Err(TrajectoryError::Tick { value });
        }
        for (joint, (&position, bounds)) in positions.iter().zip(&bounds).enumerate() {
            if !is_finite(position) {
                let value = position.to_f64();
                return Err(TrajectoryError::Start { joint, value });
            }
            for (quantity, bound) in [
                (Quantity::Velocity, bounds.velocity),
                (Quantity::Acceleration, bounds.acceleration),
                (Quantity::Jerk, bounds.jerk.unwrap_or(T::one())),
            ] {
                if !(is_finite(bound) && bound > T::zero()) {
                    return Err(TrajectoryError::Rate {
                        joint,
                        quantity,
                        value: bound.to_f64(),
                    });
                }
            }
        }
        let mut positions = positions.iter().copied();
        let substeps = u32::from(substeps);
        Ok(Self {
            substeps,
            period: tick_s / T::of(f64::from(substeps)),
            step: substeps,
            length: substeps,
            late: 0,
            joints: bounds.map(|bounds| {
                let rest = SetPoint::rest(positions.next().unwrap_or(T::zero()));
                Joint {
                    bounds,
                    to: rest,
                    way: None,
                    gap: None,
                    gap_at: T::zero(),
                }
            }),
        })
    }

    /// A tick has come: where to be one tick from now, or after the end of the tick before if that is
    /// not over. Accelerations are not used.
    ///
    /// # Errors
    ///
    /// The first set-point that is not finite or too far to go to; then it is as if none had come.
    pub fn tick(&mut self, points: &[SetPoint<T>; J]) -> Result<(), SetPointError> {
        let tick = self.seconds(self.substeps);
        let early = self.length - self.step;
        // After a burst of ticks only the newest says where to be.
        let off = self.late > 0 || early > self.substeps;
        let length = if off {
            self.substeps
        } else {
            early + self.substeps
        };
        let mut joints = self.joints.clone();
        for (number, (joint, point)) in joints.iter_mut().zip(points).enumerate() {
            let error = || SetPointError::NotFinite {
                joint: number,
                position: point.position.to_f64(),
                velocity: point.velocity.to_f64(),
            };
            let from = if off {
                let now = self.moving(joint);
                let line = SetPoint {
                    position: point.position - point.velocity * tick,
                    velocity: point.velocity,
                    acceleration: T::zero(),
                };
                joint.bridge(&now, &line).map_err(|_| error())?;
                line
            } else {
                self.base(joint)
            };
            let way = Polynomial::cubic(&from, point, self.seconds(length));
            joint.way = Some(way.map_err(|_| error())?);
            joint.to = *point;
        }
        self.joints = joints;
        self.step = 0;
        self.length = length;
        self.late = 0;
        Ok(())
    }

    /// Lets a joint that is elsewhere join the motion of the ticks: from this state on it closes
    /// what is between the two, within its own bounds.
    ///
    /// # Errors
    ///
    /// A state that is not finite or too far away; then the joint stays where it is.
    pub fn join(&mut self, joint: usize, now: &SetPoint<T>) -> Result<(), SetPointError> {
        let Some(onto) = self.joints.get(joint).map(|joint| self.base(joint)) else {
            return Ok(());
        };
        let Some(moved) = self.joints.get_mut(joint) else {
            return Ok(());
        };
        moved
            .bridge(now, &onto)
            .map_err(|_| SetPointError::NotFinite {
                joint,
                position: now.position.to_f64(),
                velocity: now.velocity.to_f64(),
            })
    }

    /// The set-points one servo period later.
    pub fn step(&mut self) -> [SetPoint<T>; J] {
        if self.step < self.length {
            self.step += 1;
        } else {
            self.late = self.late.saturating_add(1);
        }
        for joint in &mut self.joints {
            joint.gap_at += self.period;
            let over = |gap: &Segments<T>| !(joint.gap_at < gap.duration());
            if joint.gap.as_ref().is_some_and(over) {
                joint.gap = None;
            }
        }
        self.set_points()
    }

    /// The present set-points.
    #[must_use]
    pub fn set_points(&self) -> [SetPoint<T>; J] {
        self.joints.each_ref().map(|joint| self.moving(joint))
    }

    /// Whether ticks come in time.
    #[must_use]
    pub fn timing(&self) -> Timing {
        if self.late == 0 {
            Timing::Timely
        } else if self.late <= self.substeps {
            Timing::Holding
        } else {
            Timing::Braking
        }
    }

    /// Some joint has not rejoined the motion of the ticks.
    #[must_use]
    pub fn is_rejoining(&self) -> bool {
        self.joints.iter().any(|joint| joint.gap.is_some())
    }

    fn seconds(&self, steps: u32) -> T {
        T::of(f64::from(steps)) * self.period
    }

    /// The motion of the ticks, with what is left of a gap.
    fn moving(&self, joint: &Joint<T>) -> SetPoint<T> {
        let base = self.base(joint);
        let Some(gap) = &joint.gap else {
            return base;
        };
        let gap = gap.at(joint.gap_at);
        SetPoint {
            position: base.position + gap.position,
            velocity: base.velocity + gap.velocity,
            acceleration: base.acceleration + gap.acceleration,
        }
    }

    fn base(&self, joint: &Joint<T>) -> SetPoint<T> {
        if self.late == 0 {
            if self.step == self.length {
                return joint.to;
            }
            let at = self.seconds(self.step);
            return joint.way.as_ref().map_or(joint.to, |way| way.at(at));
        }
        let SetPoint {
            position, velocity, ..
        } = joint.to;
        let held = self.late.min(self.substeps);
        let braking = self.seconds(self.late - held);
        let position = position + velocity * self.seconds(held);
        let deceleration = if velocity > T::zero() {
            joint.bounds.acceleration
        } else {
            -joint.bounds.acceleration
        };
        let over = abs(velocity / deceleration);
        let t = min(braking, over);
        let stands = !(braking < over);
        let moves = braking > T::zero() && !stands;
        SetPoint {
            position: position + (velocity - deceleration * t * real::<T>(0.5)) * t,
            velocity: if stands {
                T::zero()
            } else {
                velocity - deceleration * t
            },
            acceleration: if moves { -deceleration } else { T::zero() },
        }
    }
}

impl<T: Real> Joint<T> {
    /// Begins to close what is between two states.
    fn bridge(&mut self, now: &SetPoint<T>, onto: &SetPoint<T>) -> Result<(), ProfileError> {
        let gap = SetPoint {
            position: now.position - onto.position,
            velocity: now.velocity - onto.velocity,
            acceleration: T::zero(),
        };
        self.gap = Some(Segments::fastest(&gap, T::zero(), &self.bounds)?);
        self.gap_at = T::zero();
        Ok(())
    }
}
