//! [`Finger`]: where the links of a finger are.

use condor_hand::config::{self, LinkBody, Shape};
use condor_hand::kinematics::{ChainBody, ChainMotion};
use condor_hand::{Pose, rotation_about};
use nalgebra::{Matrix3, Vector3};

/// A finger of any number of joints.
#[derive(Clone, Debug)]
pub(crate) struct Finger {
    pub(crate) name: String,
    pub(crate) base: Pose,
    /// The links, each after the one that carries it.
    pub(crate) links: Vec<Link>,
    /// The tip, in the frame of the link that has it, m.
    pub(crate) tip: Vector3<f64>,
    /// The number of the link that has the tip.
    pub(crate) tip_link: usize,
    /// The tendons: actuators that can only pull.
    pub(crate) tendons: Vec<Tendon>,
}

/// A link, with the joint that moves it.
#[derive(Clone, Debug)]
pub(crate) struct Link {
    /// The name of the joint: `FINGER.JOINT`.
    pub(crate) name: String,
    /// The number of the link that carries it; `None` for the base.
    pub(crate) carrier: Option<usize>,
    /// The frame at the joint's zero, in the frame of the link that carries it.
    pub(crate) placement: Pose,
    pub(crate) motion: ChainMotion,
    /// The joint that its joint follows; `None` if that moves by itself.
    pub(crate) follows: Option<Following>,
    pub(crate) limits: config::Limits,
    /// The largest torque or force of the joint to either side, N m or N.
    pub(crate) effort: f64,
    /// The edges of its body, if that is a cuboid, m.
    pub(crate) cuboid: Option<[f64; 3]>,
    pub(crate) body: Option<ChainBody>,
}

/// The joint that another one follows.
#[derive(Clone, Debug)]
pub(crate) struct Following {
    /// Its number in the finger, from 0.
    pub(crate) joint: usize,
    /// Its name: `FINGER.JOINT`.
    pub(crate) name: String,
    pub(crate) ratio: f64,
    pub(crate) offset: f64,
}

/// Returns the limits within which a joint follows one with these limits.
fn followed(limits: &config::Limits, follows: &config::Follows) -> config::Limits {
    let ends = [limits.low, limits.high].map(|end| follows.ratio * end + follows.offset);
    let ratio = follows.ratio.abs();
    config::Limits {
        low: ends[0].min(ends[1]),
        high: ends[0].max(ends[1]),
        velocity: ratio * limits.velocity,
        acceleration: ratio * limits.acceleration,
    }
}

impl Finger {
    pub(crate) fn new<const JOINTS: usize, const ACTUATORS: usize>(
        finger: &config::Finger<JOINTS, ACTUATORS>,
    ) -> Self {
        let chain = finger.chain();
        // Without arms that are possible, nothing moves the joints.
        let transmission = finger.transmission().ok();
        let range = |joint| transmission.map_or((0.0, 0.0), |it| it.torque_range(joint));
        let order = finger.links();
        let number = |name: &str| order.iter().position(|link| link.name == name);
        let links = order.iter().zip(chain.joints()).filter_map(|(link, at)| {
            let moves = link.follows.map_or(link.name, |follows| &follows.joint);
            let place = finger
                .joints
                .iter()
                .position(|joint| joint.name == *moves)?;
            let (least, greatest) = range(place);
            let limits = &finger.joints.get(place)?.limits;
            Some(Link {
                name: format!("{}.{}", finger.name, link.name),
                carrier: link.on.and_then(|on| number(on)),
                placement: at.placement,
                motion: at.motion,
                follows: link.follows.map(|it| Following {
                    joint: place,
                    name: format!("{}.{}", finger.name, it.joint),
                    ratio: it.ratio,
                    offset: it.offset,
                }),
                limits: link.follows.map_or(*limits, |it| followed(limits, it)),
                effort: greatest.abs().max(least.abs()),
                cuboid: link.body.and_then(|body| match body.shape {
                    Shape::Cuboid(edges) => Some(edges),
                    Shape::Inertia { .. } => None,
                }),
                body: link.body.map(LinkBody::rigid_body),
            })
        });
        let links: Vec<_> = links.collect();
        let tip_link = match &finger.form {
            config::Form::Chain { on: Some(on), .. } => number(on),
            _ => None,
        };
        Self {
            name: finger.name.to_string(),
            base: *chain.base(),
            tip: *chain.tip_point(),
            tip_link: tip_link.unwrap_or(links.len().saturating_sub(1)),
            tendons: finger
                .actuators
                .iter()
                .filter_map(|actuator| Tendon::of(finger, actuator))
                .collect(),
            links,
        }
    }

    /// Iterates over the links whose joints move by themselves, in the order of the joints.
    pub(crate) fn joints(&self) -> impl Iterator<Item = &Link> {
        self.links.iter().filter(|link| link.follows.is_none())
    }

    /// Returns the poses of all links in the palm by the positions of the joints; one that is missing counts as 0.
    pub(crate) fn poses(&self, positions: &[f64]) -> Vec<Pose> {
        let mut poses: Vec<Pose> = Vec::new();
        for (link, position) in self.links.iter().zip(self.positions(positions)) {
            let carrier = self.carrier(link, &poses);
            poses.push(carrier.then(&link.moved(position)));
        }
        poses
    }

    /// Returns the pose of what carries a link: another link, or the base.
    pub(crate) fn carrier(&self, link: &Link, poses: &[Pose]) -> Pose {
        let carrier = link.carrier.and_then(|carrier| poses.get(carrier));
        *carrier.unwrap_or(&self.base)
    }

    /// Returns the name of the frame of a link, or of the base that all fingers are on, and there a pose that is given in
    /// the frame of the link, or of the finger's base.
    pub(crate) fn placed(&self, on: Option<usize>, pose: &Pose, base: &str) -> (String, Pose) {
        match on.and_then(|on| self.links.get(on)) {
            Some(link) => (link.frame_name(), *pose),
            None => (base.to_owned(), self.base.then(pose)),
        }
    }

    /// Iterates over the positions of the joints of all links, by those that move by themselves.
    pub(crate) fn positions(&self, positions: &[f64]) -> impl Iterator<Item = f64> {
        let of = |joint: usize| positions.get(joint).copied().unwrap_or(0.0);
        let mut next = 0;
        self.links.iter().map(move |link| {
            if let Some(follows) = &link.follows {
                return follows.ratio * of(follows.joint) + follows.offset;
            }
            next += 1;
            of(next - 1)
        })
    }

    /// Returns the numbers of the links from the base to one of them.
    pub(crate) fn way(&self, link: usize) -> Vec<usize> {
        let mut way = Vec::new();
        let mut next = Some(link);
        // Each link comes after the one that carries it.
        while let Some((number, link)) = next.and_then(|next| Some((next, self.links.get(next)?))) {
            way.push(number);
            next = link.carrier;
        }
        way.reverse();
        way
    }

    /// Returns true if a link carries no other one.
    pub(crate) fn is_end(&self, link: usize) -> bool {
        self.links.iter().all(|other| other.carrier != Some(link))
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

    /// Returns the way from the origin of a link to the tip if it has that, to the first link that it carries, or twice
    /// as far as its centre of mass, in its own frame.
    pub(crate) fn along(&self, link: usize) -> Vector3<f64> {
        if link == self.tip_link {
            return self.tip;
        }
        let carried = self.links.iter().find(|other| other.carrier == Some(link));
        let body = self.links.get(link).and_then(|link| link.body);
        let center = body.map_or_else(Vector3::zeros, |body| body.center * 2.0);
        carried.map_or(center, |carried| carried.placement.position)
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

/// A tendon, with its arm at the joint of each link up to the last one that it moves.
#[derive(Clone, Debug)]
pub(crate) struct Tendon {
    /// The name of its actuator: `FINGER.ACTUATOR`.
    pub(crate) name: String,
    /// The arms, in the order of the links, m: above 0 where it pulls to positive angles.
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
        let links = finger.links();
        let mut arms: Vec<f64> = links.iter().map(|link| actuator.arm(link.name)).collect();
        let last = arms.iter().rposition(|arm| *arm != 0.0)?;
        arms.truncate(last + 1);
        let name = format!("{}.{}", finger.name, actuator.name);
        Some(Self { name, arms })
    }
}
