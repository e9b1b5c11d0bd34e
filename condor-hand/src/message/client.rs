use core::time::Duration;

use condor_mbox::exchange::ExchangeError;
use condor_mbox::{
    AccessError, Exchange, Instant, MailboxError, MemoryWindow, Messenger, Processor, Region,
};

use super::layout::ServoLayout;
use super::values::put_target;
use super::words::{WordReader, WordWriter};
use super::{
    ALL_JOINTS, ClientError, Part, REQUEST_WORDS, Request, Response, SERVO, ServoOperation,
    ServoStatus, VERSION, state,
};
use crate::config::ShortName;
use crate::servo::{JointTarget, ServoMode, ServoRefusal};

/// The pause between two questions to a servo processor that has not processed an order: an order is done at
/// the next tick of its loop.
const PAUSE: Duration = Duration::from_micros(200);

/// A client with which one processor controls the servos of another processor. Use it in the background of the
/// processor, not in a servo loop, since calls wait for responses.
///
/// Fingers and joints are counted from 0. Each call ends at its timeout. If a call that changes something returns
/// without an error, the servo loop has carried it out.
#[derive(Debug)]
pub struct ServoClient<'m, M: Messenger + ?Sized, W, const F: usize, const N: usize> {
    exchange: Exchange<'m, M, Region<W>, Request, Response>,
    messenger: &'m M,
    to: Processor,
}

/// The answer of a servo processor to [`ServoClient::hello`]: the names of the hand and the finger,
/// and the properties of the servos.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Hello {
    /// The name of the hand.
    pub hand: ShortName,
    /// The name of the finger.
    pub finger: ShortName,
    /// The fingers of the hand that the processor serves: bit *i* stands for finger *i*.
    pub served: u32,
    /// The number of joints of a finger.
    pub joints: u32,
    /// Servo ticks in a second, Hz.
    pub servo_hz: u32,
}

impl<'m, M, W, const F: usize, const N: usize> ServoClient<'m, M, W, F, N>
where
    M: Messenger + ?Sized,
    W: MemoryWindow + Clone,
{
    /// Makes a client of the servos of the processor `to`.
    ///
    /// `region` is the users' region of that processor's `data` ([`Region::users`]). `places` is
    /// the layout of the servos in that region; it must be the same on both processors. There must
    /// be only one client on this processor at a time.
    ///
    /// # Errors
    /// [`AccessError`] of the kind `OutOfBounds` if the sender has no block in the places, or if
    /// there is no room.
    pub fn new(
        messenger: &'m M,
        to: Processor,
        region: &Region<W>,
        places: ServoLayout<F, N>,
    ) -> Result<Self, AccessError> {
        Ok(Self {
            exchange: places.blocks.client(messenger, region)?,
            messenger,
            to,
        })
    }

    /// Asks the servo processor for the names of the hand and of finger number `finger`, and for the properties of its
    /// servos.
    ///
    /// # Errors
    /// [`ClientError::Version`] if the protocol has another version; [`ClientError::Refused`] if
    /// the processor does not serve the finger; [`ClientError::Exchange`], [`ClientError::TimedOut`] or
    /// [`ClientError::Protocol`] if there is no valid response.
    pub fn hello(&mut self, finger: u32, timeout: Duration) -> Result<Hello, ClientError> {
        let response = self.ask(&request(ServoOperation::Hello, finger, 0, 0), timeout)?;
        let mut taken = self.check(&response)?;
        let found = taken.word();
        if found != VERSION {
            return Err(ClientError::Version {
                to: self.to,
                found,
                wanted: VERSION,
            });
        }
        let (served, joints, servo_hz) = (taken.word(), taken.word(), taken.word());
        Ok(Hello {
            hand: self.name(&mut taken)?,
            finger: self.name(&mut taken)?,
            served,
            joints,
            servo_hz,
        })
    }

    /// Switches one joint, or all joints of the finger if `joint` is `None`, to another mode. The present positions,
    /// torques or tensions become the targets, so nothing jumps.
    ///
    /// # Errors
    /// Returns [`ClientError::Refused`] if the servo refuses the request; [`ClientError::NotDone`] if
    /// its loop has not processed the request in time; [`ClientError::Superseded`] if a later one replaced
    /// it; [`ClientError::Exchange`], [`ClientError::TimedOut`] or [`ClientError::Protocol`] if
    /// there is no valid response.
    pub fn enable(
        &mut self,
        finger: u32,
        joint: Option<u32>,
        mode: ServoMode,
        timeout: Duration,
    ) -> Result<(), ClientError> {
        let joint = joint.unwrap_or(ALL_JOINTS);
        let request = request(ServoOperation::Mode, finger, joint, mode as u32);
        self.order(&request, Part::Drive, timeout)
    }

    /// Switches one joint, or all joints of the finger if `joint` is `None`, off. A joint that is off has its least
    /// tensions.
    ///
    /// # Errors
    /// Returns the same variants as [`enable`](Self::enable) if the servo does not carry out the request.
    pub fn disable(
        &mut self,
        finger: u32,
        joint: Option<u32>,
        timeout: Duration,
    ) -> Result<(), ClientError> {
        self.enable(finger, joint, ServoMode::Off, timeout)
    }

    /// Sets a constant target of a joint, and switches the joint to the mode of that target.
    ///
    /// # Errors
    /// Returns [`ClientError::Refused`] if the joint cannot have the target, and otherwise the same
    /// variants as [`enable`](Self::enable) if the servo does not carry out the request.
    pub fn set_target(
        &mut self,
        finger: u32,
        joint: u32,
        target: &JointTarget<f64>,
        timeout: Duration,
    ) -> Result<(), ClientError> {
        let mut request = request(ServoOperation::Target, finger, joint, 0);
        let (_, words) = request.split_at_mut(ARGUMENT);
        put_target(target, &mut WordWriter::into(words));
        self.order(&request, Part::Drive, timeout)
    }

    /// Returns the state of a finger, such as its modes and its fault, as the servo loop last reported it.
    ///
    /// # Errors
    /// [`ClientError::Refused`] if the processor does not serve the finger;
    /// [`ClientError::Exchange`] if the message fails; [`ClientError::TimedOut`] if the handler is busy
    /// until the deadline; [`ClientError::Protocol`] if the response is invalid.
    pub fn status(
        &mut self,
        finger: u32,
        timeout: Duration,
    ) -> Result<ServoStatus<N>, ClientError> {
        let response = self.ask(&request(ServoOperation::Status, finger, 0, 0), timeout)?;
        self.check(&response)?;
        let words = response.get(1..17).unwrap_or(&[]);
        let ticks = response.get(17).copied().unwrap_or(0);
        ServoStatus::take(words, ticks).map_err(|word| self.protocol(word))
    }

    /// Clears the latched faults of a finger. Its joints can be switched to another mode once the finger
    /// [rests](ServoStatus::is_resting) no longer.
    ///
    /// # Errors
    /// Returns the same variants as [`enable`](Self::enable) if the servo does not carry out the request.
    pub fn restart(&mut self, finger: u32, timeout: Duration) -> Result<(), ClientError> {
        let request = request(ServoOperation::Restart, finger, ALL_JOINTS, 0);
        self.order(&request, Part::Restart, timeout)
    }

    /// Sends an order, and asks for its outcome until the loop has processed it.
    fn order(
        &mut self,
        request: &Request,
        part: Part,
        timeout: Duration,
    ) -> Result<(), ClientError> {
        let deadline = self.messenger.now().after(timeout);
        let response = self.ask(request, timeout)?;
        let number = self.check(&response)?.word();
        let [_, finger, joint, ..] = *request;
        let mut question = self::request(ServoOperation::Outcome, finger, joint, number);
        if let Some(word) = question.get_mut(NUMBERS) {
            *word = part as u32;
        }
        let not_done = ClientError::NotDone {
            to: self.to,
            number,
            timeout,
        };
        loop {
            let left = self.left(deadline);
            if left.is_zero() {
                return Err(not_done);
            }
            match self.ask(&question, left) {
                Err(ClientError::Exchange(ExchangeError::Mailbox(MailboxError::TimedOut {
                    ..
                }))) => {
                    return Err(not_done);
                }
                Err(error) => return Err(error),
                Ok([state::PENDING, ..]) => self.pause(deadline)?,
                Ok([state::SUPERSEDED, ..]) => return Err(ClientError::Superseded { number }),
                Ok(response) => return self.check(&response).map(|_| ()),
            }
        }
    }

    /// One request, again while another one is being answered.
    fn ask(&mut self, request: &Request, timeout: Duration) -> Result<Response, ClientError> {
        let deadline = self.messenger.now().after(timeout);
        loop {
            let left = self.left(deadline);
            let response = self.exchange.call(self.to, SERVO, request, left)?;
            match response {
                [state::BUSY, ..] if left.is_zero() => {
                    return Err(ClientError::TimedOut {
                        to: self.to,
                        timeout,
                    });
                }
                [state::BUSY, ..] => self.pause(deadline)?,
                _ => return Ok(response),
            }
        }
    }

    fn left(&self, deadline: Instant) -> Duration {
        Duration::from_nanos(deadline.ns_since(self.messenger.now()))
    }

    /// Waits a moment, for the servo processor.
    fn pause(&self, deadline: Instant) -> Result<(), ClientError> {
        let pause = self.left(deadline).min(PAUSE);
        self.messenger.serve(pause).map_err(ExchangeError::from)?;
        Ok(())
    }

    /// Returns the words after the state in a response without a refusal.
    fn check<'r>(&self, response: &'r Response) -> Result<WordReader<'r>, ClientError> {
        let (&[state], rest) = response.split_at(1) else {
            return Err(self.protocol(0));
        };
        match state {
            state::DONE => Ok(WordReader::from(rest)),
            other => Err(ServoRefusal::take(&mut WordReader::from(response))
                .map_or_else(|| self.protocol(other), ClientError::Refused)),
        }
    }

    fn name(&self, taken: &mut WordReader<'_>) -> Result<ShortName, ClientError> {
        let mut bytes = [0; 16];
        for part in bytes.chunks_mut(4) {
            part.copy_from_slice(&taken.word().to_le_bytes());
        }
        let text = bytes.split(|&byte| byte == 0).next().unwrap_or(&[]);
        let [first, ..] = bytes;
        let name = core::str::from_utf8(text).ok();
        name.and_then(|text| ShortName::try_from(text).ok())
            .ok_or_else(|| self.protocol(u32::from(first)))
    }

    fn protocol(&self, word: u32) -> ClientError {
        ClientError::Protocol { to: self.to, word }
    }
}

const ARGUMENT: usize = 3;
const NUMBERS: usize = 4;

fn request(operation: ServoOperation, finger: u32, joint: u32, argument: u32) -> Request {
    let mut request = [0; REQUEST_WORDS];
    WordWriter::into(&mut request).words(&[operation as u32, finger, joint, argument]);
    request
}
