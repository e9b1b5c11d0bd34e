//! [`Motions`]: has the motions of clients enqueued, each at most once.

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

use crate::book::{Book, digest};
use crate::log;
use crate::presence::Presence;

/// The time that the queue may take to answer.
const ANSWER: Duration = Duration::from_millis(500);

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
pub(crate) struct Motions {
    book: Book,
    way: Option<MotionsLink>,
    session: QueueSession,
    /// The bytes of motions that were offered in this incarnation, until the queue has decided.
    undecided: BTreeMap<(String, Id), (RequestIdentity, Vec<u8>, bool)>,
    presence: Arc<Mutex<Presence>>,
    stopped: Option<Instant>,
}

impl Motions {
    /// Makes it with what is known of former incarnations.
    #[must_use]
    pub(crate) fn new(book: Book, presence: Arc<Mutex<Presence>>) -> Self {
        Self {
            book,
            way: None,
            session: QueueSession::default(),
            undecided: BTreeMap::new(),
            presence,
            stopped: None,
        }
    }

    /// Sets the way to the system, which is another one after a restart.
    pub(crate) fn set_way(&mut self, way: Option<MotionsLink>) {
        self.way = way;
        self.session = QueueSession::default();
        // The queue has closed the session of these, or will: what it has not got by then never runs.
        self.undecided.clear();
    }

    /// Returns true if there is a way to the system.
    #[must_use]
    pub(crate) const fn has_way(&self) -> bool {
        self.way.is_some()
    }

    /// Returns the incarnation of a client that begins.
    ///
    /// # Errors
    /// A refusal if there is none left, or if the journal cannot be written.
    pub(crate) fn join(&mut self, client: &str) -> Result<u64, RemoteRefusal> {
        self.book.join(client)
    }

    /// Answers a request about motions.
    ///
    /// # Errors
    /// A refusal that says why it is not carried out.
    pub(crate) fn answer(
        &mut self,
        asked: &ClientRequest,
    ) -> Result<Option<RemoteOutcome>, RemoteRefusal> {
        let client = asked.client.as_str();
        match asked.request {
            RemoteRequest::Offer { id, takes_control } => self
                .offer(client, id, &asked.motion, takes_control)
                .map(Some),
            RemoteRequest::Outcome { id } => self.outcome(client, id, None).map(Some),
            RemoteRequest::Withdraw { id } => {
                let outcome = self.outcome(client, id, None)?;
                if outcome.state != RemoteState::New {
                    return Ok(Some(outcome));
                }
                self.book
                    .end(client, id, RemoteState::Withdrawn, String::new())?;
                Ok(Some(RemoteState::Withdrawn.into()))
            }
            RemoteRequest::Stop {} => {
                let stopped = self.stop();
                stopped.map_err(|error| RemoteRefusal::new(error.to_string(), true))?;
                Ok(None)
            }
            _ => Err(RemoteRefusal::new(
                "the request is not about motions",
                false,
            )),
        }
    }

    fn outcome(
        &mut self,
        client: &str,
        id: Id,
        digest: Option<u64>,
    ) -> Result<RemoteOutcome, RemoteRefusal> {
        if let Some(outcome) = self.book.look(client, id, digest)? {
            return Ok(outcome);
        }
        let request = self.book.request(client, id);
        let request = request.ok_or_else(|| {
            RemoteRefusal::new("the journal has lost the record of this motion", false)
        })?;
        // The motion has come, whatever the queue says; if it says nothing, nobody knows more.
        let settled = self.settle(client, id, request);
        settled.map_err(|error| RemoteRefusal::new(error.to_string(), true))
    }

    fn offer(
        &mut self,
        client: &str,
        id: Id,
        motion: &[u8],
        takes_control: bool,
    ) -> Result<RemoteOutcome, RemoteRefusal> {
        let digest = digest(motion);
        let outcome = self.outcome(client, id, Some(digest))?;
        if outcome.state != RemoteState::New {
            return Ok(outcome);
        }
        if !self.presence(|it| it.may_begin(client)) {
            let error = "motions of this client stop when it disconnects, and the gateway does not see it connected";
            return Err(RemoteRefusal::new(error, true));
        }
        // The queue takes requests in the order of their numbers.
        if let Some(((client, id), (request, ..))) = self.undecided.first_key_value() {
            let (client, id, request) = (client.clone(), *id, *request);
            let settled = self.settle(&client, id, request);
            settled.map_err(|error| RemoteRefusal::new(error.to_string(), true))?;
            if !self.undecided.is_empty() {
                return Err(RemoteRefusal::new(
                    "the queue has not answered for an earlier motion yet; try again",
                    true,
                ));
            }
        }
        let refused = |error: AnyError| RemoteRefusal::new(error.to_string(), true);
        let request = self.next_request(takes_control).map_err(refused)?;
        self.book.offer(client, id, digest, request)?;
        log::tell(client, &format!("offers motion {id}"));
        let kept = (request, motion.to_vec(), takes_control);
        self.undecided.insert((client.into(), id), kept);
        match self.settle(client, id, request) {
            Ok(outcome) => Ok(outcome),
            // The queue is asked again in the next turn.
            Err(_) => Ok(RemoteState::Offered.into()),
        }
    }

    /// Takes control, and returns the next identity of the session.
    fn next_request(&mut self, takes_control: bool) -> Result<RequestIdentity, AnyError> {
        let mut queue = connect(self.way.as_ref())?;
        let session = &mut self.session;
        session
            .take_control(&mut queue, takes_control, ANSWER)
            .map_err(|error| match error {
                ClientError::NotInControl(who) if who != InControl::Nobody => {
                    format!("{who}; `--control` takes control from it").into()
                }
                error => error.into(),
            })
    }

    /// Asks the queue what has become of a motion, and notes its end. Offers it again if the queue has not got it, and
    /// the motion is one of this incarnation.
    fn settle(
        &mut self,
        client: &str,
        id: Id,
        request: RequestIdentity,
    ) -> Result<RemoteOutcome, AnyError> {
        let mut queue = connect(self.way.as_ref())?;
        let seen = queue.look(request, ANSWER)?;
        let (mut answer, progress) = (seen.answer, seen.progress);
        let key = (client.to_owned(), id);
        if answer == QueueAnswer::New
            && let Some((_, motion, takes_control)) = self.undecided.get(&key)
        {
            let control = match queue.take_control(request.session, *takes_control, ANSWER) {
                // The queue refuses the motion, for good.
                Err(ClientError::NotInControl(_)) => Ok(()),
                taken => taken,
            };
            let offered = control.and_then(|()| host::offer(&mut queue, request, motion, ANSWER));
            answer = match offered {
                Ok(answer) => answer,
                // The session is closed: the queue will say that the motion never runs.
                Err(ClientError::NotYours) => QueueAnswer::New,
                Err(error) => return Err(error.into()),
            };
        }
        let state = state_of(answer);
        let reason = answer.reason().map(|it| it.to_string()).unwrap_or_default();
        if state != RemoteState::Offered {
            self.undecided.remove(&key);
        }
        if state.is_final() {
            self.book.end(client, id, state, reason.clone())?;
            log::tell(
                client,
                &format!(
                    "motion {id}: {state}{}{reason}",
                    if reason.is_empty() { "" } else { ", " }
                ),
            );
        }
        Ok(RemoteOutcome {
            state,
            reason,
            progress,
        })
    }

    /// Finds out what has become of all motions that have not ended, and stops those whose client is gone.
    pub(crate) fn turn(&mut self) {
        let now = Instant::now();
        let open: Vec<_> = self
            .book
            .open_motions()
            .map(|(client, id, request)| (client.to_owned(), id, request))
            .collect();
        let mut gone = None;
        for (client, id, request) in open {
            // The client that asks is told what is wrong.
            let Ok(outcome) = self.settle(&client, id, request) else {
                continue;
            };
            if !outcome.state.is_final() && self.presence(|it| it.must_stop(&client, now)) {
                gone = Some((client, id));
            }
        }
        if let Some((client, id)) = gone
            && self.stopped.is_none_or(|at| now - at >= ANSWER)
        {
            self.stopped = Some(now);
            let how = match self.stop() {
                Ok(()) => "all motion stops".into(),
                Err(error) => format!("the motion cannot be stopped: {error}"),
            };
            log::tell(
                &client,
                &format!("has disconnected, and motion {id} must stop then: {how}"),
            );
        }
    }

    fn presence<T>(&self, ask: impl FnOnce(&Presence) -> T) -> T {
        ask(&self.presence.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Ends all motion.
    fn stop(&mut self) -> Result<(), AnyError> {
        let mut queue = connect(self.way.as_ref())?;
        Ok(self.session.abort(&mut queue, true, ANSWER)?)
    }
}

fn connect(way: Option<&MotionsLink>) -> Result<QueueClient<'_>, AnyError> {
    let MotionsLink { view, status } = way.ok_or("the system is not running")?;
    Ok(host::connect(view, status)?)
}

fn state_of(answer: QueueAnswer) -> RemoteState {
    match answer {
        QueueAnswer::New => RemoteState::Offered,
        QueueAnswer::Never => RemoteState::Never,
        QueueAnswer::Forgotten | QueueAnswer::NoSession => RemoteState::Forgotten,
        QueueAnswer::Known(state, _) => match state {
            RequestState::Accepted => RemoteState::Accepted,
            RequestState::Started => RemoteState::Started,
            RequestState::Done => RemoteState::Done,
            RequestState::Stopped => RemoteState::Stopped,
            RequestState::Aborted => RemoteState::Aborted,
            RequestState::Refused => RemoteState::Refused,
            RequestState::Lost => RemoteState::Lost,
            RequestState::BrokenOff => RemoteState::BrokenOff,
            // Of a later version: it is not final, so nobody is told that it has ended.
            _ => RemoteState::Offered,
        },
    }
}
