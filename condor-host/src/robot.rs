//! [`Robot`]: the mechanism of a robot, for whoever draws it or tells others of it.

/// A robot's mechanism: its joints, and where its parts are for positions of the joints.
///
/// # For implementers
///
/// `positions` has one value for each of [`joints`](Self::joints), in that order, in rad or m. It
/// may have any length and any values: missing ones count as 0.
pub trait Robot: Send + Sync {
    /// Returns the joints.
    fn joints(&self) -> &[Joint];

    /// Returns the lines that show the robot, in metres in the axes of its base.
    fn lines(&self, positions: &[f64]) -> Vec<Line>;

    /// Returns the frames of the robot's parts, each relative to its parent.
    fn frames(&self, positions: &[f64]) -> Vec<Frame>;

    /// Returns the description of the robot in URDF (the XML format of ROS); `None` if it has none.
    fn urdf(&self) -> Option<String>;
}

/// A joint, with the names of the variables that show it.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// The name of the joint.
    pub name: String,
    /// The variable that is its position, rad or m.
    pub position: String,
    /// The variable that is its velocity, rad/s or m/s.
    pub velocity: Option<String>,
    /// The variable that is its torque or force, N m or N.
    pub effort: Option<String>,
    /// The least and the greatest position, rad or m.
    pub limits: [f64; 2],
}

/// A line through several points.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// The name of the part.
    pub name: String,
    /// The points, m.
    pub points: Vec<[f64; 3]>,
    /// The variable that is its tension, N, if the line is a tendon.
    pub tension: Option<String>,
}

/// A frame, relative to its parent.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// The name of the frame.
    pub name: String,
    /// The name of the frame around it.
    pub parent: String,
    /// The origin, m.
    pub translation: [f64; 3],
    /// The axes: the quaternion x, y, z, w.
    pub rotation: [f64; 4],
}
