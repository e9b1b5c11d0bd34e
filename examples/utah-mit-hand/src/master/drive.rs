//! [`Drive`]: the trajectory generator, and where its set-points go.

use core::cell::RefCell;

use condor_hand::message::{ServoPlaces, SetPoints};
use condor_hand::trajectory::{Generator, Observations, Primitive, SetPoint, StreamEnd};
use condor_mbox::layout::header;
use condor_mbox::published::Publisher;
use condor_mbox::{AccessError, LoadOrder, MemoryWindow, Region};
use condor_rt::objects;
use critical_section::Mutex;

use super::stream::Streaming;
use crate::grasp::{Heard, Joints, Partner};
pub(super) use crate::motions::ALL;
use crate::wanted::Wanted;
use crate::{FINGERS, JOINTS};

/// Primitives that wait in the generator; others wait in the sequence.
const QUEUE: usize = 16;
/// After such a time without a new one, s, a measurement is none.
const SILENT_S: f64 = 0.065;

/// A motion of the hand.
pub(super) type Motion = Primitive<ALL>;

/// A life of a servo processor, by which its objects are known.
pub(super) struct Life<W> {
    mail: W,
    data: Region<W>,
    number: u32,
    objects: usize,
}

impl<W: MemoryWindow> Life<W> {
    /// The present one, which is known as `life`.
    pub(super) fn new(mail: W, data: Region<W>, life: u32) -> Result<Self, AccessError> {
        let count = objects::all(&data)?.count();
        Ok(Self {
            mail,
            data,
            number: life,
            objects: count,
        })
    }

    /// Whether another has begun: its program makes a new object table before anything else, and has a
    /// new number by the time that the table is as full again.
    fn is_over(&self) -> bool {
        // Acquire: what is in the table is no older than the life.
        let life = self.mail.load(header::INCARNATION, LoadOrder::Acquire);
        let count = objects::all(&self.data).map(Iterator::count);
        life.ok() != Some(self.number) || count.ok() != Some(self.objects)
    }
}

/// Where the set-points of a servo processor go, of the fingers that it serves.
pub(super) struct Link<W> {
    life: Life<W>,
    points: [SetPoints<W, JOINTS>; FINGERS],
}

impl<W: MemoryWindow + Clone> Link<W> {
    pub(super) fn new(
        life: Life<W>,
        places: &ServoPlaces<FINGERS, JOINTS>,
    ) -> Result<Self, AccessError> {
        let region = &life.data;
        let points = |finger| places.set_points(finger, region);
        let points = [points(0)?, points(1)?, points(2)?, points(3)?];
        Ok(Self { life, points })
    }
}

/// The servo processors: at most one for each finger.
pub(super) type OfServos<T> = heapless::Vec<T, FINGERS>;

/// Which of the servo processors serves each finger.
pub(super) type Seats = [usize; FINGERS];

/// What the loop of the trajectories works on.
pub(super) struct Drive<'p, W> {
    pub(super) generator: Generator<ALL, QUEUE>,
    pub(super) links: [Option<Link<W>>; FINGERS],
    /// A bit for each finger that does not follow.
    pub(super) loose: u32,
    /// Where the fingers are, of those that are measured, rad.
    pub(super) measured: [Option<[f64; JOINTS]>; FINGERS],
    /// The stream that runs, or brakes.
    pub(super) stream: Option<Streaming>,
    /// How the last stream has ended, until that is taken.
    pub(super) stream_end: Option<StreamEnd>,
    seats: Seats,
    partners: &'p [Partner<W>],
    heard: [Heard<Joints>; FINGERS],
    publisher: Publisher<Wanted, Region<W>>,
    pub(super) period_s: f64,
    ticks: u64,
}

/// A drive between handlers and the loop.
pub(super) type Shared<'p, W> = Mutex<RefCell<Drive<'p, W>>>;

impl<'p, W: MemoryWindow + Clone> Drive<'p, W> {
    /// With all fingers loose, and no links.
    pub(super) fn new(
        generator: Generator<ALL, QUEUE>,
        seats: Seats,
        partners: &'p [Partner<W>],
        publisher: Publisher<Wanted, Region<W>>,
        period_s: f64,
    ) -> Self {
        Self {
            generator,
            links: [const { None }; FINGERS],
            loose: u32::MAX,
            measured: [None; FINGERS],
            stream: None,
            stream_end: None,
            seats,
            partners,
            heard: [Heard::NOTHING; FINGERS],
            publisher,
            period_s,
            ticks: 0,
        }
    }

    /// One tick of the trajectories.
    pub(super) fn tick(&mut self) {
        self.measure();
        let streamed = self.stream();
        self.hold_loose();
        let mut points = self.generator.tick(&Observations::none());
        if let Some((mask, streamed)) = streamed {
            for (joint, (place, point)) in points.iter_mut().zip(streamed).enumerate() {
                if mask >> joint & 1 == 1 {
                    *place = point;
                }
            }
        }
        let mut fingers = [[SetPoint::rest(0.0); JOINTS]; FINGERS];
        for (to, from) in fingers.as_flattened_mut().iter_mut().zip(points) {
            *to = from;
        }
        for (finger, (&servo, points)) in self.seats.iter().zip(&fingers).enumerate() {
            let Some(Some(link)) = self.links.get_mut(servo) else {
                continue;
            };
            if link.life.is_over() {
                continue;
            }
            if let Some(cell) = link.points.get_mut(finger) {
                // A servo without set-points stops by itself.
                let _ = cell.publish(points);
            }
        }
        self.ticks = self.ticks.wrapping_add(1);
        // Who reads finds the former one.
        let _ = self.publisher.publish(&Wanted {
            ticks: self.ticks,
            loose: u64::from(self.loose & ((1 << FINGERS) - 1)),
            position: fingers.map(|finger| finger.map(|point| point.position)),
            velocity: fingers.map(|finger| finger.map(|point| point.velocity)),
        });
    }

    fn measure(&mut self) {
        for (partner, heard) in self.partners.iter().zip(&mut self.heard) {
            partner.read(heard, self.period_s);
        }
        let fingers = self.seats.iter().zip(&mut self.measured);
        for (finger, (&servo, measured)) in fingers.enumerate() {
            let heard = self.heard.get(servo);
            let joints = heard.filter(|heard| heard.age_s <= SILENT_S);
            let position = joints
                .and_then(|heard| heard.value)
                .and_then(|joints| joints.position.get(finger).copied());
            *measured = position.filter(|joints| joints.iter().all(|joint| joint.is_finite()));
        }
    }

    /// The set-points of fingers that do not follow are where they are: nothing jumps when they do.
    pub(super) fn hold_loose(&mut self) {
        let mut mask = 0;
        let mut positions = [0.0; ALL];
        for (finger, measured) in self.measured.iter().enumerate() {
            let Some(joints) = measured.filter(|_| self.loose >> finger & 1 == 1) else {
                continue;
            };
            let first = finger * JOINTS;
            for (joint, position) in (first..).zip(joints) {
                if let Some(place) = positions.get_mut(joint) {
                    *place = position;
                    mask |= 1 << joint;
                }
            }
        }
        // All of them are finite.
        let _ = self.generator.hold(mask, &positions);
    }
}

/// Does something with the drive; `None` if that is in progress already.
pub(super) fn with<'p, W, R>(
    shared: &Shared<'p, W>,
    work: impl FnOnce(&mut Drive<'p, W>) -> R,
) -> Option<R> {
    critical_section::with(|section| {
        let mut drive = shared.borrow(section).try_borrow_mut().ok()?;
        Some(work(&mut drive))
    })
}
