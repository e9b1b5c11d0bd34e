//! Motions for the robot of a system, by its queue.

use core::time::Duration;

use condor_robot::host::{self, QueueClient};
use condor_robot::motions::RequestProgress;
use condor_robot::packet::ClientError;
use condor_robot::queue::{InControl, QueueAnswer, RequestIdentity, RequestState};

use crate::failure::Failure;
use crate::system_worker::WorkerState;

/// An enqueued motion: the session with the queue, and the number of the request in it.
pub(crate) type Ticket = (u32, u32);

/// The state of an enqueued motion: `(state, reason, progress, requests before it, whether it is final)`.
pub(crate) type Outcome = (String, Option<String>, Option<f64>, u32, bool);

impl<'v> WorkerState<'v> {
    fn queue(&self) -> Result<QueueClient<'v>, Failure> {
        Ok(host::connect(self.view, &self.status)?)
    }

    /// Enqueues a motion: `motions` is the name of a motion file, or the bytes of compiled motions. Control of the
    /// robot is given up again once the motion is accepted.
    pub(crate) fn enqueue(
        &mut self,
        motions: &[u8],
        takes_control: bool,
        timeout: Duration,
    ) -> Result<Ticket, Failure> {
        let mut queue = self.queue()?;
        let identity = self
            .session
            .take_control(&mut queue, takes_control, timeout)
            .map_err(refused)?;
        let offered = host::offer(&mut queue, identity, motions, timeout);
        let offered = offered.map_err(|error| {
            let text = format!("{error}; the motion may run nevertheless");
            Failure {
                text,
                ..Failure::from(error)
            }
        })?;
        match offered {
            QueueAnswer::Known(RequestState::Refused, reason) => {
                let text = format!("the motion is refused: {reason}");
                Err(Failure::refused(text))
            }
            QueueAnswer::Known(..) => Ok((identity.session, identity.number)),
            other => Err(Failure::refused(format!(
                "the motion is not accepted: {other}"
            ))),
        }
    }

    /// Returns the present state of an enqueued motion.
    pub(crate) fn outcome(
        &mut self,
        (session, number): Ticket,
        timeout: Duration,
    ) -> Result<Outcome, Failure> {
        let RequestProgress {
            answer,
            before,
            progress,
        } = self
            .queue()?
            .look(RequestIdentity { session, number }, timeout)?;
        let reason = answer.reason().map(|it| it.to_string());
        let (word, is_final) = (answer.word().into(), answer.is_final());
        Ok((word, reason, progress, before, is_final))
    }

    /// Ends the motion that runs, and all that wait.
    pub(crate) fn abort(&mut self, takes_control: bool, timeout: Duration) -> Result<(), Failure> {
        let mut queue = self.queue()?;
        let session = &mut self.session;
        session
            .abort(&mut queue, takes_control, timeout)
            .map_err(refused)
    }
}

/// The error of a client that is not in control: it says how to take control.
fn refused(error: ClientError) -> Failure {
    match error {
        ClientError::NotInControl(who) if who != InControl::Nobody => {
            Failure::refused(format!("{who}; `take_control=True` takes control from it"))
        }
        error => error.into(),
    }
}
