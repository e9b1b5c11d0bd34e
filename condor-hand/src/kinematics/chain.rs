use nalgebra::{Matrix3, SVector, Vector3};

use super::check;
use crate::number::{NumberError, Requirement, check as check_number, count, finite, not_negative};
use crate::{Pose, Subject};

/// The motion by which a joint moves its link relative to the link before it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ChainMotion {
    /// The link rotates about this unit axis, rad.
    Revolute(Vector3<f64>),
    /// The link slides along this unit axis, m.
    Prismatic(Vector3<f64>),
    /// The link does not move: it stands for a joint that this mechanism does not have. Its column
    /// of a Jacobian is zero.
    Fixed,
}

/// A joint of a [`Chain`]: its place on the link that carries it, and its motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChainJoint {
    /// The frame of the link at the joint's zero, in the frame of the link that carries it.
    pub placement: Pose,
    /// Its motion from there; the axis is in the frame of the link.
    pub motion: ChainMotion,
    /// The link that carries it.
    pub on: Carrier,
    /// The joint that it follows; `None` if it moves by itself.
    pub follows: Option<Following>,
}

/// The link that carries a joint of a [`Chain`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Carrier {
    /// The link of the joint before it, or the base for the first joint.
    Previous,
    /// The base of the mechanism.
    Base,
    /// The link of the joint of this number, from 0, which comes before it.
    Joint(usize),
}

/// The movement of a joint with another one: its position is `ratio` times that of the other joint, plus `offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Following {
    /// The number of the joint that it follows, from 0. That joint moves by itself.
    pub joint: usize,
    /// The change of its position for a unit of the other's, rad or m for rad or m.
    pub ratio: f64,
    /// Its position where the other is at zero, rad or m.
    pub offset: f64,
}

impl ChainJoint {
    /// Returns a joint on the link before it that moves by itself.
    #[must_use]
    pub const fn new(placement: Pose, motion: ChainMotion) -> Self {
        Self {
            placement,
            motion,
            on: Carrier::Previous,
            follows: None,
        }
    }

    /// Checks that this joint, number `number` of `joints`, can be on its link, and follow the joint that it follows.
    fn check(&self, number: usize, joints: &[Self]) -> Result<(), NumberError> {
        if let Carrier::Joint(other) = self.on {
            let what = "the number of the joint that carries it";
            check_number(what, count(other), Requirement::Below(count(number)))?;
        }
        let Some(Following {
            joint,
            ratio,
            offset,
        }) = self.follows
        else {
            return Ok(());
        };
        finite("the ratio to the joint that it follows", ratio)?;
        finite("the offset from the joint that it follows", offset)?;
        let what = "the number of the joint that it follows";
        check_number(what, count(joint), Requirement::Below(count(joints.len())))?;
        let moves = joints
            .get(joint)
            .is_some_and(|joint| joint.follows.is_none());
        let what = "the number of joints between it and one that moves by itself";
        check_number(what, f64::from(u8::from(!moves)), Requirement::Equal(0.0))
    }

    /// Returns a joint that stands for one that the mechanism does not have.
    #[must_use]
    pub fn fixed() -> Self {
        Self::new(Pose::identity(), ChainMotion::Fixed)
    }
}

/// The mass, the centre of mass and the inertia of a link of a [`Chain`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChainBody {
    /// The mass, kg.
    pub mass: f64,
    /// The centre of mass, m.
    pub center: Vector3<f64>,
    /// Inertia about the centre of mass in the axes of the link, kg m².
    pub inertia: Matrix3<f64>,
}

/// The kinematic and dynamic model of any mechanism of N joints, each of which rotates, slides or is fixed. Links may
/// branch; the tip is on one of them. Make one with [`new`](Self::new).
///
/// A position, rate or torque vector has a number for each joint that moves by itself, in their order. A joint that
/// [follows](Following) another one has none, and the numbers at the end that are left over do nothing.
///
/// ```
/// use condor_hand::Pose;
/// use condor_hand::kinematics::{Chain, ChainBody, ChainJoint, ChainMotion, Kinematics};
/// use nalgebra::Vector3;
///
/// let axis = ChainMotion::Revolute(Vector3::y());
/// let hinge = |x| ChainJoint::new(Pose::at(x, 0.0, 0.0), axis);
/// let bodies = [ChainBody::massless(); 2];
/// let arm = Chain::new(Pose::identity(), [hinge(0.0), hinge(0.3)], bodies, Vector3::x() * 0.2)?;
/// assert_eq!(arm.tip(&[0.0, 0.0].into()).position.x, 0.5);
/// # Ok::<_, condor_hand::NumberError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chain<const N: usize> {
    pub(crate) base: Pose,
    pub(crate) joints: [ChainJoint; N],
    pub(crate) bodies: [ChainBody; N],
    pub(crate) tip: Vector3<f64>,
    pub(crate) links: [ChainLink; N],
    /// The number of links without those at the end that neither move nor have a mass.
    count: usize,
}

/// The place of a link in a mechanism, and the number that moves it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ChainLink {
    /// The number of the link that carries it, which is less than its own; `None` for the base.
    pub(crate) carrier: Option<usize>,
    /// The place of its joint's number in the vectors: the position is `ratio` times that number, plus `offset`.
    pub(crate) coordinate: usize,
    pub(crate) ratio: f64,
    pub(crate) offset: f64,
    /// Between the base and the tip.
    pub(crate) carries_tip: bool,
}

impl ChainLink {
    /// Returns the position of its joint, rad or m.
    #[inline(always)]
    pub(crate) fn position<const N: usize>(&self, q: &SVector<f64, N>) -> f64 {
        self.rate(q) + self.offset
    }

    /// Returns the rate of its joint (rad/s or m/s) for those of the joints, or its acceleration.
    #[inline(always)]
    pub(crate) fn rate<const N: usize>(&self, qd: &SVector<f64, N>) -> f64 {
        let [joints] = &qd.data.0;
        self.ratio * joints.get(self.coordinate).copied().unwrap_or(0.0)
    }
}

impl<const N: usize> Chain<N> {
    /// Makes a mechanism from its parts.
    ///
    /// * `base`: the pose of the mechanism's base in the palm.
    /// * `joints`: proximal first.
    /// * `bodies`: the bodies that the joints move, [massless](ChainBody::massless) if only kinematics is needed.
    /// * `tip`: the position of the tip in the frame of the last link, m.
    ///
    /// # Errors
    /// [`NumberError`] for the first part that cannot be: an axis that is not a unit vector, a
    /// rotation that is not orthonormal and right-handed, a negative mass, an inertia that no body
    /// has, a joint on a link that comes after it, a joint that follows itself or one that follows another, or a
    /// number that is not finite. Entries may be off by 10⁻⁹.
    pub fn new(
        base: Pose,
        joints: [ChainJoint; N],
        bodies: [ChainBody; N],
        tip: Vector3<f64>,
    ) -> Result<Self, NumberError> {
        check::pose(Subject::Base, &base)?;
        for (number, joint) in joints.iter().enumerate() {
            check::pose(Subject::Placement(number as u16), &joint.placement)?;
            if let ChainMotion::Revolute(axis) | ChainMotion::Prismatic(axis) = &joint.motion {
                check::axis(number, axis)?;
            }
            let place = Subject::Joint(number as u16);
            (joint.check(number, &joints)).map_err(|error| error.at(place))?;
        }
        for (link, body) in bodies.iter().enumerate() {
            body.check(link)?;
        }
        check::position(Subject::Tip, &tip)?;
        Ok(Self::of(base, joints, bodies, (N.saturating_sub(1), tip)))
    }

    /// Makes a mechanism from parts that are right, with the number of the link that has the tip.
    pub(crate) fn of(
        base: Pose,
        joints: [ChainJoint; N],
        bodies: [ChainBody; N],
        (tip_link, tip): (usize, Vector3<f64>),
    ) -> Self {
        let mut all = joints.iter().zip(&bodies);
        let counts = |(joint, body): (&ChainJoint, &ChainBody)| {
            joint.motion != ChainMotion::Fixed || *body != ChainBody::massless()
        };
        let mut chain = Self {
            base,
            joints,
            bodies,
            tip,
            links: links(&joints),
            count: all.rposition(counts).map_or(0, |last| last + 1),
        };
        chain.carry(tip_link);
        chain
    }

    /// Returns the number of links without those at the end that neither move nor have a mass: they add nothing to
    /// torques.
    #[inline(always)]
    pub(crate) fn count(&self) -> usize {
        self.count.min(N)
    }

    /// Marks the links between the base and the link that has the tip.
    fn carry(&mut self, tip_link: usize) {
        let mut next = Some(tip_link);
        for (number, link) in self.links.iter_mut().enumerate().rev() {
            link.carries_tip = next == Some(number);
            if link.carries_tip {
                next = link.carrier;
            }
        }
    }

    /// Returns the same mechanism with its tip on the link of joint number `joint` (from 0): at `tip`, m, in the frame
    /// of that link.
    ///
    /// # Errors
    /// [`NumberError`] if the mechanism does not have the joint, or if a coordinate of the tip is not finite.
    pub fn with_tip(mut self, joint: usize, tip: Vector3<f64>) -> Result<Self, NumberError> {
        let must = Requirement::Below(count(N));
        check_number(
            "the number of the joint that moves the tip",
            count(joint),
            must,
        )
        .map_err(|error| error.at(Subject::Tip))?;
        check::position(Subject::Tip, &tip)?;
        self.tip = tip;
        self.carry(joint);
        Ok(self)
    }

    /// Returns the pose of the mechanism's base in the frame of the palm.
    #[must_use]
    pub const fn base(&self) -> &Pose {
        &self.base
    }

    /// Returns the joints of the mechanism, proximal first.
    #[must_use]
    pub const fn joints(&self) -> &[ChainJoint; N] {
        &self.joints
    }

    /// Returns the bodies of the links; body *i* is moved by joint *i*.
    #[must_use]
    pub const fn bodies(&self) -> &[ChainBody; N] {
        &self.bodies
    }

    /// Returns the position of the tip in the frame of the last link, m.
    #[must_use]
    pub const fn tip_point(&self) -> &Vector3<f64> {
        &self.tip
    }

    /// Returns the same mechanism with the origin of the link of joint number `joint` (from 0) as its tip: the base if
    /// there is no such joint.
    #[must_use]
    pub fn up_to(&self, joint: usize) -> Self {
        let mut part = *self;
        part.tip = Vector3::zeros();
        part.carry(joint);
        part
    }

    /// Returns true for each place in a vector whose number moves one of these links.
    pub(crate) fn moving(&self, is_meant: impl Fn(&ChainLink) -> bool) -> [bool; N] {
        let mut moving = [false; N];
        for (link, joint) in self.links.iter().zip(&self.joints) {
            if let Some(moves) = moving.get_mut(link.coordinate) {
                *moves |= is_meant(link) && joint.motion != ChainMotion::Fixed;
            }
        }
        moving
    }

    /// Returns the positions of all joints (rad or m), also of those that follow others.
    #[must_use]
    pub fn positions(&self, q: &SVector<f64, N>) -> [f64; N] {
        self.links.map(|link| link.position(q))
    }
}

/// The links of joints. A joint whose parts do not fit is on the link before it, and does not move.
fn links<const N: usize>(joints: &[ChainJoint; N]) -> [ChainLink; N] {
    let mut coordinates = [N; N];
    let mut next = 0;
    for (coordinate, joint) in coordinates.iter_mut().zip(joints) {
        if joint.follows.is_none() {
            *coordinate = next;
            next += 1;
        }
    }
    core::array::from_fn(|number| {
        let joint = joints.get(number);
        let previous = number.checked_sub(1);
        let carrier = match joint.map(|joint| joint.on) {
            Some(Carrier::Base) => None,
            Some(Carrier::Joint(other)) if other < number => Some(other),
            _ => previous,
        };
        let moves_with = |number: usize| coordinates.get(number).copied().unwrap_or(N);
        let (coordinate, ratio, offset) = match joint.and_then(|joint| joint.follows) {
            Some(it) => (moves_with(it.joint), it.ratio, it.offset),
            None => (moves_with(number), 1.0, 0.0),
        };
        ChainLink {
            carrier,
            coordinate,
            ratio,
            offset,
            carries_tip: false,
        }
    })
}

impl ChainBody {
    /// Returns a body with zero mass and zero inertia, for a chain of which only the kinematics is
    /// used.
    #[must_use]
    pub fn massless() -> Self {
        Self {
            mass: 0.0,
            center: Vector3::zeros(),
            inertia: Matrix3::zeros(),
        }
    }

    /// Checks that link `link` can be this body.
    pub(super) fn check(&self, link: usize) -> Result<(), NumberError> {
        let part = Subject::Link(link as u16);
        not_negative("the mass, kg,", self.mass).map_err(|error| error.at(part))?;
        check::position(part, &self.center)?;
        check::inertia(link, &self.inertia)
    }
}
