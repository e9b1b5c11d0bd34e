//! From a primitive and the states that it starts from to a path for each joint.

use heapless::Vec;

use super::path::{KNOTS, Path};
use super::{
    Bounds, MotionError, Pace, Polynomial, Primitive, Profile, ProfileLimits, Segments, SetPoint,
    Spline, Target,
};
use crate::Subject;
use crate::math::{max, min, sqrt};
use crate::number::{NumberError, Requirement, check_motion};

/// One primitive at the moment of its start, real or foreseen.
pub(super) struct Planner<'a, const J: usize> {
    pub(super) primitive: &'a Primitive<J>,
    pub(super) starts: &'a [SetPoint; J],
    pub(super) limits: &'a [ProfileLimits; J],
    /// No motion is shorter than a tick, s.
    pub(super) tick: f64,
}

/// The planned motion of the joints of a primitive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Plan {
    shape: Shape,
    pub(super) duration: f64,
    /// Not as the primitive says, since the limits forbid it from where the joints are.
    pub(super) adjusted: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Shape {
    /// The primitive's own profile.
    Asked,
    /// Whichever segments keep the limits.
    Safe,
}

/// A joint with its state, limits and target.
struct Joint<'a> {
    number: usize,
    start: SetPoint,
    limits: &'a ProfileLimits,
    end: f64,
}

impl<'a, const J: usize> Planner<'a, J> {
    /// Returns the plan as the primitive asks for it, or the error of the first joint that cannot do it.
    pub(super) fn asked(&self) -> Result<Plan, MotionError> {
        self.targets()?;
        let plan = Plan {
            shape: Shape::Asked,
            duration: match self.primitive.pace {
                Pace::Duration(duration) => duration,
                Pace::Speed(speed) => self.least(speed)?,
            },
            adjusted: false,
        };
        self.check(plan)
    }

    /// Returns the plan as the primitive asks for it; else a slower one; else one with segments, which always
    /// keep the limits if no via points ask for more.
    pub(super) fn possible(&self) -> Result<Plan, MotionError> {
        let refused = match self.asked() {
            Ok(plan) => return Ok(plan),
            Err(refused) => refused,
        };
        self.targets()?;
        let mut duration = self.least(1.0).map_err(|_| refused)?;
        if let Pace::Duration(asked) = self.primitive.pace {
            duration = max(duration, asked);
        }
        for _ in 0..8 {
            let slower = self.check(Plan {
                shape: Shape::Asked,
                duration,
                adjusted: true,
            });
            if slower.is_ok() {
                return slower;
            }
            duration *= 1.25;
        }
        if !self.primitive.vias.is_empty() {
            return Err(refused);
        }
        let mut plan = Plan {
            shape: Shape::Safe,
            duration: self.tick,
            adjusted: true,
        };
        for joint in self.joints() {
            plan.duration = max(plan.duration, joint.safe(self.tick)?.duration());
        }
        Ok(plan)
    }

    /// The path of one joint in a plan that has been made.
    pub(super) fn path(&self, number: usize, plan: &Plan) -> Result<Path, MotionError> {
        let mut joints = self.joints();
        let Some(joint) = joints.find(|joint| joint.number == number) else {
            return Err(MotionError::NoJoint {
                joint: number,
                joints: J,
            });
        };
        match plan.shape {
            Shape::Asked => self.shaped(&joint, plan.duration),
            Shape::Safe => joint.safe(plan.duration),
        }
    }

    fn joints(&self) -> impl Iterator<Item = Joint<'a>> + '_ {
        let states = self.starts.iter().zip(self.limits);
        self.primitive.joints().filter_map(move |(number, target)| {
            let (start, limits) = states.clone().nth(number)?;
            let end = match target {
                Target::Absolute(position) => position,
                Target::Relative(by) => start.position + by,
            };
            Some(Joint {
                number,
                start: *start,
                limits,
                end,
            })
        })
    }

    fn targets(&self) -> Result<(), MotionError> {
        self.joints().try_for_each(|joint| joint.check_target())
    }

    fn check(&self, plan: Plan) -> Result<Plan, MotionError> {
        for joint in self.joints() {
            joint.check(&self.shaped(&joint, plan.duration)?)?;
        }
        Ok(plan)
    }

    /// The least duration from rest with which all joints keep a fraction of their limits.
    fn least(&self, speed: f64) -> Result<f64, MotionError> {
        let mut duration = self.tick;
        for mut joint in self.joints() {
            let needed = if let Some(bounds) = joint.bounds(self.primitive.profile, speed) {
                joint.fastest(&bounds)?.duration()
            } else {
                // Velocity goes with 1 / duration, acceleration with its square.
                joint.start = SetPoint::rest(joint.start.position);
                let peaks = self.shaped(&joint, 1.0)?.peaks();
                let limits = joint.limits;
                let velocity = peaks.velocity / (speed * limits.velocity);
                max(velocity, sqrt(peaks.acceleration / limits.acceleration))
            };
            duration = max(duration, needed);
        }
        Ok(duration)
    }

    /// The primitive's own profile for one joint.
    fn shaped(&self, joint: &Joint, duration: f64) -> Result<Path, MotionError> {
        let end = SetPoint::rest(joint.end);
        if !self.primitive.vias.is_empty() {
            return self.spline(joint, duration);
        }
        let profile = self.primitive.profile;
        let speed = match self.primitive.pace {
            Pace::Speed(speed) => speed,
            Pace::Duration(_) => 1.0,
        };
        if let Some(bounds) = joint.bounds(profile, speed) {
            return joint.together(&bounds, duration).map(Path::Segments);
        }
        match profile {
            Profile::Cubic => Polynomial::cubic(&joint.start, &end, duration),
            _ => Polynomial::quintic(&joint.start, &end, duration),
        }
        .map(Path::Polynomial)
        .map_err(|error| joint.failed(error))
    }

    fn spline(&self, joint: &Joint, duration: f64) -> Result<Path, MotionError> {
        let mut times: Vec<f64, KNOTS> = Vec::new();
        let mut positions: Vec<f64, KNOTS> = Vec::new();
        let target = self.primitive.targets.get(joint.number);
        let origin = match target {
            Some(Target::Relative(_)) => joint.start.position,
            _ => 0.0,
        };
        let vias = self.primitive.vias.iter().filter_map(|via| {
            let position = via.positions.get(joint.number)?;
            Some((via.at * duration, origin + *position))
        });
        let ends = ((0.0, joint.start.position), (duration, joint.end));
        for (time, position) in [ends.0].into_iter().chain(vias).chain([ends.1]) {
            // There are two knots more than via points fit.
            let _ = times.push(time);
            let _ = positions.push(position);
        }
        Spline::clamped(&times, &positions, (joint.start.velocity, 0.0))
            .map(Path::Spline)
            .map_err(|error| joint.failed(error))
    }
}

impl Joint<'_> {
    fn failed(&self, error: NumberError) -> MotionError {
        error.at(Subject::Joint(self.number as u16)).into()
    }

    /// The limits of a profile of segments; `None` for one that has none.
    fn bounds(&self, profile: Profile, speed: f64) -> Option<Bounds> {
        match profile {
            Profile::Cubic | Profile::MinimumJerk => None,
            Profile::Trapezoid => Some(self.within(None, speed)),
            Profile::JerkLimited => Some(self.within(Some(self.limits.jerk), speed)),
        }
    }

    fn within(&self, jerk: Option<f64>, speed: f64) -> Bounds {
        Bounds {
            velocity: speed * self.limits.velocity,
            acceleration: self.limits.acceleration,
            jerk,
        }
    }

    fn fastest(&self, bounds: &Bounds) -> Result<Segments, MotionError> {
        Segments::fastest(&self.start, self.end, bounds).map_err(|error| self.failed(error))
    }

    /// In exactly `duration` if a moving state allows that, else as fast as it can.
    fn together(&self, bounds: &Bounds, duration: f64) -> Result<Segments, MotionError> {
        match Segments::lasting(&self.start, self.end, bounds, duration) {
            Ok(Some(segments)) => Ok(segments),
            Ok(None) => self.fastest(bounds),
            Err(error) => Err(self.failed(error)),
        }
    }

    /// Segments that keep the limits: with limited jerk if the range leaves room for that.
    ///
    /// The last resort is the hardest braking there is. Wherever the joint comes from, it could have
    /// stopped in its range, so it does with this.
    fn safe(&self, duration: f64) -> Result<Path, MotionError> {
        let soft = self.safely(&self.within(Some(self.limits.jerk), 1.0), duration);
        soft.or_else(|_| self.safely(&self.within(None, 1.0), duration))
    }

    /// In exactly `duration` if these bounds and the limits allow that, else as fast as they do.
    fn safely(&self, bounds: &Bounds, duration: f64) -> Result<Path, MotionError> {
        let together = Segments::lasting(&self.start, self.end, bounds, duration);
        if let Ok(Some(segments)) = together
            && self.check(&Path::Segments(segments)).is_ok()
        {
            return Ok(Path::Segments(segments));
        }
        let path = Path::Segments(self.fastest(bounds)?);
        self.check(&path).map(|()| path)
    }

    fn check_target(&self) -> Result<(), MotionError> {
        let limits = self.limits;
        self.keeps((limits.low, limits.high), (self.end, self.end))
    }

    /// Checks that a path keeps the limits; a joint may come back from outside of its range.
    fn check(&self, path: &Path) -> Result<(), MotionError> {
        let peaks = path.peaks();
        let limits = self.limits;
        let low = min(limits.low, self.start.position);
        let high = max(limits.high, self.start.position);
        self.keeps((low, high), (peaks.low, peaks.high))?;
        let (velocity, acceleration) = (limits.velocity, limits.acceleration);
        for (what, value, limit) in [
            ("the velocity, rad/s,", peaks.velocity, velocity),
            (
                "the acceleration, rad/s²,",
                peaks.acceleration,
                acceleration,
            ),
        ] {
            let most = Requirement::AtMost(limit);
            check_motion(what, value, most, limit).map_err(|error| self.failed(error))?;
        }
        Ok(())
    }

    /// Checks that the least and the greatest position are in a range.
    fn keeps(
        &self,
        (low, high): (f64, f64),
        (least, greatest): (f64, f64),
    ) -> Result<(), MotionError> {
        let (at_least, at_most) = (Requirement::AtLeast(low), Requirement::AtMost(high));
        let (what, range) = ("the position, rad,", self.limits.high - self.limits.low);
        check_motion(what, least, at_least, range)
            .and_then(|()| check_motion(what, greatest, at_most, range))
            .map_err(|error| self.failed(error))
    }
}
