use condor_hand::config::Name;
use condor_hand::servo::ServoRefusal;
use condor_mbox::{Call, Exclusion, MemoryWindow, Region, StaticWindow};

use super::layout::ServoLayout;
use super::memory::{FingerMemory, JointDrive, JointMemory, JointOrder, JointOutcome, word};
use super::{Hello, OrderPart, ServoRequest, ServoResponse, ServoStatus};
use crate::packet::{self, Packet};

/// The part of a [`ServoObject`](super::ServoObject) that answers the messages of clients. It runs in the background of
/// the servo processor.
#[derive(Debug)]
pub struct ServoHandler<'o, W, X, const F: usize, const N: usize> {
    /// Its word is 1 while a request is being answered.
    desk: Region<StaticWindow<'o>>,
    fingers: &'o [FingerMemory<N>; F],
    identity: HandIdentity<F>,
    /// A bit for each finger of the hand that this processor serves.
    served: u32,
    region: Region<W>,
    places: ServoLayout<F, N>,
    exclusion: X,
}

/// The names and the servo rate with which servos answer a client's
/// [`hello`](super::ServoClient::hello).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HandIdentity<const F: usize> {
    /// The name of the hand.
    pub hand: Name,
    /// The names of its fingers.
    pub fingers: [Name; F],
    /// Servo ticks in a second, Hz.
    pub servo_hz: u32,
}

/// The reason why a request has no other response.
enum NoResponse {
    Refused(ServoRefusal),
    /// A read from the memory of the object is whole, unless a loop on another core writes too fast.
    Busy,
    Pending,
    Superseded,
}

impl From<ServoRefusal> for NoResponse {
    fn from(refusal: ServoRefusal) -> Self {
        Self::Refused(refusal)
    }
}

/// A failure to read or write memory of the object.
fn busy<E>(_: E) -> NoResponse {
    NoResponse::Busy
}

impl<const F: usize> HandIdentity<F> {
    /// Makes an identity from the names of the hand and its fingers, and the number of servo ticks
    /// per second. The end of a name for which there is no room is left out.
    #[must_use]
    pub fn new(hand: &str, fingers: [&str; F], servo_hz: u32) -> Self {
        let name = |text: &str| {
            let mut name = Name::new();
            for letter in text.chars() {
                if name.push(letter).is_err() {
                    break;
                }
            }
            name
        };
        Self {
            hand: name(hand),
            fingers: fingers.map(name),
            servo_hz,
        }
    }
}

impl<'o, W: MemoryWindow, X: Exclusion, const F: usize, const N: usize>
    ServoHandler<'o, W, X, F, N>
{
    pub(super) const fn new(
        desk: Region<StaticWindow<'o>>,
        fingers: &'o [FingerMemory<N>; F],
        identity: HandIdentity<F>,
        served: u32,
        region: Region<W>,
        places: ServoLayout<F, N>,
        exclusion: X,
    ) -> Self {
        Self {
            desk,
            fingers,
            identity,
            served,
            region,
            places,
            exclusion,
        }
    }

    /// Answers a message of a client, and returns the reply. Register a handler for the vector
    /// [`SERVO`](super::SERVO) that calls this and does nothing else.
    ///
    /// The call never waits, and its duration does not depend on what a peer wrote. If it
    /// interrupts another call, or runs beside one in another thread, it tells the sender to try
    /// again.
    pub fn answer(&self, call: &Call<'_>) -> u32 {
        packet::answer(self.places.blocks, call, &self.region, |request| {
            self.respond(&request)
        })
    }

    fn respond(&self, request: &ServoRequest) -> ServoResponse<N> {
        let desk = &self.desk;
        let mine = self.exclusion.with(|| {
            let is_free = desk.word(0) == Ok(0);
            is_free && desk.set_word(0, 1).is_ok()
        });
        if !mine {
            return ServoResponse::Busy;
        }
        let response = self.obey(request);
        // The word is there: it was written just now.
        let _ = desk.set_word(0, 0);
        response.unwrap_or_else(|none| match none {
            NoResponse::Refused(refusal) => ServoResponse::Refused(refusal),
            NoResponse::Busy => ServoResponse::Busy,
            NoResponse::Pending => ServoResponse::Pending,
            NoResponse::Superseded => ServoResponse::Superseded,
        })
    }

    fn obey(&self, request: &ServoRequest) -> Result<ServoResponse<N>, NoResponse> {
        let finger = request.finger();
        let refusal = ServoRefusal::NoFinger {
            finger,
            served: self.served,
        };
        if self.served.checked_shr(finger).unwrap_or(0) & 1 == 0 {
            return Err(refusal.into());
        }
        let (Some(memory), Some(name)) = (
            self.fingers.get(finger as usize),
            self.identity.fingers.get(finger as usize),
        ) else {
            return Err(refusal.into());
        };
        Ok(match *request {
            ServoRequest::Hello { .. } => ServoResponse::Hello(Hello {
                hand: self.identity.hand.clone(),
                finger: name.clone(),
                served: self.served,
                joints: memory.all().len() as u32,
                servo_hz: self.identity.servo_hz,
            }),
            ServoRequest::Status { .. } => {
                let mut status = memory.last_report()?;
                status.ticks = memory.word(word::TICKS)?;
                ServoResponse::Status(status)
            }
            ServoRequest::Mode { joint, mode, .. } => {
                ServoResponse::Ordered(memory.order(joint, JointDrive::Mode(mode))?)
            }
            ServoRequest::Target { joint, target, .. } => {
                ServoResponse::Ordered(memory.order(joint, JointDrive::Target(target))?)
            }
            ServoRequest::Effort {
                joint,
                actuator,
                effort,
                ..
            } => {
                let drive = JointDrive::Effort { actuator, effort };
                ServoResponse::Ordered(memory.order(Some(joint), drive)?)
            }
            ServoRequest::Restart { .. } => {
                let restarts = memory.word(word::RESTARTS)?.wrapping_add(1);
                memory.set_word(word::RESTARTS, restarts)?;
                ServoResponse::Ordered(memory.announce(memory.next_order()?)?)
            }
            ServoRequest::Outcome { part, order, .. } => {
                memory.outcome(part, order)?;
                ServoResponse::Done
            }
        })
    }
}

impl<const N: usize> FingerMemory<N> {
    fn joint(&self, joint: u32) -> Result<&JointMemory, ServoRefusal> {
        let joints = self.all();
        let joint = joint as usize;
        joints
            .get(joint)
            .ok_or(ServoRefusal::no_joint(joint, joints.len()))
    }

    /// The joints that the finger has.
    fn all(&self) -> &[JointMemory] {
        self.joints.get(..self.count).unwrap_or(&self.joints)
    }

    /// One joint, or all of them.
    fn chosen(&self, joint: Option<u32>) -> Result<&[JointMemory], ServoRefusal> {
        match joint {
            Some(joint) => self.joint(joint).map(core::slice::from_ref),
            None => Ok(self.all()),
        }
    }

    fn word(&self, word: u32) -> Result<u32, NoResponse> {
        self.words().word(word).map_err(busy)
    }

    fn set_word(&self, word: u32, value: u32) -> Result<(), NoResponse> {
        self.words().set_word(word, value).map_err(busy)
    }

    fn last_report(&self) -> Result<ServoStatus<N>, NoResponse> {
        let (cell, window) = self.report();
        let latest = cell.subscriber(window).map_err(busy)?.read();
        latest.map_err(busy)?.value.value().map_err(busy)
    }

    /// The number after the last order's; 0 is that of none.
    fn next_order(&self) -> Result<u32, NoResponse> {
        Ok(match self.word(word::ORDERS)?.wrapping_add(1) {
            0 => 1,
            number => number,
        })
    }

    /// Lets the loop see all that the order has written.
    fn announce(&self, number: u32) -> Result<u32, NoResponse> {
        self.set_word(word::ORDERS, number)?;
        Ok(number)
    }

    /// Replaces the orders of joints; returns the number of the order.
    fn order(&self, joint: Option<u32>, drive: JointDrive) -> Result<u32, NoResponse> {
        let chosen = self.chosen(joint)?;
        let number = self.next_order()?;
        for joint in chosen {
            joint.publish(&JointOrder { number, drive })?;
        }
        self.announce(number)
    }

    /// Returns the outcome of an order as an error, unless the order was done.
    fn outcome(&self, part: OrderPart, order: u32) -> Result<(), NoResponse> {
        let joints = match part {
            OrderPart::Drive(joint) => self.chosen(joint)?,
            OrderPart::Faults => &[],
        };
        let settled = self.last_report()?.settled;
        if settled.wrapping_sub(order).cast_signed() < 0 {
            return Err(NoResponse::Pending);
        }
        for joint in joints {
            let JointOutcome { number, refusal } = joint.last_outcome()?;
            if number != order {
                return Err(NoResponse::Superseded);
            }
            refusal.map_or(Ok(()), Err)?;
        }
        Ok(())
    }
}

impl JointMemory {
    fn publish(&self, order: &JointOrder) -> Result<(), NoResponse> {
        let (cell, window) = self.order();
        // One handler at a time is here: a new publisher goes on where the last one stopped.
        let mut publisher = cell.publisher(window).map_err(busy)?;
        let order = Packet::new(order).map_err(busy)?;
        publisher.publish(&order).map(|_| ()).map_err(busy)
    }

    fn last_outcome(&self) -> Result<JointOutcome, NoResponse> {
        let (cell, window) = self.outcome();
        let latest = cell.subscriber(window).map_err(busy)?.read();
        latest.map_err(busy)?.value.value().map_err(busy)
    }
}
