//! [`Motions`]: the requests of clients about motions, for the queue of the robot, which runs each at most once.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use condor_host::control::SystemStatus;
use condor_host::error::AnyError;
use condor_host::system::SystemDirectory;
use condor_host::view::View;
use condor_remote::wire::{
    ClientRequest, Id, RemoteOutcome, RemoteRefusal, RemoteRequest, RemoteState,
};
use condor_robot::host::{self, QueueClient, QueueSession};
use condor_robot::packet::ClientError;
use condor_robot::queue::{InControl, QueueAnswer, RequestIdentity, RequestState};
use serde_json::{Value as Json, json};

use crate::log;
use crate::presence::Presence;

/// The time that the queue may take to answer.
const ANSWER: Duration = Duration::from_millis(500);
/// The number of sessions of clients above which those that the queue has ended are removed.
const SESSIONS: usize = 64;

/// The way to the motion queue of a running system.
pub(crate) struct MotionsLink {
    view: View,
    status: SystemStatus,
}

impl MotionsLink {
    /// Joins the system, and looks whether a program of it serves a motion queue.
    ///
    /// # Errors
    /// An error that says that there is none, or why the system cannot be asked.
    pub(crate) fn find(
        directory: &SystemDirectory,
        status: SystemStatus,
    ) -> Result<Self, AnyError> {
        let mut view = View::open(directory, status.window_bytes)?;
        view.join()?;
        host::connect(&view, &status)?;
        Ok(Self { view, status })
    }
}

/// The requests of clients about motions. One thread carries them out.
///
/// Nothing here must outlive the gateway: a motion has the identity by which the queue knows it.
pub(crate) struct Motions {
    way: Option<MotionsLink>,
    /// The sessions that were opened for clients, with their names.
    sessions: BTreeMap<u32, String>,
    /// The motions that were offered and have not ended, with the names of their clients.
    open: BTreeMap<Id, String>,
    /// The session in which all motion is stopped.
    own: QueueSession,
    presence: Arc<Mutex<Presence>>,
    stopped: Option<Instant>,
}

impl Motions {
    #[must_use]
    pub(crate) fn new(presence: Arc<Mutex<Presence>>) -> Self {
        Self {
            way: None,
            sessions: BTreeMap::new(),
            open: BTreeMap::new(),
            own: QueueSession::default(),
            presence,
            stopped: None,
        }
    }

    /// Sets the way to the system, which is another one after a restart.
    pub(crate) fn set_way(&mut self, way: Option<MotionsLink>) {
        self.way = way;
        // The queue has closed these sessions, or will: what it has not got by then never runs.
        self.sessions.clear();
        self.open.clear();
        self.own = QueueSession::default();
    }

    /// Returns true if there is a way to the system.
    #[must_use]
    pub(crate) const fn has_way(&self) -> bool {
        self.way.is_some()
    }

    /// Answers a request about motions.
    ///
    /// # Errors
    /// A refusal that says why it is not carried out.
    pub(crate) fn answer(&mut self, asked: &ClientRequest) -> Result<Json, RemoteRefusal> {
        let client = asked.client.as_str();
        match asked.request {
            RemoteRequest::NextId { last } => Ok(json!(self.next_id(client, last)?)),
            RemoteRequest::Offer { id, takes_control } => Ok(json!(self.offer(
                client,
                id,
                &asked.motion,
                takes_control
            )?)),
            RemoteRequest::Outcome { id } => Ok(json!(self.look(id)?)),
            RemoteRequest::Withdraw { id } => Ok(json!(self.withdraw(client, id)?)),
            RemoteRequest::Stop {} => {
                let stopped = self.stop();
                log::tell(client, &format!("stops all motion: {}", how(&stopped)));
                Ok(json!(stopped?))
            }
            _ => Err(RemoteRefusal::new(
                "the request is not about motions",
                false,
            )),
        }
    }

    /// Returns the identity of a client's next motion, in the session of its last one if that is still open.
    fn next_id(&mut self, client: &str, last: Option<Id>) -> Result<Id, Again> {
        let mut queue = connect(self.way.as_ref())?;
        let next = last.and_then(|last| {
            let number = last.number.checked_add(1)?;
            (self.sessions.get(&last.session)? == client).then_some(Id { number, ..last })
        });
        if let Some(next) = next
            && queue.look(request(next), ANSWER)?.answer == QueueAnswer::New
        {
            return Ok(next);
        }
        let session = queue.open(ANSWER)?;
        self.sessions.insert(session, client.into());
        if self.sessions.len() > SESSIONS {
            // The queue has fewer, and has ended the others.
            self.sessions.retain(|&session, _| {
                let seen = queue.look(RequestIdentity { session, number: 1 }, ANSWER);
                !matches!(seen, Ok(seen) if seen.answer == QueueAnswer::NoSession)
            });
        }
        Ok(Id { session, number: 1 })
    }

    /// Checks that a client uses a session of its own.
    fn check_session(&self, client: &str, id: Id) -> Result<(), RemoteRefusal> {
        match self.sessions.get(&id.session) {
            Some(owner) if owner == client => Ok(()),
            Some(_) => Err(RemoteRefusal::new(
                format!("motion {id} is one of another client"),
                false,
            )),
            // Once the queue has closed the session, it says that the motion never runs.
            None => Err(RemoteRefusal::new(
                format!("the session of motion {id} is about to be closed: ask again"),
                true,
            )),
        }
    }

    fn offer(
        &mut self,
        client: &str,
        id: Id,
        motion: &[u8],
        takes_control: bool,
    ) -> Result<RemoteOutcome, RemoteRefusal> {
        let outcome = self.look(id)?;
        if outcome.state != RemoteState::New {
            return Ok(outcome);
        }
        self.check_session(client, id)?;
        let (may_begin, stops) = self.presence(|it| (it.may_begin(client), it.stops(client)));
        if !may_begin {
            let error = "motions of this client stop when it disconnects, and the gateway does not see it connected";
            return Err(RemoteRefusal::new(error, true));
        }
        let answer = self.enqueue(client, id, motion, takes_control, stops)?;
        Ok(self.outcome(id, answer, None))
    }

    fn enqueue(
        &mut self,
        client: &str,
        id: Id,
        motion: &[u8],
        takes_control: bool,
        stops: bool,
    ) -> Result<QueueAnswer, Again> {
        let mut queue = connect(self.way.as_ref())?;
        match queue.take_control(id.session, takes_control, ANSWER) {
            Err(ClientError::NotInControl(who)) if who != InControl::Nobody => {
                return Err(format!("{who}; `--control` takes control from it").into());
            }
            taken => taken?,
        }
        if stops {
            // If the master is started again after this, nobody is in control, and it refuses the motion.
            queue.bind(id.session, ANSWER)?;
        }
        if self.open.insert(id, client.into()).is_none() {
            log::tell(client, &format!("offers motion {id}"));
        }
        Ok(host::offer(&mut queue, request(id), motion, ANSWER)?)
    }

    fn withdraw(&mut self, client: &str, id: Id) -> Result<RemoteOutcome, RemoteRefusal> {
        let mut outcome = self.look(id)?;
        if outcome.state == RemoteState::New {
            self.check_session(client, id)?;
            let withdrawn = connect(self.way.as_ref())
                .and_then(|mut queue| Ok(queue.withdraw(request(id), ANSWER)?));
            outcome = self.outcome(id, withdrawn?, None);
        }
        log::tell(client, &format!("withdraws motion {id}: {}", outcome.state));
        Ok(outcome)
    }

    /// Asks the queue what has become of a motion.
    fn look(&mut self, id: Id) -> Result<RemoteOutcome, Again> {
        let seen = connect(self.way.as_ref())?.look(request(id), ANSWER)?;
        Ok(self.outcome(id, seen.answer, seen.progress))
    }

    /// The outcome of a motion, by the answer of the queue; its end is logged once.
    fn outcome(&mut self, id: Id, answer: QueueAnswer, progress: Option<f64>) -> RemoteOutcome {
        let state = state_of(answer);
        let reason = answer.reason().map(|it| it.to_string());
        let reason = reason.unwrap_or_default();
        if state.is_final()
            && let Some(client) = self.open.remove(&id)
        {
            let comma = if reason.is_empty() { "" } else { ", " };
            log::tell(&client, &format!("motion {id}: {state}{comma}{reason}"));
        }
        RemoteOutcome {
            state,
            reason,
            progress,
        }
    }

    /// Finds out what has become of all motions that have not ended, and stops those whose client is gone.
    pub(crate) fn turn(&mut self) {
        let now = Instant::now();
        let open: Vec<_> = self.open.iter().map(|it| (*it.0, it.1.clone())).collect();
        for (id, client) in open {
            match self.look(id) {
                Ok(outcome) if outcome.state.is_final() => {}
                Ok(outcome) if outcome.state == RemoteState::New => {
                    // The offer did not come through: the client sends it again, or it never runs.
                    self.open.remove(&id);
                }
                _ if !self.presence(|it| it.must_stop(&client, now)) => {}
                _ if self.stopped.is_some_and(|at| now - at < ANSWER) => {}
                _ => {
                    self.stopped = Some(now);
                    let how = how(&self.stop());
                    log::tell(
                        &client,
                        &format!(
                            "has disconnected, and motion {id} must stop then: the gateway stops all motion: {how}"
                        ),
                    );
                }
            }
        }
    }

    fn presence<T>(&self, ask: impl FnOnce(&Presence) -> T) -> T {
        ask(&self.presence.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Ends all motion.
    fn stop(&mut self) -> Result<(), Again> {
        let mut queue = connect(self.way.as_ref())?;
        Ok(self.own.abort(&mut queue, true, ANSWER)?)
    }
}

/// An error after which the same request may succeed later.
struct Again(AnyError);

impl<E: Into<AnyError>> From<E> for Again {
    fn from(error: E) -> Self {
        Self(error.into())
    }
}

impl From<Again> for RemoteRefusal {
    fn from(Again(error): Again) -> Self {
        Self::new(error.to_string(), true)
    }
}

fn how(stopped: &Result<(), Again>) -> String {
    match stopped {
        Ok(()) => "done".into(),
        Err(Again(error)) => error.to_string(),
    }
}

/// The identity of a motion, as the queue has it.
const fn request(Id { session, number }: Id) -> RequestIdentity {
    RequestIdentity { session, number }
}

fn connect(way: Option<&MotionsLink>) -> Result<QueueClient<'_>, Again> {
    let MotionsLink { view, status } = way.ok_or("the system is not running")?;
    Ok(host::connect(view, status)?)
}

fn state_of(answer: QueueAnswer) -> RemoteState {
    match answer {
        QueueAnswer::New => RemoteState::New,
        QueueAnswer::Never => RemoteState::Never,
        QueueAnswer::Forgotten | QueueAnswer::NoSession => RemoteState::Forgotten,
        QueueAnswer::Known(state, _) => match state {
            RequestState::Started => RemoteState::Started,
            RequestState::Done => RemoteState::Done,
            RequestState::Stopped => RemoteState::Stopped,
            RequestState::Aborted => RemoteState::Aborted,
            RequestState::Refused => RemoteState::Refused,
            RequestState::Lost => RemoteState::Lost,
            RequestState::BrokenOff => RemoteState::BrokenOff,
            // Accepted; or of a later version: nobody is told that it has ended.
            _ => RemoteState::Accepted,
        },
    }
}
