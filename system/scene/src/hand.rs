use condor_hand::Pose;
use condor_hand::config::Hand;
use condor_host::robot::{
    Frame, Robot, RobotContact, RobotJoint, RobotLine, RobotObject, Simulator,
};
use nalgebra::{Rotation3, UnitQuaternion, Vector3};

use crate::finger::Finger;
use crate::{tendon, urdf};

/// The name of the base.
pub(crate) const PALM: &str = "palm";
/// The name of the ball.
const BALL: &str = "ball";

/// A hand as plots, recordings and viewers show it: lines, tendons, frames and URDF. It also
/// simulates motions of the hand without any processor. The base of this robot is the palm.
#[derive(Clone, Debug)]
pub struct HandView<const FINGERS: usize, const JOINTS: usize, const ACTUATORS: usize> {
    pub(crate) hand: Hand<FINGERS, JOINTS, ACTUATORS>,
    pub(crate) joints: Vec<RobotJoint>,
    pub(crate) fingers: Vec<Finger>,
    /// The variables of the ball, if one is shown.
    ball: Vec<String>,
}

/// The names of the variables that describe a ball in a hand, for [`HandView::with_ball`].
#[derive(Clone, Copy, Debug)]
pub struct Ball<'v> {
    /// The variables with the coordinates of the centre of the ball in the frame of the palm, m. They are not finite
    /// while there is no ball.
    pub center: [&'v str; 3],
    /// The variable with the radius of the ball, m.
    pub radius_m: &'v str,
    /// The variable with one bit for each finger: bit *i* is set while finger *i*, counted from 0,
    /// touches the ball.
    pub touching: &'v str,
}

impl<const FINGERS: usize, const JOINTS: usize, const ACTUATORS: usize>
    HandView<FINGERS, JOINTS, ACTUATORS>
{
    /// Makes the view of the hand that `hand` describes, without a ball.
    #[must_use]
    pub fn new(hand: &Hand<FINGERS, JOINTS, ACTUATORS>) -> Self {
        let fingers: Vec<Finger> = hand.fingers.iter().map(Finger::new).collect();
        let joints = fingers.iter().flat_map(Finger::joints).map(|link| {
            let variable = |what| format!("{}.{what}", link.name);
            RobotJoint {
                name: link.name.clone(),
                position: variable("position"),
                velocity: Some(variable("velocity")),
                effort: Some(variable("torque")),
                limits: [link.limits.low, link.limits.high],
            }
        });
        Self {
            hand: hand.clone(),
            joints: joints.collect(),
            fingers,
            ball: Vec::new(),
        }
    }

    /// Adds a ball to the view. The position and size of the ball are the variables of `ball`. The forces of its
    /// contacts are the variables `FINGER.touch`, such as `index.touch`, of fingers that have sensors.
    #[must_use]
    pub fn with_ball(mut self, ball: &Ball<'_>) -> Self {
        let [x, y, z] = ball.center;
        let of_ball = [x, y, z, ball.radius_m, ball.touching];
        let fingers = self.hand.fingers.iter();
        let touch = fingers.map(|finger| format!("{}.touch", finger.name));
        self.ball = of_ball
            .map(str::to_owned)
            .into_iter()
            .chain(touch)
            .collect();
        self
    }

    /// Iterates over the fingers, each with the poses of its links in the palm.
    pub(crate) fn posed(&self, positions: &[f64]) -> impl Iterator<Item = (&Finger, Vec<Pose>)> {
        let mut positions = finite(positions);
        self.fingers.iter().map(move |finger| {
            let own: Vec<f64> = positions.by_ref().take(finger.joints().count()).collect();
            (finger, finger.poses(&own))
        })
    }
}

impl<const FINGERS: usize, const JOINTS: usize, const ACTUATORS: usize> Robot
    for HandView<FINGERS, JOINTS, ACTUATORS>
{
    fn joints(&self) -> &[RobotJoint] {
        &self.joints
    }

    fn lines(&self, positions: &[f64]) -> Vec<RobotLine> {
        let bases = self.fingers.iter().map(|it| it.base.position.into());
        let palm = [[0.0; 3]].into_iter().chain(bases).chain([[0.0; 3]]);
        let thickest = self
            .fingers
            .iter()
            .map(Finger::radius_m)
            .fold(0.0, f64::max);
        let mut lines = vec![RobotLine {
            name: PALM.into(),
            points: palm.collect(),
            radius_m: thickest,
            effort: None,
        }];
        let mut tendons = Vec::new();
        for (finger, poses) in self.posed(positions) {
            lines.push(RobotLine {
                name: finger.name.clone(),
                points: points(finger, &poses, finger.tip_link),
                radius_m: finger.radius_m(),
                effort: None,
            });
            for (place, link) in finger.links.iter().enumerate() {
                if place != finger.tip_link && finger.is_end(place) {
                    lines.push(RobotLine {
                        name: link.name.clone(),
                        points: points(finger, &poses, place),
                        radius_m: finger.radius_m(),
                        effort: None,
                    });
                }
            }
            for tendon in &finger.tendons {
                tendons.push(RobotLine {
                    name: tendon.name.clone(),
                    points: tendon::points(tendon, finger, &poses),
                    radius_m: 0.0,
                    effort: Some(format!("{}.effort", tendon.name)),
                });
            }
        }
        lines.append(&mut tendons);
        lines
    }

    fn frames(&self, positions: &[f64]) -> Vec<Frame> {
        let mut positions = finite(positions);
        let mut frames = Vec::new();
        for finger in &self.fingers {
            let own: Vec<f64> = positions.by_ref().take(finger.joints().count()).collect();
            for (link, position) in finger.links.iter().zip(finger.positions(&own)) {
                let (parent, pose) = finger.placed(link.carrier, &link.moved(position), PALM);
                frames.push(frame(&link.frame_name(), &parent, &pose));
            }
            let tip = Pose::at(finger.tip.x, finger.tip.y, finger.tip.z);
            let (parent, tip) = finger.placed(Some(finger.tip_link), &tip, PALM);
            frames.push(frame(&finger.tip_name(), &parent, &tip));
        }
        frames
    }

    fn observed(&self) -> &[String] {
        &self.ball
    }

    fn objects(&self, positions: &[f64], observed: &[f64]) -> Vec<RobotObject> {
        let Some((&[x, y, z, radius_m, touching], forces)) = observed.split_first_chunk() else {
            return Vec::new();
        };
        let center = Vector3::new(x, y, z);
        if !(center.norm() + radius_m).is_finite() {
            return Vec::new();
        }
        let fingers = self.posed(positions).enumerate();
        let touching = fingers.filter(|(number, _)| has_bit(touching, *number));
        let contacts = touching.filter_map(|(number, (finger, poses))| {
            let tip = poses.get(finger.tip_link)?.transform(&finger.tip);
            let out = (tip - center).try_normalize(0.0)?;
            let force_n = forces.get(number).copied();
            Some(RobotContact {
                name: finger.name.clone(),
                point: (center + out * radius_m).into(),
                normal: out.into(),
                force_n: force_n.filter(|it| it.is_finite()),
            })
        });
        vec![RobotObject {
            name: BALL.into(),
            center: center.into(),
            radius_m,
            contacts: contacts.collect(),
        }]
    }

    fn urdf(&self) -> Option<String> {
        Some(urdf::write(&self.hand.name, PALM, &self.fingers))
    }

    fn simulator(&self) -> Option<&dyn Simulator> {
        Some(self)
    }
}

/// Returns the points of the line from the base of a finger along its links to the end of one of them, m.
fn points(finger: &Finger, poses: &[Pose], end: usize) -> Vec<[f64; 3]> {
    let mut points = vec![finger.base.position];
    let way = finger.way(end).into_iter();
    points.extend(way.filter_map(|link| Some(poses.get(link)?.position)));
    points.extend(
        poses
            .get(end)
            .map(|pose| pose.transform(&finger.along(end))),
    );
    points.into_iter().map(Into::into).collect()
}

/// The positions, as far as they are numbers; then 0 without end.
pub(crate) fn finite(positions: &[f64]) -> impl Iterator<Item = f64> {
    let finite = positions
        .iter()
        .map(|it| if it.is_finite() { *it } else { 0.0 });
    finite.chain(core::iter::repeat(0.0))
}

fn frame(name: &str, parent: &str, pose: &Pose) -> Frame {
    let rotation = Rotation3::from_matrix_unchecked(pose.rotation);
    let rotation = UnitQuaternion::from_rotation_matrix(&rotation);
    Frame {
        name: name.into(),
        parent: parent.into(),
        translation: pose.position.into(),
        rotation: rotation.coords.into(),
    }
}

/// Returns true if a bit of a whole number is set.
fn has_bit(number: f64, bit: usize) -> bool {
    // The cast saturates, and NaN becomes 0.
    #[expect(clippy::cast_sign_loss, reason = "less than 0 has no bits")]
    let word = number as u64;
    u32::try_from(bit).is_ok_and(|bit| word.checked_shr(bit).unwrap_or(0) & 1 != 0)
}
