//! The motion queue of a running system, for programs of the host: [`connect`] finds it, and a [`QueueSession`] has
//! motions enqueued.

use core::time::Duration;

use condor_host::control::SystemStatus;
use condor_host::view::{Post, View, ViewError};
use condor_mbox::linux::LinuxWindow;
use condor_mbox::{AccessError, Processor};
use thiserror::Error;

use crate::motions::MotionsClient;
use crate::objects;
use crate::packet::ClientError;
use crate::queue::{InControl, QueueAnswer, RequestIdentity};

/// A client of the motion queue of a running system.
pub type QueueClient<'v> = MotionsClient<'v, Post, LinuxWindow>;

/// The reason why the motion queue of a system cannot be reached.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ConnectError {
    /// No program of the system serves a motion queue.
    #[error(
        "no running processor of `{system}` has a motion queue: start the one whose program is the master"
    )]
    NoQueue {
        /// The name of the system.
        system: String,
    },
    /// The memory of a processor cannot be found.
    #[error(transparent)]
    View(#[from] ViewError),
    /// The memory of a processor cannot be accessed.
    #[error("cannot access the motion queue: {0}")]
    Access(#[from] AccessError),
}

/// Finds the processor of a system that serves a motion queue, and makes a client of the queue. `view` has
/// [joined](View::join), and has one such client at a time; `status` is the state of the same system.
///
/// A program that is started anew may have its queue elsewhere: connect for each request, or again after one has failed.
///
/// # Errors
/// Returns [`ConnectError::NoQueue`] if no running program serves a motion queue, and another [`ConnectError`] if the
/// memory of a processor cannot be read.
pub fn connect<'v>(view: &'v View, status: &SystemStatus) -> Result<QueueClient<'v>, ConnectError> {
    for member in &status.processors {
        let master = Processor(member.number);
        let region = view.region(master)?;
        if let Some(blocks) = objects::motions(&region)? {
            return Ok(QueueClient::new(view.post(), master, &blocks, &region)?);
        }
    }
    let system = status.system.clone();
    Err(ConnectError::NoQueue { system })
}

/// The session of a program of the host with a motion queue. It is opened when it is first needed, and again when the
/// queue has closed or forgotten it.
///
/// A motion is enqueued in two calls, so that a program can note its identity in between:
/// [`take_control`](Self::take_control) and [`offer`].
#[derive(Clone, Debug, Default)]
pub struct QueueSession {
    /// The last identity that was given out; with the number 0 before the first one of a session.
    last: Option<RequestIdentity>,
}

impl QueueSession {
    /// Takes control of the queue, and returns the identity of the next request: a new one in each call. Then call
    /// [`offer`], or [`give_up_control`](MotionsClient::give_up_control) if there is nothing to enqueue. If another
    /// session is in control, it stays so, unless `from_other` is true.
    ///
    /// # Errors
    /// Returns [`ClientError::NotInControl`] if another session stays in control, and the errors of all calls of
    /// [`MotionsClient`].
    pub fn take_control(
        &mut self,
        client: &mut QueueClient<'_>,
        from_other: bool,
        timeout: Duration,
    ) -> Result<RequestIdentity, ClientError> {
        if let Some(next) = self.last.and_then(next)
            // Other clients may have taken the place of the session, and a closed one says that the request never runs.
            && !matches!(
                client.look(next, timeout)?.answer,
                QueueAnswer::NoSession | QueueAnswer::Never
            )
        {
            match client.take_control(next.session, from_other, timeout) {
                // The session was closed just now, or the queue has a new ledger, where another client has it.
                Err(ClientError::NotYours | ClientError::NotInControl(InControl::Nobody)) => {}
                Err(ClientError::NotInControl(_)) if from_other => {}
                taken => {
                    taken?;
                    self.last = Some(next);
                    return Ok(next);
                }
            }
        }
        let session = client.open(timeout)?;
        self.last = Some(RequestIdentity { session, number: 0 });
        client.take_control(session, from_other, timeout)?;
        let first = RequestIdentity { session, number: 1 };
        self.last = Some(first);
        Ok(first)
    }

    /// Ends the motion that runs, and all that wait, also those of other clients, and gives up control.
    ///
    /// # Errors
    /// Returns the errors of [`take_control`](Self::take_control).
    pub fn abort(
        &mut self,
        client: &mut QueueClient<'_>,
        from_other: bool,
        timeout: Duration,
    ) -> Result<(), ClientError> {
        let RequestIdentity { session, .. } = self.take_control(client, from_other, timeout)?;
        let aborted = client.abort(session, timeout);
        let given_up = client.give_up_control(session, timeout);
        aborted.and(given_up)
    }
}

/// Offers motions to the queue as the request `identity`, waits until they are accepted or refused, and gives up control:
/// an accepted motion runs all the same, and others need not take control away. Returns the queue's answer.
///
/// # Errors
/// Returns the errors of [`MotionsClient::offer`]. After [`ClientError::Exchange`] or [`ClientError::TimedOut`] the motions
/// may run nevertheless.
pub fn offer(
    client: &mut QueueClient<'_>,
    identity: RequestIdentity,
    motions: &[u8],
    timeout: Duration,
) -> Result<QueueAnswer, ClientError> {
    let offered = client.offer(identity, motions, timeout);
    // If this fails, control is given up after the next motion of the session.
    let _ = client.give_up_control(identity.session, timeout);
    offered
}

/// The identity after `last`; `None` if the session has no number left.
fn next(last: RequestIdentity) -> Option<RequestIdentity> {
    let number = last.number.checked_add(1)?;
    Some(RequestIdentity { number, ..last })
}
