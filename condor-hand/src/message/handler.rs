use condor_mbox::{Call, Exclusion, MemoryWindow, Region, StaticWindow};

use super::layout::ServoLayout;
use super::memory::{FingerMemory, JointMemory, Order, Outcome, kind, word};
use super::values::{put_target, take_target};
use super::words::{WordReader, WordWriter};
use super::{ALL_JOINTS, Part, Request, Response, ServoOperation, VERSION, state};
use crate::config::ShortName;
use crate::servo::{ServoMode, ServoRefusal, no_joint};

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
    pub hand: ShortName,
    /// The names of its fingers.
    pub fingers: [ShortName; F],
    /// Servo ticks in a second, Hz.
    pub servo_hz: u32,
}

/// The reason why a response has no other content.
enum EmptyResponse {
    Refused(ServoRefusal),
    State(u32),
}

impl From<ServoRefusal> for EmptyResponse {
    fn from(refusal: ServoRefusal) -> Self {
        Self::Refused(refusal)
    }
}

/// A read from the memory of the object is whole, unless a loop on another core writes too fast.
const BUSY: EmptyResponse = EmptyResponse::State(state::BUSY);

impl<const F: usize> HandIdentity<F> {
    /// Makes an identity from the names of the hand and its fingers, and the number of servo ticks
    /// per second. Only the first 15 bytes of a name are kept.
    #[must_use]
    pub fn new(hand: &str, fingers: [&str; F], servo_hz: u32) -> Self {
        let name = |text: &str| {
            let mut name = ShortName::new();
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
        let blocks = self.places.blocks;
        blocks.answer(call, &self.region, |request| self.respond(&request))
    }

    fn respond(&self, request: &Request) -> Response {
        let mut response = Response::default();
        let desk = &self.desk;
        let mine = self.exclusion.with(|| {
            let is_free = desk.word(0) == Ok(0);
            is_free && desk.set_word(0, 1).is_ok()
        });
        let outcome = if mine {
            self.obey(request, &mut response)
        } else {
            Err(BUSY)
        };
        if mine {
            // The word is there: it was written just now.
            let _ = desk.set_word(0, 0);
        }
        match outcome {
            Ok(()) => {}
            Err(EmptyResponse::State(state)) => response = state_only(state),
            Err(EmptyResponse::Refused(refusal)) => {
                response = Response::default();
                refusal.put(&mut WordWriter::into(&mut response));
            }
        }
        response
    }

    fn obey(&self, request: &Request, response: &mut Response) -> Result<(), EmptyResponse> {
        let mut taken = WordReader::from(request);
        let operation = taken.word();
        let operation =
            ServoOperation::from_number(operation).ok_or(ServoRefusal::Operation { operation })?;
        let (finger, joint, argument) = (taken.word(), taken.word(), taken.word());
        let no_finger = ServoRefusal::NoFinger {
            finger,
            served: self.served,
        };
        if self.served.checked_shr(finger).unwrap_or(0) & 1 == 0 {
            return Err(no_finger.into());
        }
        let (Some(memory), Some(name)) = (
            self.fingers.get(finger as usize),
            self.identity.fingers.get(finger as usize),
        ) else {
            return Err(no_finger.into());
        };
        let mut put = WordWriter::into(response);
        put.word(state::DONE);
        match operation {
            ServoOperation::Hello => {
                put.words(&[VERSION, self.served, N as u32, self.identity.servo_hz])
                    .words(&name_words(&self.identity.hand))
                    .words(&name_words(name));
            }
            ServoOperation::Mode => {
                let mode = ServoMode::from_number(argument)
                    .ok_or(ServoRefusal::Mode { mode: argument })?;
                put.word(memory.order(joint, |put| {
                    put.words(&[kind::MODE, mode as u32]).numbers(&[0.0; 3]);
                })?);
            }
            ServoOperation::Target => {
                let target = take_target(argument, &mut taken)?;
                put.word(memory.order(joint, |put| {
                    put_target(&target, put.word(kind::TARGET));
                })?);
            }
            ServoOperation::Status => {
                let (cell, window) = memory.report();
                let report = cell.subscriber(window).map_err(|_| BUSY)?.read();
                put.words(&report.map_err(|_| BUSY)?.value)
                    .word(memory.word(word::TICKS)?);
            }
            ServoOperation::Restart => {
                let restarts = memory.word(word::RESTARTS)?.wrapping_add(1);
                memory.set_word(word::RESTARTS, restarts)?;
                put.word(memory.announce(memory.next_order()?)?);
            }
            ServoOperation::Outcome => {
                let part = match taken.word() {
                    0 => Part::Drive,
                    1 => Part::Restart,
                    part => return Err(ServoRefusal::Part { part }.into()),
                };
                memory.outcome(joint, part, argument)?;
            }
        }
        Ok(())
    }
}

impl<const N: usize> FingerMemory<N> {
    fn joint(&self, joint: u32) -> Result<&JointMemory, ServoRefusal> {
        let joints = self.all();
        let joint = joint as usize;
        joints.get(joint).ok_or(no_joint(joint, joints.len()))
    }

    /// The joints that the finger has.
    fn all(&self) -> &[JointMemory] {
        self.joints.get(..self.count).unwrap_or(&self.joints)
    }

    /// One joint, or all of them.
    fn chosen(&self, joint: u32) -> Result<&[JointMemory], ServoRefusal> {
        if joint == ALL_JOINTS {
            return Ok(self.all());
        }
        self.joint(joint).map(core::slice::from_ref)
    }

    fn word(&self, word: u32) -> Result<u32, EmptyResponse> {
        self.words().word(word).map_err(|_| BUSY)
    }

    fn set_word(&self, word: u32, value: u32) -> Result<(), EmptyResponse> {
        self.words().set_word(word, value).map_err(|_| BUSY)
    }

    /// The number after the last order's; 0 is that of none.
    fn next_order(&self) -> Result<u32, EmptyResponse> {
        Ok(match self.word(word::ORDERS)?.wrapping_add(1) {
            0 => 1,
            number => number,
        })
    }

    /// Lets the loop see all that the order has written.
    fn announce(&self, number: u32) -> Result<u32, EmptyResponse> {
        self.set_word(word::ORDERS, number)?;
        Ok(number)
    }

    /// Replaces the orders of joints; returns the number of the order.
    fn order(&self, joint: u32, fill: impl Fn(&mut WordWriter<'_>)) -> Result<u32, EmptyResponse> {
        let chosen = self.chosen(joint)?;
        let number = self.next_order()?;
        for joint in chosen {
            let mut order = Order::default();
            let mut put = WordWriter::into(&mut order);
            put.word(number);
            fill(&mut put);
            joint.publish(&order)?;
        }
        self.announce(number)
    }

    /// Returns the outcome of an order as an error, unless the order was done.
    fn outcome(&self, joint: u32, part: Part, number: u32) -> Result<(), EmptyResponse> {
        let chosen = self.chosen(joint)?;
        let (cell, window) = self.report();
        let report = cell.subscriber(window).map_err(|_| BUSY)?.read();
        let report = super::ServoStatus::<N>::take(&report.map_err(|_| BUSY)?.value, 0);
        let settled = report.map_err(|_| BUSY)?.settled;
        if settled.wrapping_sub(number).cast_signed() < 0 {
            return Err(EmptyResponse::State(state::PENDING));
        }
        if part == Part::Restart {
            return Ok(());
        }
        for joint in chosen {
            let outcome = joint.last_outcome()?;
            let mut taken = WordReader::from(&outcome);
            if taken.word() != number {
                return Err(EmptyResponse::State(state::SUPERSEDED));
            }
            if let Some(refusal) = ServoRefusal::take(&mut taken) {
                return Err(refusal.into());
            }
        }
        Ok(())
    }
}

impl JointMemory {
    fn publish(&self, order: &Order) -> Result<(), EmptyResponse> {
        let (cell, window): (_, StaticWindow<'_>) = self.order();
        // One handler at a time is here: a new publisher goes on where the last one stopped.
        let mut publisher = cell.publisher(window).map_err(|_| BUSY)?;
        publisher.publish(order).map(|_| ()).map_err(|_| BUSY)
    }

    fn last_outcome(&self) -> Result<Outcome, EmptyResponse> {
        let (cell, window) = self.outcome();
        let latest = cell.subscriber(window).map_err(|_| BUSY)?.read();
        Ok(latest.map_err(|_| BUSY)?.value)
    }
}

fn state_only(state: u32) -> Response {
    let mut response = Response::default();
    WordWriter::into(&mut response).word(state);
    response
}

/// A name and zeros after it.
fn name_words(name: &ShortName) -> [u32; 4] {
    let mut bytes = name.bytes();
    core::array::from_fn(|_| {
        u32::from_le_bytes(core::array::from_fn(|_| bytes.next().unwrap_or(0)))
    })
}
