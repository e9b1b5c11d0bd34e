//! [`Finger`]: where the links of a finger are.

use condor_hand::config::{self, Shape};
use condor_hand::kinematics::{ChainBody, ChainMotion};
use condor_hand::{Pose, rotation_about};
use nalgebra::{Matrix3, Vector3};

/// A finger of any number of joints.
#[derive(Clone, Debug)]
pub(crate) struct Finger {
    pub(crate) name: String,
    pub(crate) base: Pose,
    pub(crate) links: Vec<Link>,
    /// The tip, in the frame of the last link, m.
    pub(crate) tip: Vector3<f64>,
    /// The tendons: actuators that can only pull.
    pub(crate) tendons: Vec<Tendon>,
}

/// A link, with the joint that moves it.
#[derive(Clone, Debug)]
pub(crate) struct Link {
    /// The name of the joint: `FINGER.JOINT`.
    pub(crate) name: String,
    /// The frame at the joint's zero, in the frame of the link before, or of the base.
    pub(crate) placement: Pose,
    pub(crate) motion: ChainMotion,
    pub(crate) limits: config::Limits,
    /// The largest torque or force of the joint to either side, N m or N.
    pub(crate) effort: f64,
    /// The edges of its body, if that is a cuboid, m.
    pub(crate) cuboid: Option<[f64; 3]>,
    pub(crate) body: Option<ChainBody>,
}

impl Finger {
    pub(crate) fn new<const JOINTS: usize, const ACTUATORS: usize>(
        finger: &config::Finger<JOINTS, ACTUATORS>,
    ) -> Self {
        let chain = finger.chain();
        // Without arms that are possible, nothing moves the joints.
        let transmission = finger.transmission().ok();
        let range = |joint| transmission.map_or((0.0, 0.0), |it| it.torque_range(joint));
        let joints = finger.joints.iter().zip(chain.joints()).enumerate();
        let links = joints.map(|(place, (joint, at))| {
            let (least, greatest) = range(place);
            Link {
                name: format!("{}.{}", finger.name, joint.name),
                placement: at.placement,
                motion: at.motion,
                limits: joint.limits,
                effort: greatest.abs().max(least.abs()),
                cuboid: joint.body.and_then(|body| match body.shape {
                    Shape::Cuboid(edges) => Some(edges),
                    Shape::Inertia { .. } => None,
                }),
                body: joint.body.map(|body| body.rigid_body()),
            }
        });
        Self {
            name: finger.name.to_string(),
            base: *chain.base(),
            links: links.collect(),
            tip: *chain.tip_point(),
            tendons: finger
                .actuators
                .iter()
                .filter_map(|actuator| Tendon::of(finger, actuator))
                .collect(),
        }
    }

    /// Returns the poses of the links in the palm, or of the first ones if there are fewer positions
    /// than joints.
    pub(crate) fn poses(&self, positions: impl Iterator<Item = f64>) -> Vec<Pose> {
        let mut pose = self.base;
        let links = self.links.iter().zip(positions);
        let poses = links.map(|(link, position)| {
            pose = pose.then(&link.moved(position));
            pose
        });
        poses.collect()
    }

    /// Returns half of the least edge of its cuboids, m; 0 without any.
    pub(crate) fn radius_m(&self) -> f64 {
        let edges = self.links.iter().filter_map(|link| link.cuboid);
        // The first edge is as long as the link, also where that is short.
        let least = edges.map(|[_, y, z]| y.min(z)).reduce(f64::min);
        least.map_or(0.0, |least| least / 2.0)
    }

    /// Returns the name of the frame at the tip.
    pub(crate) fn tip_name(&self) -> String {
        format!("{}.tip", self.name)
    }

    /// Returns the way from the origin of a link to that of the next, or to the tip, in its own frame.
    pub(crate) fn along(&self, link: usize) -> Vector3<f64> {
        let next = self.links.get(link + 1);
        next.map_or(self.tip, |next| next.placement.position)
    }
}

impl Link {
    /// Returns the name of the link and its frame, `FINGER.JOINT_link`: in URDF no joint may have it, too.
    pub(crate) fn frame_name(&self) -> String {
        format!("{}_link", self.name)
    }

    /// Returns the frame of the link in that of the link before.
    pub(crate) fn moved(&self, position: f64) -> Pose {
        self.placement.then(&match self.motion {
            ChainMotion::Revolute(axis) => Pose {
                rotation: rotation_about(&axis, position),
                position: Vector3::zeros(),
            },
            ChainMotion::Prismatic(axis) => Pose {
                rotation: Matrix3::identity(),
                position: axis * position,
            },
            ChainMotion::Fixed => Pose::identity(),
        })
    }
}

/// A tendon, with its arm at each joint of the finger up to the last one that it moves.
#[derive(Clone, Debug)]
pub(crate) struct Tendon {
    /// The name of its actuator: `FINGER.ACTUATOR`.
    pub(crate) name: String,
    /// The arms, proximal first, m: above 0 where it pulls to positive angles.
    pub(crate) arms: Vec<f64>,
}

impl Tendon {
    /// Returns the tendon of an actuator; `None` for one that can push, or that moves nothing.
    fn of<const JOINTS: usize, const ACTUATORS: usize>(
        finger: &config::Finger<JOINTS, ACTUATORS>,
        actuator: &config::Actuator<JOINTS>,
    ) -> Option<Self> {
        if actuator.limits.low < 0.0 {
            return None;
        }
        let joints = finger.joints.iter();
        let mut arms: Vec<f64> = joints.map(|joint| actuator.arm(&joint.name)).collect();
        let last = arms.iter().rposition(|arm| *arm != 0.0)?;
        arms.truncate(last + 1);
        let name = format!("{}.{}", finger.name, actuator.name);
        Some(Self { name, arms })
    }
}
