//! A grasp: what the master orders, what the servo processors tell of it, and the law on them.
//!
//! The stiffness of a held object is a law of all its fingers, which one to four processors serve. It is
//! computed for each finger by itself, in the servo loop of its processor: with the joints of this finger
//! as they have just been measured, and those of all others as they were [published](Joints) in the tick
//! before, also if they are on the same processor. The torques of this finger are then used. So no torque
//! waits for a message, the rate of the law is that of the servos, and it makes no difference which
//! processor serves which finger.
//!
//! The master writes the same [`Order`] for each servo processor, by an [`OrderWriter`] in the object
//! named [`NAME`] of its object table. It says which fingers, where their tips are to be, and with which
//! stiffness; [`tips`] computes the present ones. On entry a finger takes the tips that there are
//! as the desired ones, so nothing jumps, and passes in `ramp_s` to what was ordered, squeeze and
//! feed-forward included; later orders for the same fingers ramp from what is in force. Letting go
//! leaves the joints in position mode where they are.
//!
//! A finger leaves a grasp by itself, its joints holding their positions, if another one leaves or its
//! processor falls silent, if it has a fault, if somebody gives its joints another mode, or if the law
//! has no answer. The [`Report`] of its processor tells why. A master that dies is no reason.

use condor_hand::grasp::{
    Friction, GraspError, GraspTuning, Posture, SpatialGain, Squeeze, Surface, TorqueLimits, Wrench,
};
use condor_hand::kinematics::Kinematics;
use condor_mbox::published::{Publisher, Subscriber};
use condor_mbox::{AccessError, MemoryWindow, Places, Published, Region};
use condor_vars::{Described, Field, Kind};
use core::mem::offset_of;
use nalgebra::{Matrix6, Vector3, Vector4};
use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::{FINGERS, JOINTS, UtahMit};

mod end;
mod law;
mod partner;

pub(crate) use end::{GraspEnd, Told};
pub(crate) use law::{Felt, Grasp, Own};
pub(crate) use partner::{Due, Heard, Partner};

/// The name of [`GraspPlaces`] in the object table of a servo processor.
pub const NAME: &str = "grasp";
/// The name of the [`Joints`] in the object table of a servo processor.
pub const JOINTS_NAME: &str = "joints";

/// The fewest fingers that give an object a stiffness.
pub const LEAST_FINGERS: u32 = 3;

/// The joints that a servo processor measures, published in every tick: a `Published<Joints>`.
///
/// Fingers are those of the hand; what is of a finger that the processor does not serve does not count.
#[derive(Clone, Copy, Debug, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct Joints {
    /// As measured in this tick, rad; NaN for what no sensor said.
    pub position: [[f64; JOINTS]; FINGERS],
    /// Filtered, of the tick before, rad/s.
    pub velocity: [[f64; JOINTS]; FINGERS],
    /// The number of the grasp order in force for each finger; 0 for none.
    pub order: [u64; FINGERS],
    /// A bit for each finger that the processor serves.
    pub served: u64,
    /// When the tick was due, ns of the processor's clock.
    pub due_ns: u64,
    /// Ticks of the servo loop.
    pub ticks: u64,
}

impl Described for Joints {
    const FIELDS: &'static [Field] = &[
        Field::new("position", "rad", Kind::F64, offset_of!(Joints, position))
            .repeated(FINGERS * JOINTS)
            .about("As measured; joints in the order of the fingers."),
        Field::new("velocity", "rad/s", Kind::F64, offset_of!(Joints, velocity))
            .repeated(FINGERS * JOINTS)
            .about("Filtered."),
        Field::new("order", "", Kind::U64, offset_of!(Joints, order))
            .repeated(FINGERS)
            .about("The grasp order in force for each finger; 0 for none."),
        Field::new("served", "", Kind::U64, offset_of!(Joints, served))
            .about("A bit for each finger of this processor; others do not count."),
        Field::new("due_ns", "ns", Kind::U64, offset_of!(Joints, due_ns)),
        Field::new("ticks", "", Kind::U64, offset_of!(Joints, ticks)),
    ];
}

impl Joints {
    /// Adds the fingers of another processor.
    pub(crate) fn add(&mut self, other: &Self) {
        let all = self.position.iter_mut().zip(&mut self.velocity);
        let all = all.zip(&mut self.order);
        let others = other.position.iter().zip(&other.velocity);
        let others = others.zip(&other.order);
        for (finger, (((position, velocity), order), from)) in all.zip(others).enumerate() {
            if other.serves(finger) {
                ((*position, *velocity), *order) = ((*from.0.0, *from.0.1), *from.1);
            }
        }
        self.served |= other.served;
    }

    pub(crate) const fn serves(&self, finger: usize) -> bool {
        finger < FINGERS && self.served >> finger & 1 != 0
    }
}

impl Due for Joints {
    fn due_ns(&self) -> u64 {
        self.due_ns
    }
}

/// What a grasp is to be. All vectors are in the axes of the palm.
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct Order {
    /// A bit for each finger of the configuration that holds; 0 to let go.
    pub fingers: u64,
    /// How the object resists displacement, about the centre: N/m, N/rad, N m/m, N m/rad.
    pub stiffness: [[f64; 6]; 6],
    /// How it resists motion, about the centre; the same times s.
    pub damping: [[f64; 6]; 6],
    /// The point that stiffness and wrenches are about, the middle of the object, m.
    pub center: [f64; 3],
    /// Exerted on the object beside that: what bears its weight, N.
    pub force: [f64; 3],
    /// The same about the centre, N m.
    pub moment: [f64; 3],
    /// Where the tips are to be, m; of fingers that do not hold, anything.
    pub tips: [[f64; 3]; FINGERS],
    /// The force between each pair of tips, N.
    pub squeeze_n: f64,
    /// What keeps the posture of a finger along its self-motion, N m/rad.
    pub posture_stiffness: f64,
    /// The same against its rates, N m s/rad.
    pub posture_damping: f64,
    /// The coefficient of friction by which the margins are judged.
    pub friction: f64,
    /// The time in which squeeze, feed-forward and tips become what is ordered, s.
    pub ramp_s: f64,
}

impl Order {
    /// No grasp.
    pub const RELEASE: Self = Self {
        fingers: 0,
        stiffness: [[0.0; 6]; 6],
        damping: [[0.0; 6]; 6],
        center: [0.0; 3],
        force: [0.0; 3],
        moment: [0.0; 3],
        tips: [[0.0; 3]; FINGERS],
        squeeze_n: 0.0,
        posture_stiffness: 0.0,
        posture_damping: 0.0,
        friction: 0.5,
        ramp_s: 0.0,
    };

    /// A grasp of these fingers (a bit each) with their tips where `tips` says, about their middle,
    /// with the gains along and about the axes on the diagonals, N/m and N m/rad, N s/m and N m s/rad.
    #[must_use]
    pub fn hold(
        fingers: u64,
        tips: [[f64; 3]; FINGERS],
        stiffness: [f64; 6],
        damping: [f64; 6],
    ) -> Self {
        let mut center = Vector3::zeros();
        let mut count = 0.0;
        for (finger, tip) in tips.iter().enumerate() {
            if fingers >> finger & 1 != 0 {
                center += Vector3::from(*tip);
                count += 1.0;
            }
        }
        if count > 0.0 {
            center /= count;
        }
        Self {
            fingers,
            stiffness: diagonal(stiffness),
            damping: diagonal(damping),
            center: center.into(),
            tips,
            squeeze_n: 1.5,
            posture_stiffness: 0.1,
            posture_damping: 2e-3,
            ramp_s: 1.0,
            ..Self::RELEASE
        }
    }

    /// What the law makes of it, with a part of the squeeze and of the feed-forward.
    fn tuning<const M: usize>(
        &self,
        limits: [TorqueLimits<f64, JOINTS>; M],
    ) -> Result<GraspTuning<f64, M, JOINTS>, GraspError> {
        let center = Vector3::from(self.center);
        Ok(GraspTuning {
            stiffness: SpatialGain::new(&matrix(&self.stiffness))?,
            damping: SpatialGain::new(&matrix(&self.damping))?,
            center,
            feed_forward: Wrench {
                force: Vector3::from(self.force),
                moment: Vector3::from(self.moment),
            },
            squeeze: Squeeze::equal(self.squeeze_n)?,
            surface: Surface::Ball(center),
            friction: Friction::point(self.friction)?,
            posture: Posture {
                stiffness: self.posture_stiffness,
                damping: self.posture_damping,
            },
            limits,
        })
    }

    /// Between two orders for the same fingers, all but squeeze, feed-forward and tips those of this.
    fn after(&self, from: &Self, part: f64) -> Self {
        let mix = |from: f64, to: f64| from + (to - from) * part;
        let vector = |from: &[f64; 3], to: &[f64; 3]| {
            let mut mixed = *to;
            for (mixed, from) in mixed.iter_mut().zip(from) {
                *mixed = mix(*from, *mixed);
            }
            mixed
        };
        let mut tips = self.tips;
        for (tip, from) in tips.iter_mut().zip(&from.tips) {
            *tip = vector(from, tip);
        }
        Self {
            force: vector(&from.force, &self.force),
            moment: vector(&from.moment, &self.moment),
            squeeze_n: mix(from.squeeze_n, self.squeeze_n),
            tips,
            ..*self
        }
    }
}

fn diagonal(gains: [f64; 6]) -> [[f64; 6]; 6] {
    let mut rows = [[0.0; 6]; 6];
    for (number, (row, gain)) in rows.iter_mut().zip(gains).enumerate() {
        if let Some(place) = row.get_mut(number) {
            *place = gain;
        }
    }
    rows
}

fn matrix(rows: &[[f64; 6]; 6]) -> Matrix6<f64> {
    // Its columns are the rows.
    Matrix6::from(*rows).transpose()
}

/// What a processor does about a grasp.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u64)]
#[non_exhaustive]
pub enum GraspState {
    /// Nothing.
    Idle = 0,
    /// It waits for the processors of other fingers.
    Waiting = 1,
    /// The law is in force.
    Holding = 2,
    /// The order cannot be.
    Refused = 3,
    /// It has left the grasp by itself.
    Left = 4,
}

/// Why a grasp was refused or left.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u64)]
#[non_exhaustive]
pub enum Reason {
    /// It was not.
    None = 0,
    /// The order names fewer than three fingers, or one that there is not.
    Fingers = 1,
    /// A number of the order is not finite, or a gain, limit or coefficient that none can be.
    Tuning = 2,
    /// The tips lie on a line, or the law has no answer for another reason.
    Law = 3,
    /// Another finger has left the grasp, or its processor publishes no joints.
    Partner = 4,
    /// A finger has a fault.
    Fault = 5,
    /// Somebody gave a joint another mode.
    Switched = 6,
}

impl Reason {
    /// In words.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::None => "no reason",
            Self::Fingers => "a grasp has three fingers or more that the hand has",
            Self::Tuning => "a number that no grasp can have",
            Self::Law => "the tips determine no motion of the object",
            Self::Partner => "another finger does not take part",
            Self::Fault => "a finger has a fault",
            Self::Switched => "a joint was given another mode",
        }
    }
}

/// What a processor tells of a grasp, published whenever it changes and every 16th tick.
#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
pub struct Report {
    /// The number of the order that it is about.
    pub order: u64,
    state: u64,
    reason: u64,
    /// How much of the squeeze the joints can bear, 0 to 1.
    pub squeeze_share: f64,
    /// What would take the object to where it is desired: m, and rad about the axes.
    pub deviation: [f64; 6],
    /// How far each finger is from slipping, N.
    pub margins: [f64; FINGERS],
}

impl Report {
    const NOTHING: Self = Self::new(0, GraspState::Idle, Reason::None);

    const fn new(order: u64, state: GraspState, reason: Reason) -> Self {
        Self {
            order,
            state: state as u64,
            reason: reason as u64,
            squeeze_share: 0.0,
            deviation: [0.0; 6],
            margins: [0.0; FINGERS],
        }
    }

    /// The one of two that tells more: the end of a grasp before its course, and a cause before what it
    /// leads to.
    const fn or(self, other: Self) -> Self {
        if other.weight() > self.weight() {
            other
        } else {
            self
        }
    }

    const fn weight(&self) -> u32 {
        match (self.state(), self.reason()) {
            (GraspState::Idle, _) => 0,
            (GraspState::Holding, _) => 1,
            (GraspState::Waiting, _) => 2,
            (_, Reason::Partner) => 3,
            _ => 4,
        }
    }

    pub(crate) const fn news(&self) -> (u64, GraspState, Reason) {
        (self.order, self.state(), self.reason())
    }

    /// What it does.
    #[must_use]
    pub const fn state(&self) -> GraspState {
        match self.state {
            1 => GraspState::Waiting,
            2 => GraspState::Holding,
            3 => GraspState::Refused,
            4 => GraspState::Left,
            _ => GraspState::Idle,
        }
    }

    /// Why it was refused or left.
    #[must_use]
    pub const fn reason(&self) -> Reason {
        match self.reason {
            1 => Reason::Fingers,
            2 => Reason::Tuning,
            3 => Reason::Law,
            4 => Reason::Partner,
            5 => Reason::Fault,
            6 => Reason::Switched,
            _ => Reason::None,
        }
    }
}

/// Where orders and reports lie in the window of a servo processor.
#[derive(Clone, Copy, Debug)]
pub struct GraspPlaces {
    /// The number of the latest order; stored after the order.
    number: u32,
    order: Published<Order>,
    report: Published<Report>,
}

const NUMBER_BYTES: u32 = 64;

impl GraspPlaces {
    /// Bytes of the object.
    pub const BYTES: u32 = NUMBER_BYTES + Published::<Order>::BYTES + Published::<Report>::BYTES;

    /// The next of `places`.
    ///
    /// # Errors
    /// `OutOfBounds` if there is no room.
    pub const fn new(places: &mut Places) -> Result<Self, AccessError> {
        match places.bytes(Self::BYTES as usize) {
            Ok(offset) => Ok(Self::at(offset)),
            Err(error) => Err(error),
        }
    }

    /// The object at an offset in the users' region of its processor's `data`, as the object table says.
    #[must_use]
    pub const fn at(offset: u32) -> Self {
        let order = offset.wrapping_add(NUMBER_BYTES);
        Self {
            number: offset,
            order: Published::at(order),
            report: Published::at(order.wrapping_add(Published::<Order>::BYTES)),
        }
    }

    /// Where it begins, in bytes.
    #[must_use]
    pub const fn offset(&self) -> u32 {
        self.number
    }

    /// The master's end; there must be only one at a time.
    ///
    /// # Errors
    /// As [`Published::publisher`].
    pub fn orders<W: MemoryWindow + Clone>(
        &self,
        region: &Region<W>,
    ) -> Result<OrderWriter<W>, AccessError> {
        Ok(OrderWriter {
            region: region.clone(),
            number: self.number,
            publisher: self.order.publisher(region.clone())?,
        })
    }

    /// What the processor tells.
    ///
    /// # Errors
    /// As [`Published::subscriber`].
    pub fn reports<W: MemoryWindow + Clone>(
        &self,
        region: &Region<W>,
    ) -> Result<Subscriber<Report, Region<W>>, AccessError> {
        self.report.subscriber(region.clone())
    }
}

/// The master's end of the grasp on one processor.
#[derive(Debug)]
pub struct OrderWriter<W> {
    region: Region<W>,
    number: u32,
    publisher: Publisher<Order, Region<W>>,
}

impl<W: MemoryWindow> OrderWriter<W> {
    /// Gives an order, and its number, which reports about it have.
    ///
    /// # Errors
    /// As [`Publisher::publish`].
    pub fn give(&mut self, order: &Order) -> Result<u64, AccessError> {
        let number = self.publisher.publish(order)?;
        self.region.set_word(self.number, number)?;
        Ok(number.into())
    }
}

/// The tips of all fingers with their joints here (rad), m in the axes of the palm; `None` for a hand
/// whose fingers are not planar ones of four joints.
#[must_use]
pub fn tips(hand: &UtahMit, joints: &[[f64; JOINTS]; FINGERS]) -> Option<[[f64; 3]; FINGERS]> {
    let mut tips = [[0.0; 3]; FINGERS];
    if hand.fingers.len() != FINGERS {
        return None;
    }
    for ((tip, finger), joints) in tips.iter_mut().zip(&hand.fingers).zip(joints) {
        *tip = finger
            .planar()?
            .tip(&Vector4::from(*joints))
            .position
            .into();
    }
    Some(tips)
}

/// The joints of all fingers, from what servo processors published: `published` gives that of a
/// processor. `None` while one has published nothing.
#[must_use]
pub fn joints(
    hand: &UtahMit,
    mut published: impl FnMut(u8) -> Option<Joints>,
) -> Option<[[f64; JOINTS]; FINGERS]> {
    let mut all = [[0.0; JOINTS]; FINGERS];
    for (number, (joints, finger)) in all.iter_mut().zip(&hand.fingers).enumerate() {
        *joints = *published(finger.processor()?)?.position.get(number)?;
    }
    Some(all)
}
