//! [`Simulator`]: a robot's motions, computed from its configuration alone.

use serde::Serialize;
use serde_json::Value as Json;

use crate::error::AnyError;

/// The motions of a robot, computed from its configuration alone: no processor runs.
///
/// # For users
///
/// A simulator keeps nothing between calls. Positions are those of [`Robot::joints`](super::Robot::joints) in
/// their order, in radians or metres; points are in metres, in the frame of the base. All results can be
/// written as JSON, with the names of their fields.
///
/// The document of a composed motion is the text of the robot's motion file. A program that composes one keeps
/// the texts, with as many previous ones as it wants to undo, and requests a plan of the present one.
/// [`steps`](Self::steps) returns the contents of a text for editing, and [`text`](Self::text) the text of
/// edited contents. That text is the one to save or enqueue.
///
/// # For implementers
///
/// [`plan`](Self::plan) must run the code that makes the set-points on the robot's own processor: they must be
/// equal to the last bit.
pub trait Simulator: Send + Sync {
    /// Returns positions within the limits of the joints. Missing ones, and those that are not finite,
    /// count as 0.
    fn moved(&self, positions: &[f64]) -> LimitedPosture;

    /// Returns the positions that bring the origin of a frame to a point, or as near to it as can be found.
    /// Joints that do not carry the frame stay.
    ///
    /// # Errors
    /// Returns an error that names the frame if the robot does not have it, or the number that cannot be used.
    fn dragged(&self, positions: &[f64], frame: &str, to: [f64; 3])
    -> Result<DragResult, AnyError>;

    /// Returns the distances between parts of the robot that must not meet.
    fn clearances(&self, positions: &[f64]) -> Vec<Clearance>;

    /// Returns the motion that the robot makes of the text of a motion file, from rest at `from`. Sensors
    /// read nothing: no condition of a torque, an effort or a contact holds. `file` is the name of the text
    /// in errors.
    ///
    /// # Errors
    /// Returns an error if the text is wrong, if a position of `from` is not possible, or if the plan is too
    /// long; the text says where.
    fn plan(&self, from: &[f64], motion: &str, file: &str) -> Result<Plan, AnyError>;

    /// Returns the contents of a motion file as JSON: tables, lists and values with the names that they have
    /// in the text. Comments are lost.
    ///
    /// # Errors
    /// Returns an error if the text is wrong; the text of the error says where.
    fn steps(&self, motion: &str, file: &str) -> Result<Json, AnyError>;

    /// Returns the text of a motion file with these contents.
    ///
    /// # Errors
    /// Returns an error if the robot cannot read these contents; the text says what is wrong.
    fn text(&self, steps: &Json) -> Result<String, AnyError>;
}

/// The positions of all joints, brought within their limits, and the joints for which that changed something.
/// [`Simulator::moved`] returns it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LimitedPosture {
    /// The positions of all joints.
    pub positions: Vec<f64>,
    /// The joints that would be beyond a limit.
    pub held: Vec<LimitedJoint>,
}

/// A joint that stays at one of its limits because the wanted position is beyond it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LimitedJoint {
    /// The name of the joint.
    pub joint: String,
    /// The limit, rad or m.
    pub limit: f64,
}

/// The positions that bring a frame to a point, or as near to it as was found. [`Simulator::dragged`] returns it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DragResult {
    /// The positions of all joints.
    pub positions: Vec<f64>,
    /// Whether the frame is at the point, within a micrometre.
    pub is_reached: bool,
    /// The distance from the frame to the point, m.
    pub distance_m: f64,
    /// The joints that hold the frame off the point by their limits.
    pub held: Vec<LimitedJoint>,
}

/// The distance between two parts of a robot that must not touch each other.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Clearance {
    /// The names of the parts, for people; a link has that of its joint.
    pub parts: [String; 2],
    /// The nearest point of the middle line of each part, m.
    pub points: [[f64; 3]; 2],
    /// The distance between the surfaces, m: below 0 if they meet.
    pub distance_m: f64,
}

/// A motion, computed before a robot makes it. [`Simulator::plan`] returns it. The lists of joints and actuators have an
/// element for each tick of the processor that makes the set-points: element `i` is `i` periods after the start, and
/// element 0 is the start.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Plan {
    /// The time from tick to tick, s.
    pub period_s: f64,
    /// All joints of the robot, in their order.
    pub joints: Vec<JointPlan>,
    /// The events of the steps of the motion, such as begin and end.
    pub events: Vec<PlanEvent>,
    /// The times in which actuators cannot produce the torque that the motion takes.
    pub overloads: Vec<Overload>,
    /// The times in which parts of the robot meet.
    pub collisions: Vec<Collision>,
}

/// The part of a [`Plan`] for one joint: its set-points in each tick, and its limits. The units are those of a rotating
/// joint.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct JointPlan {
    /// The name of the joint.
    pub name: String,
    /// The set-points, rad.
    pub position: Vec<f64>,
    /// The rates of the set-points, rad/s.
    pub velocity: Vec<f64>,
    /// The accelerations of the set-points, rad/s².
    pub acceleration: Vec<f64>,
    /// The torques that the motion takes in free space, N m.
    pub torque: Vec<f64>,
    /// The least and the greatest position, rad.
    pub position_limits: [f64; 2],
    /// The greatest speed, rad/s.
    pub velocity_limit: f64,
    /// The greatest acceleration, rad/s².
    pub acceleration_limit: f64,
    /// The least and the greatest torque that the actuators can give the joint, N m, whatever the other joints get.
    pub torque_limits: [f64; 2],
    /// The actuators that belong to the joint: it is the last one that they move.
    pub actuators: Vec<ActuatorPlan>,
}

/// The greatest fraction of each limit of a joint that a motion uses: 1 is the whole limit. [`JointPlan::peaks`]
/// returns it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MotionPeaks {
    /// The fraction of the greatest speed.
    pub velocity: f64,
    /// The fraction of the least or the greatest torque, whichever has the sign of the torque.
    pub torque: f64,
    /// The fraction of the least or the greatest effort of its actuators, whichever has the sign of the effort; `None`
    /// without actuators.
    pub effort: Option<f64>,
}

impl JointPlan {
    /// Returns, for each limit of the joint, the greatest fraction of it that the motion uses in any tick.
    #[must_use]
    pub fn peaks(&self) -> MotionPeaks {
        let actuators = self.actuators.iter();
        let efforts = actuators.map(|it| peak(&it.effort, it.limits));
        MotionPeaks {
            velocity: largest(&self.velocity) / self.velocity_limit,
            torque: peak(&self.torque, self.torque_limits),
            effort: efforts.reduce(f64::max),
        }
    }
}

/// Returns the greatest fraction of a limit that values use, where each has the limit of its sign.
fn peak(values: &[f64], [least, most]: [f64; 2]) -> f64 {
    let parts = values.iter().map(|value| {
        let limit: f64 = if *value < 0.0 { least } else { most };
        value.abs() / limit.abs()
    });
    // `max` leaves out a NaN, which is 0 of 0.
    parts.fold(0.0, f64::max)
}

/// Returns the largest absolute value in `values`; 0 if there are none.
#[must_use]
pub fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |most, value| value.abs().max(most))
}

/// The part of a [`Plan`] for one actuator: its effort in each tick, and its limits.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ActuatorPlan {
    /// The name of the actuator.
    pub name: String,
    /// The efforts, N or N m: the tensions of an actuator that pulls a tendon.
    pub effort: Vec<f64>,
    /// The least and the greatest effort, N or N m.
    pub limits: [f64; 2],
}

/// An event in a [`Plan`]: the state of one step of the motion changes, for example because the step begins.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PlanEvent {
    /// The time since the start, s.
    pub at_s: f64,
    /// The step, from 1, in the order of the text.
    pub step: usize,
    /// The change of the state of the step.
    #[serde(flatten)]
    pub what: What,
}

/// The change of a step's state that a [`PlanEvent`] reports, such as its begin or its end.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case", tag = "what")]
pub enum What {
    /// The step begins.
    Begins,
    /// The step begins in a changed form, since the limits do not permit it from the state of the joints.
    BeginsAdjusted,
    /// The step has reached its targets.
    Reached,
    /// The step has stopped because its time is over.
    Stopped,
    /// The step has ended because another step has taken its last joint.
    Superseded,
    /// The step was dropped because another step is refused.
    Dropped,
    /// The step is not possible; all motion slows down and ends.
    Refused {
        /// The reason for the refusal, for people.
        reason: String,
    },
    /// The step waits for a condition that no simulation has; the plan ends here.
    Waits,
    /// The robot would hold here until somebody lets the motion go on; the plan goes on at once.
    Holds,
}

/// A span of ticks in a [`Plan`] in which the actuators of a joint cannot produce the torque that the motion needs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Overload {
    /// The name of the joint.
    pub joint: String,
    /// The time of the first of these ticks, s since the start.
    pub from_s: f64,
    /// The time of the last of these ticks, s since the start.
    pub to_s: f64,
    /// The torque that is farthest beyond the possible one, N m.
    pub torque: f64,
    /// The torque that the actuators can produce then, N m.
    pub possible: f64,
}

/// A span of ticks in a [`Plan`] in which two parts of the robot touch each other.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Collision {
    /// The time of the first of these ticks, s since the start.
    pub from_s: f64,
    /// The time of the last of these ticks, s since the start.
    pub to_s: f64,
    /// The parts where they are deepest in each other.
    #[serde(flatten)]
    pub deepest: Clearance,
}
