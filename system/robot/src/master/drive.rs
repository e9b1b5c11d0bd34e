//! [`Drive`]: the trajectory generator, and where its set-points go.

use core::cell::RefCell;

use condor_hand::config::MotionNumber;
use condor_hand::controller::GuardStop;
use condor_hand::trajectory::{
    Generator, MotionGuard, Observations, Primitive, SetPoint, StopGuard, StreamEnd,
};
use condor_mbox::layout::header;
use condor_mbox::published::Publisher;
use condor_mbox::{AccessError, LoadOrder, MemoryWindow, Region};
use condor_rt::objects;
use critical_section::Mutex;

pub(super) use crate::ALL;
use crate::desired::DesiredPositions;
use crate::grasp::{JOINTS_NAME, Joints, Partner, PartnerState};
use crate::guards::{FELT_NAME, Felt, STOPS_NAME, Stops};
use crate::joints::JointNumbers;
use crate::message::{ServoLayout, SetPoints};
use crate::numbers::NumberPlace;
use crate::{FINGERS, JOINTS};

mod stream;

use super::MotionRates;
use stream::Streaming;

/// Primitives that wait in the generator; others wait in the sequence.
const QUEUE: usize = 16;
/// After such a time without a new one, s, a measurement is none.
const SILENT_S: f64 = 0.065;

/// A motion of the hand.
pub(super) type Motion = Primitive<ALL>;

/// An incarnation of a servo processor, by which its objects are known.
pub(super) struct ServoIncarnation<W> {
    mail: W,
    data: Region<W>,
    number: u32,
    objects: usize,
}

impl<W: MemoryWindow> ServoIncarnation<W> {
    /// The present one, which is known as `incarnation`.
    pub(super) fn new(mail: W, data: Region<W>, incarnation: u32) -> Result<Self, AccessError> {
        let count = objects::all(&data)?.count();
        Ok(Self {
            mail,
            data,
            number: incarnation,
            objects: count,
        })
    }

    /// Returns true if another incarnation has begun: its program makes a new object table before anything
    /// else, and has a new number by the time that the table is as full again.
    fn is_over(&self) -> bool {
        // Acquire: the content of the table is at least as new as the incarnation.
        let incarnation = self.mail.load(header::INCARNATION, LoadOrder::Acquire);
        let count = objects::all(&self.data).map(Iterator::count);
        incarnation.ok() != Some(self.number) || count.ok() != Some(self.objects)
    }
}

/// The place for the set-points of a servo processor, of the fingers that it serves.
pub(super) struct Link<W> {
    incarnation: ServoIncarnation<W>,
    points: heapless::Vec<SetPoints<W, JOINTS>, FINGERS>,
}

impl<W: MemoryWindow + Clone> Link<W> {
    pub(super) fn new(
        incarnation: ServoIncarnation<W>,
        layout: &ServoLayout<FINGERS, JOINTS>,
    ) -> Result<Self, AccessError> {
        let region = &incarnation.data;
        let mut points = heapless::Vec::new();
        for finger in 0..FINGERS {
            // There is a place for each.
            let _ = points.push(layout.set_points(finger, region)?);
        }
        Ok(Self {
            incarnation,
            points,
        })
    }
}

/// The servo processors: at most one for each finger.
pub(super) type OfServos<T> = heapless::Vec<T, FINGERS>;

/// Which of the servo processors serves each finger.
pub(super) type FingerServos = [usize; FINGERS];

/// The values that a servo processor publishes for the master.
pub(super) struct ServoListener<W> {
    joints: Partner<W>,
    felt: Partner<W>,
    stops: Partner<W>,
}

impl<W: MemoryWindow + Clone> ServoListener<W> {
    /// Makes a listener to the processor with this region.
    pub(super) fn new(region: &Region<W>) -> Self {
        let partner = |name| Partner::new(region.clone(), name);
        Self {
            joints: partner(JOINTS_NAME),
            felt: partner(FELT_NAME),
            stops: partner(STOPS_NAME),
        }
    }

    /// Looks up the places of the values that the processor publishes.
    ///
    /// # Errors
    /// Returns [`AccessError`] if the memory cannot be accessed.
    pub(super) fn look(&self) -> Result<(), AccessError> {
        self.joints.look()?;
        self.felt.look()?;
        self.stops.look()
    }
}

/// The last values from a servo processor.
struct ServoReport {
    joints: PartnerState<Joints>,
    felt: PartnerState<Felt>,
    stops: PartnerState<Stops>,
}

impl ServoReport {
    const NOTHING: Self = Self {
        joints: PartnerState::NOTHING,
        felt: PartnerState::NOTHING,
        stops: PartnerState::NOTHING,
    };
}

/// The stop of a finger by a guard, to be reported.
type FingerStop = (usize, GuardStop);

/// The state of the loop of the trajectories.
pub(super) struct Drive<'p, W> {
    pub(super) generator: Generator<ALL, QUEUE>,
    numbers: JointNumbers,
    pub(super) links: [Option<Link<W>>; FINGERS],
    /// A bit for each finger that does not follow.
    pub(super) loose: u32,
    /// A bit for each joint that does not follow: all of a finger that does not work, and of another one
    /// those that are not in the mode of positions.
    pub(super) adrift: u32,
    /// A bit for each finger that may still follow a former incarnation of the master: it gets no set-points.
    pub(super) inherited: u32,
    /// The number of the motion that runs, 0 for none.
    pub(super) motion: u64,
    /// The positions of the fingers that are measured, rad.
    pub(super) measured: [Option<[f64; JOINTS]>; FINGERS],
    /// The stream that runs, or brakes.
    pub(super) stream: Option<Streaming>,
    /// The end of the last stream, until it is taken.
    pub(super) stream_end: Option<StreamEnd>,
    servo_indices: FingerServos,
    ears: &'p [ServoListener<W>],
    reports: [ServoReport; FINGERS],
    /// Stops that the background has not told yet.
    pub(super) stops: heapless::Deque<FingerStop, { 2 * FINGERS }>,
    publisher: Publisher<DesiredPositions, Region<W>>,
    pub(super) period_s: f64,
    ticks: u64,
}

/// A drive between handlers and the loop.
pub(super) type SharedDrive<'p, W> = Mutex<RefCell<Drive<'p, W>>>;

impl<'p, W: MemoryWindow + Clone> Drive<'p, W> {
    /// Makes the state with all fingers loose, and no links.
    pub(super) fn new(
        generator: Generator<ALL, QUEUE>,
        numbers: JointNumbers,
        servo_indices: FingerServos,
        ears: &'p [ServoListener<W>],
        publisher: Publisher<DesiredPositions, Region<W>>,
        period_s: f64,
    ) -> Self {
        Self {
            generator,
            numbers,
            links: [const { None }; FINGERS],
            loose: u32::MAX,
            adrift: u32::MAX,
            inherited: u32::MAX,
            motion: 0,
            measured: [None; FINGERS],
            stream: None,
            stream_end: None,
            servo_indices,
            ears,
            reports: [ServoReport::NOTHING; FINGERS],
            stops: heapless::Deque::new(),
            publisher,
            period_s,
            ticks: 0,
        }
    }

    /// Takes over limits of motions, if nothing moves or waits; tells whether it has.
    #[cold]
    pub(super) fn set_rates(&mut self, rates: &MotionRates<'_>) -> bool {
        if !self.generator.is_idle() || self.stream.is_some() {
            return false;
        }
        let mut velocity = 0.0;
        for (place, value) in rates.present() {
            match place {
                NumberPlace::Motion(_, _, MotionNumber::Velocity) => velocity = value,
                NumberPlace::Motion(finger, joint, MotionNumber::Acceleration) => {
                    let joint = self.numbers.number(finger.into(), joint.into());
                    // As in a description, it grows to its limit within a tick.
                    let jerk = value / self.period_s;
                    // Limits within their ranges are accepted.
                    let _ = self.generator.set_rates(joint, velocity, value, jerk);
                }
                _ => {}
            }
        }
        true
    }

    /// One tick of the trajectories.
    pub(super) fn tick(&mut self) {
        self.measure();
        let streamed = self.stream();
        self.hold_loose();
        self.take_stops();
        let mut points = self.generator.tick(&self.observed());
        if let Some((mask, streamed)) = streamed {
            for (joint, (place, point)) in points.iter_mut().zip(streamed).enumerate() {
                if mask >> joint & 1 == 1 {
                    *place = point;
                }
            }
        }
        let fingers = self.numbers.by_finger(&points, SetPoint::rest(0.0));
        let guards = self.generator.guards();
        let guards = self.numbers.by_finger(&guards, StopGuard::NONE);
        let wanted = self.servo_indices.iter().zip(fingers.iter().zip(&guards));
        for (finger, (&servo, (points, guards))) in wanted.enumerate() {
            let Some(Some(link)) = self.links.get_mut(servo) else {
                continue;
            };
            if link.incarnation.is_over() || self.inherited >> finger & 1 == 1 {
                continue;
            }
            if let Some(cell) = link.points.get_mut(finger) {
                // A servo without set-points stops by itself.
                let _ = cell.publish(points, guards);
            }
        }
        self.ticks = self.ticks.wrapping_add(1);
        // After an error the reader finds the former value.
        let _ = self.publisher.publish(&DesiredPositions {
            ticks: self.ticks,
            loose: self.loose_fingers().into(),
            motion: self.motion,
            position: fingers.map(|finger| finger.map(|point| point.position)),
            velocity: fingers.map(|finger| finger.map(|point| point.velocity)),
        });
    }

    /// Returns the fingers of the robot that do not follow, a bit for each.
    pub(super) fn loose_fingers(&self) -> u32 {
        self.loose & self.numbers.fingers(u32::MAX)
    }

    fn measure(&mut self) {
        for (ears, reports) in self.ears.iter().zip(&mut self.reports) {
            ears.joints.read(&mut reports.joints, self.period_s);
            ears.felt.read(&mut reports.felt, self.period_s);
            ears.stops.read(&mut reports.stops, self.period_s);
        }
        let fingers = self.servo_indices.iter().zip(&mut self.measured);
        for (finger, (&servo, measured)) in fingers.enumerate() {
            let reports = self.reports.get(servo).map(|reports| &reports.joints);
            let joints = reports.filter(|reports| reports.age_s <= SILENT_S);
            let position = joints
                .and_then(|reports| reports.value)
                .and_then(|joints| joints.position.get(finger).copied());
            *measured = position.filter(|joints| joints.iter().all(|joint| joint.is_finite()));
        }
    }

    /// Joints that a guard has stopped in a servo rest there.
    fn take_stops(&mut self) {
        for (finger, &servo) in self.servo_indices.iter().enumerate() {
            let reports = self.reports.get(servo);
            let Some(stops) = reports.and_then(|reports| reports.stops.value) else {
                continue;
            };
            for joint in 0..self.numbers.range(finger).len() {
                let Some(stop) = stops.of(finger, joint) else {
                    continue;
                };
                let first = self.numbers.number(finger, 0);
                let mut positions = [0.0; ALL];
                if let Some(place) = positions.get_mut(first + joint) {
                    *place = stop.position;
                }
                let guard = of_hand(stop.guard, first);
                let returning =
                    (self.generator).stopped(stop.motion, guard, 1 << (first + joint), &positions);
                let is_new = returning.is_ok_and(|joints| joints != 0);
                let is_told = (self.stops.back())
                    .is_some_and(|(of, last)| (*of, last.motion) == (finger, stop.motion));
                if is_new && !is_told {
                    // A stop is not reported if there is no room.
                    let _ = self.stops.push_back((finger, stop));
                }
            }
        }
    }

    /// Returns the observations on which motions begin; nothing of fingers that are not measured.
    fn observed(&self) -> Observations<ALL> {
        let mut observed = Observations {
            torques: [f64::NAN; ALL],
            efforts: [f64::NAN; ALL],
            contacts: 0,
        };
        for (finger, &servo) in self.servo_indices.iter().enumerate() {
            let reports = self.reports.get(servo).map(|reports| &reports.felt);
            let reports = reports.filter(|reports| reports.age_s <= SILENT_S);
            let Some(felt) = reports.and_then(|reports| reports.value) else {
                continue;
            };
            let range = self.numbers.range(finger);
            let places = (
                observed.torques.get_mut(range.clone()),
                observed.efforts.get_mut(range),
            );
            if let (Some(torques), Some(efforts)) = places
                && let (Some(torque), Some(effort)) =
                    (felt.torque.get(finger), felt.effort.get(finger))
            {
                for (place, torque) in torques.iter_mut().zip(torque) {
                    *place = *torque;
                }
                for (place, effort) in efforts.iter_mut().zip(effort) {
                    *place = *effort;
                }
            }
            if felt.contacts >> finger & 1 == 1 {
                observed.contacts |= self.numbers.mask(finger);
            }
        }
        observed
    }

    /// The set-points of joints that do not follow are where they are: nothing jumps when they do.
    pub(super) fn hold_loose(&mut self) {
        let mut mask = 0;
        let mut positions = [0.0; ALL];
        for (finger, measured) in self.measured.iter().enumerate() {
            let Some(joints) = *measured else {
                continue;
            };
            for (joint, position) in self.numbers.range(finger).zip(joints) {
                if let Some(place) = positions.get_mut(joint)
                    && self.adrift >> joint & 1 == 1
                {
                    *place = position;
                    mask |= 1 << joint;
                }
            }
        }
        // All of them are finite.
        let _ = self.generator.hold(mask, &positions);
    }
}

/// A guard of a finger's joint as one of the hand's.
const fn of_hand(guard: MotionGuard, first: usize) -> MotionGuard {
    match guard {
        MotionGuard::Torque { joint } => MotionGuard::Torque {
            joint: first + joint % JOINTS,
        },
        MotionGuard::Effort { joint } => MotionGuard::Effort {
            joint: first + joint % JOINTS,
        },
        MotionGuard::Contact { joint } => MotionGuard::Contact {
            joint: first + joint % JOINTS,
        },
        MotionGuard::Time => MotionGuard::Time,
    }
}

/// Does something with the drive; `None` if that is in progress already.
pub(super) fn with<'p, W, R>(
    shared: &SharedDrive<'p, W>,
    work: impl FnOnce(&mut Drive<'p, W>) -> R,
) -> Option<R> {
    critical_section::with(|section| {
        let mut drive = shared.borrow(section).try_borrow_mut().ok()?;
        Some(work(&mut drive))
    })
}
