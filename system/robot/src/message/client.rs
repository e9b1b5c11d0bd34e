use core::time::Duration;

use condor_hand::servo::{JointTarget, ServoMode};
use condor_mbox::exchange::ExchangeError;
use condor_mbox::{
    AccessError, Exchange, Instant, MailboxError, MemoryWindow, Messenger, Processor, Region,
};

use super::layout::ServoLayout;
use super::{
    Hello, OrderPart, SERVO, ServoRequest, ServoRequestPacket, ServoResponse, ServoResponsePacket,
    ServoStatus,
};
use crate::packet::{self, ClientError};

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
    exchange: Exchange<'m, M, Region<W>, ServoRequestPacket, ServoResponsePacket<N>>,
    messenger: &'m M,
    to: Processor,
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
        match self.ask(ServoRequest::Hello { finger }, timeout)? {
            ServoResponse::Hello(hello) => Ok(hello),
            _ => Err(self.protocol()),
        }
    }

    /// Switches one joint, or all joints of the finger if `joint` is `None`, to another mode. The present positions,
    /// torques or efforts become the targets, so nothing jumps.
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
        let request = ServoRequest::Mode {
            finger,
            joint,
            mode,
        };
        self.order(request, OrderPart::Drive(joint), timeout)
    }

    /// Switches one joint, or all joints of the finger if `joint` is `None`, off. If all are off,
    /// the actuators of the finger are at rest.
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
        target: &JointTarget,
        timeout: Duration,
    ) -> Result<(), ClientError> {
        let (joint, target) = (Some(joint), *target);
        let request = ServoRequest::Target {
            finger,
            joint,
            target,
        };
        self.order(request, OrderPart::Drive(joint), timeout)
    }

    /// Sets the effort of an actuator (N, or N m), and switches the joint to which it
    /// [belongs](condor_hand::transmission::Linear::joint_of) to [`ServoMode::Effort`].
    ///
    /// # Errors
    /// Returns [`ClientError::Refused`] if the actuator cannot have the effort, or does not belong to the joint, and
    /// otherwise the same variants as [`enable`](Self::enable) if the servo does not carry out the request.
    pub fn set_effort(
        &mut self,
        finger: u32,
        joint: u32,
        (actuator, effort): (u32, f64),
        timeout: Duration,
    ) -> Result<(), ClientError> {
        let request = ServoRequest::Effort {
            finger,
            joint,
            actuator,
            effort,
        };
        self.order(request, OrderPart::Drive(Some(joint)), timeout)
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
        match self.ask(ServoRequest::Status { finger }, timeout)? {
            ServoResponse::Status(status) => Ok(status),
            _ => Err(self.protocol()),
        }
    }

    /// Clears the latched faults of a finger. Its joints can be switched to another mode once the finger
    /// [rests](ServoStatus::is_resting) no longer.
    ///
    /// # Errors
    /// Returns the same variants as [`enable`](Self::enable) if the servo does not carry out the request.
    pub fn restart(&mut self, finger: u32, timeout: Duration) -> Result<(), ClientError> {
        self.order(ServoRequest::Restart { finger }, OrderPart::Faults, timeout)
    }

    /// Sends an order, and asks for its outcome until the loop has processed it.
    fn order(
        &mut self,
        request: ServoRequest,
        part: OrderPart,
        timeout: Duration,
    ) -> Result<(), ClientError> {
        let deadline = self.messenger.now().after(timeout);
        let ServoResponse::Ordered(order) = self.ask(request, timeout)? else {
            return Err(self.protocol());
        };
        let question = ServoRequest::Outcome {
            finger: request.finger(),
            part,
            order,
        };
        let not_done = ClientError::NotDone {
            to: self.to,
            number: order,
            timeout,
        };
        loop {
            let left = self.left(deadline);
            if left.is_zero() {
                return Err(not_done);
            }
            match self.ask(question, left) {
                Err(ClientError::Exchange(ExchangeError::Mailbox(MailboxError::TimedOut {
                    ..
                }))) => {
                    return Err(not_done);
                }
                Err(error) => return Err(error),
                Ok(ServoResponse::Pending) => self.pause(deadline)?,
                Ok(ServoResponse::Done) => return Ok(()),
                Ok(ServoResponse::Superseded) => {
                    return Err(ClientError::Superseded { number: order });
                }
                Ok(_) => return Err(self.protocol()),
            }
        }
    }

    /// One request, again while another one is being answered.
    fn ask(
        &mut self,
        request: ServoRequest,
        timeout: Duration,
    ) -> Result<ServoResponse<N>, ClientError> {
        let to = self.to;
        let deadline = self.messenger.now().after(timeout);
        loop {
            let left = self.left(deadline);
            match packet::ask(&mut self.exchange, to, SERVO, &request, left)? {
                ServoResponse::Busy if left.is_zero() => {
                    return Err(ClientError::TimedOut { to, timeout });
                }
                ServoResponse::Busy => self.pause(deadline)?,
                ServoResponse::Refused(refusal) => return Err(refusal.into()),
                response => return Ok(response),
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

    /// The error that the processor has answered with another kind of response.
    const fn protocol(&self) -> ClientError {
        ClientError::Protocol { to: self.to }
    }
}
