//! [`Robot`]: a robot as people look at it.
//!
//! `condor` knows nothing of any robot. An application for a robot returns it by
//! [`Application::robot`](crate::application::Application::robot): plots then draw it, and recordings and
//! viewers get its joints and frames. A robot with a [`Simulator`] is also computed without any processor;
//! [`MotionFiles`] are its motion files, and a [`MotionSender`] sends composed motions to a running system.

mod motions;
mod simulator;

pub use motions::{MotionFiles, MotionOutcome, MotionSender};
pub use simulator::largest;
pub use simulator::{
    ActuatorPlan, Clearance, Collision, DragResult, JointPlan, LimitedJoint, LimitedPosture,
    MotionPeaks, Overload, Plan, PlanEvent, Simulator, What,
};

/// A robot as plots, recordings and viewers show it: its joints, and the places of its parts. An application implements
/// it for its own robot.
///
/// The positions in the arguments are in the order of [`joints`](Self::joints), in radians or metres. Missing
/// positions, and those that are not finite, count as 0.
pub trait Robot: Send + Sync {
    /// Returns the joints.
    fn joints(&self) -> &[RobotJoint];

    /// Returns the lines that show the robot with its joints at `positions`, in the frame of the base.
    fn lines(&self, positions: &[f64]) -> Vec<RobotLine>;

    /// Returns the frames of all links but the base, parents first.
    fn frames(&self, positions: &[f64]) -> Vec<Frame>;

    /// Returns the variables, beside those of joints and lines, from which [`objects`](Self::objects) follow.
    fn observed(&self) -> &[String] {
        &[]
    }

    /// Returns the objects that the robot handles. `observed` are the values of the variables of
    /// [`observed`](Self::observed), in that order; NaN if they are not known.
    fn objects(&self, positions: &[f64], observed: &[f64]) -> Vec<RobotObject> {
        let _ = (positions, observed);
        Vec::new()
    }

    /// Returns the description of the robot as URDF, whose links are the frames; `None` if there is
    /// none.
    fn urdf(&self) -> Option<String> {
        None
    }

    /// Returns the simulator of the robot's motions; `None` if there is none.
    fn simulator(&self) -> Option<&dyn Simulator> {
        None
    }
}

/// A joint of a [`Robot`]: its name, the variables that have its state, and its limits.
#[derive(Clone, Debug, PartialEq)]
pub struct RobotJoint {
    /// The name of the joint, unique in the robot.
    pub name: String,
    /// The variable that has its position, in radians or metres.
    pub position: String,
    /// The variable that has its velocity, in rad/s or m/s.
    pub velocity: Option<String>,
    /// The variable that has its torque or force, in N m or N.
    pub effort: Option<String>,
    /// The least and the greatest position, in radians or metres.
    pub limits: [f64; 2],
}

/// The place of a number in a robot's configuration.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DescribedKey {
    /// The way to its key from the top of the file, such as `fingers[0].joints[1].servo.kp`.
    pub key: String,
    /// The line, from 1, at which its value stands, which may be that of a default; `None` if the file leaves it out.
    pub line: Option<usize>,
}

/// A line through several points that shows a part of a robot, such as a link or a tendon.
#[derive(Clone, Debug, PartialEq)]
pub struct RobotLine {
    /// The name of the part that the line shows, such as that of a link.
    pub name: String,
    /// The points of the line in their order, in metres, in the frame of the base.
    pub points: Vec<[f64; 3]>,
    /// Half the thickness of the part, in metres; 0 for a thread.
    pub radius_m: f64,
    /// The name of the variable by which the line is colored: the effort of the actuator that it shows, such as the
    /// tension of a tendon, in N; `None` for a part without an actuator.
    pub effort: Option<String>,
}

/// The place and the orientation of a link, relative to its parent link.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// The name of the link.
    pub name: String,
    /// The name of the link to which its place is relative.
    pub parent: String,
    /// The origin of the link's frame in that of the parent, in metres.
    pub translation: [f64; 3],
    /// The orientation of the link's frame in that of the parent, as a unit quaternion x, y, z, w.
    pub rotation: [f64; 4],
}

/// A ball that the robot handles, for viewers that show it, with the places where the robot touches it.
#[derive(Clone, Debug, PartialEq)]
pub struct RobotObject {
    /// The name of the object, for people.
    pub name: String,
    /// The centre of the ball, in metres.
    pub center: [f64; 3],
    /// The radius of the ball, in metres.
    pub radius_m: f64,
    /// The places where parts of the robot touch it.
    pub contacts: Vec<RobotContact>,
}

/// A place at which a part of the robot touches a [`RobotObject`], with the direction and the force there.
#[derive(Clone, Debug, PartialEq)]
pub struct RobotContact {
    /// The name of the part.
    pub name: String,
    /// The place, in metres.
    pub point: [f64; 3],
    /// The normal of the surface there, of length 1, out of the object.
    pub normal: [f64; 3],
    /// The force along the normal with which the part presses, in newtons, if it is known.
    pub force_n: Option<f64>,
}
