//! Motions for the robot of a system, by its queue.

use core::time::Duration;

use condor_host::view::Post;
use condor_mbox::Processor;
use condor_mbox::linux::LinuxWindow;
use condor_robot::motions::{MotionsClient, RequestProgress};
use condor_robot::objects;
use condor_robot::packet::ClientError;
use condor_robot::queue::{InControl, QueueAnswer, RefusalReason, RequestIdentity, RequestState};

use crate::failure::Failure;
use crate::system_worker::{Session, WorkerState};

/// An enqueued motion: the session with the queue, and the number of the request in it.
pub(crate) type Ticket = (u32, u32);

/// The state of an enqueued motion: `(state, reason, progress, requests before it, whether it is final)`.
pub(crate) type Outcome = (String, Option<String>, Option<f64>, u32, bool);

impl<'v> WorkerState<'v> {
    fn queue(&self) -> Result<MotionsClient<'v, Post, LinuxWindow>, Failure> {
        for member in &self.status.processors {
            let master = Processor(member.number);
            let region = self.view.region(master)?;
            if let Some(blocks) = objects::motions(&region)? {
                return Ok(MotionsClient::new(
                    self.view.post(),
                    master,
                    &blocks,
                    &region,
                )?);
            }
        }
        let system = &self.status.system;
        Err(Failure::not_found(format!(
            "no running processor of `{system}` has a queue of motions; start its master"
        )))
    }

    /// Returns the number of this visitor's session with the queue. Opens another one if there is none any more, since
    /// other clients may have taken its place.
    fn open(
        &mut self,
        queue: &mut MotionsClient<'_, Post, LinuxWindow>,
        timeout: Duration,
    ) -> Result<u32, Failure> {
        if let Some(session) = self.session.number {
            let number = self.session.last + 1;
            let seen = queue.look(RequestIdentity { session, number }, timeout)?;
            // A closed session answers that the request never runs.
            if !matches!(seen.answer, QueueAnswer::NoSession | QueueAnswer::Never) {
                return Ok(session);
            }
        }
        let session = queue.open(timeout)?;
        self.session = Session {
            number: Some(session),
            last: 0,
        };
        Ok(session)
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
        let session = self.open(&mut queue, timeout)?;
        take_control(&mut queue, session, takes_control, timeout)?;
        let number = self.session.last + 1;
        let offered = queue.offer(RequestIdentity { session, number }, motions, timeout);
        // The accepted motion runs all the same, and others need not take control away.
        let given_up = queue.give_up_control(session, timeout);
        self.session.last = number;
        let offered = offered.map_err(|error| {
            let text = format!("{error}; the motion may run nevertheless");
            Failure {
                text,
                ..Failure::from(error)
            }
        })?;
        given_up?;
        match offered {
            QueueAnswer::Known(RequestState::Refused, reason) => {
                let text = format!("the motion is refused: {reason}");
                Err(Failure::refused(text))
            }
            QueueAnswer::Known(..) => Ok((session, number)),
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
        let (state, reason, is_final) = match answer {
            QueueAnswer::Known(state, reason) => (state.word(), Some(reason), state.is_final()),
            QueueAnswer::New => ("unknown", None, false),
            QueueAnswer::Never => ("refused", None, true),
            QueueAnswer::Forgotten | QueueAnswer::NoSession => ("forgotten", None, true),
        };
        let reason = reason.filter(|it| *it != RefusalReason::None);
        let reason = reason.map(|it| it.to_string());
        Ok((state.into(), reason, progress, before, is_final))
    }

    /// Ends the motion that runs, and all that wait.
    pub(crate) fn abort(&mut self, takes_control: bool, timeout: Duration) -> Result<(), Failure> {
        let mut queue = self.queue()?;
        let session = self.open(&mut queue, timeout)?;
        take_control(&mut queue, session, takes_control, timeout)?;
        let aborted = queue.abort(session, timeout);
        let given_up = queue.give_up_control(session, timeout);
        aborted?;
        Ok(given_up?)
    }
}

fn take_control(
    queue: &mut MotionsClient<'_, Post, LinuxWindow>,
    session: u32,
    from_other: bool,
    timeout: Duration,
) -> Result<(), Failure> {
    match queue.take_control(session, from_other, timeout) {
        Err(ClientError::NotInControl(who)) if who != InControl::Nobody => Err(Failure::refused(
            format!("{who}; `take_control=True` takes control from it"),
        )),
        done => Ok(done?),
    }
}
