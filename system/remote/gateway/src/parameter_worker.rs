//! [`ParameterWorker`]: answers requests about states, variables, parameters and messages.

use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use condor_host::answers;
use condor_host::error::AnyError;
use condor_host::view::View;
use condor_host::watching::{CatalogEntry, Clients, VariableCatalog};
use condor_mbox::Messenger;
use condor_remote::wire::{ClientRequest, RemoteRefusal, RemoteRequest, RemoteTopic};
use serde_json::{Value as Json, json};

use crate::job::Job;
use crate::log;
use crate::system::{RunningSystem, SystemChoice, status};

/// The time between two looks for a system that does not run.
const LOOK: Duration = Duration::from_millis(200);
/// The time that a program may take to reply to a message.
const REPLY: Duration = Duration::from_secs(2);

/// The thread that answers these requests.
pub(crate) struct ParameterWorker {
    /// The system that is served.
    pub(crate) which: SystemChoice,
    /// The requests.
    pub(crate) jobs: Receiver<Job>,
    /// The topics of the streams, while there are some.
    pub(crate) topics: Arc<Mutex<Vec<RemoteTopic>>>,
}

impl ParameterWorker {
    /// Answers until nobody can ask any more.
    pub(crate) fn work(&self) {
        loop {
            let why = match self.serve() {
                Ok(true) => return,
                Ok(false) => "the system has ended".to_owned(),
                Err(error) => error.to_string(),
            };
            match self.jobs.recv_timeout(LOOK) {
                Ok(job) => job.refuse(&RemoteRefusal::new(why, true)),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return,
            }
        }
    }

    /// Answers as long as the system runs; returns true if nobody can ask any more.
    fn serve(&self) -> Result<bool, AnyError> {
        let mut found = self.which.find()?;
        let mut view = View::open(&found.directory, found.status.window_bytes)?;
        view.join()?;
        let mut clients = Clients::new(&view);
        while found.is_there() {
            match self.jobs.recv_timeout(LOOK) {
                Ok(job) => {
                    let answer = self.answer(&job.asked, &found, &view, &mut clients);
                    job.answer(
                        answer.map_err(|error| RemoteRefusal::new(error.to_string(), false)),
                    );
                }
                Err(RecvTimeoutError::Timeout) => {
                    // A sender of messages to this visitor is answered that it has no such handler.
                    view.post().serve(Duration::ZERO)?;
                }
                Err(RecvTimeoutError::Disconnected) => return Ok(true),
            }
        }
        Ok(false)
    }

    fn answer(
        &self,
        asked: &ClientRequest,
        found: &RunningSystem,
        view: &View,
        clients: &mut Clients<'_>,
    ) -> Result<Json, AnyError> {
        match &asked.request {
            RemoteRequest::Status {} => {
                let status = status(&found.directory)?;
                Ok(serde_json::to_value(answers::processors(&status, view)?)?)
            }
            RemoteRequest::Topics {} => {
                let topics = self.topics.lock().unwrap_or_else(PoisonError::into_inner);
                Ok(serde_json::to_value(&*topics)?)
            }
            RemoteRequest::Variables { names } => {
                answers::variables(&found.status, view, clients, names)
            }
            RemoteRequest::Get { name } => {
                let known = VariableCatalog::all(view, &found.status.processors)?;
                let one = known.find(name)?;
                let values = answers::values(clients, &[one])?;
                let value = values.into_iter().flatten().next();
                Ok(value.map_or(Json::Null, |value| one.of.json(value)))
            }
            RemoteRequest::Set { name, from, value } => {
                let set = set(found, view, clients, name, from.as_ref(), value);
                let how = match &set {
                    Ok(before) => format!("it was {before} before"),
                    Err(error) => error.to_string(),
                };
                log::tell(&asked.client, &format!("sets {name} to {value}: {how}"));
                set
            }
            RemoteRequest::Send {
                processor,
                vector,
                data,
            } => {
                let reply = send(found, view, processor, vector, *data);
                let how = match &reply {
                    Ok(reply) => format!("the reply is {reply}"),
                    Err(error) => error.to_string(),
                };
                let text = format!("sends {data} to vector {vector} of {processor}: {how}");
                log::tell(&asked.client, &text);
                reply.map(|reply| json!(reply))
            }
            _ => Err(
                "the request is about motions, which this part of the gateway does not serve"
                    .into(),
            ),
        }
    }
}

fn send(
    found: &RunningSystem,
    view: &View,
    processor: &str,
    vector: &str,
    data: u32,
) -> Result<u32, AnyError> {
    let member = found.status.member(processor)?;
    let vector = view.vector(member, vector)?;
    let reply = view
        .post()
        .send_with_reply(member.processor(), vector, data, REPLY);
    Ok(reply?)
}

/// Sets a parameter from one value to another. Programs may have been restarted since the last request, so it looks for
/// the name anew.
fn set(
    found: &RunningSystem,
    view: &View,
    clients: &mut Clients<'_>,
    name: &str,
    from: Option<&Json>,
    new: &Json,
) -> Result<Json, AnyError> {
    let known = VariableCatalog::all(view, &found.status.processors)?;
    let one = known.parameter(name)?;
    let from = from.map(|from| parse(one, from)).transpose()?;
    let new = parse(one, new)?;
    let before = clients.set(name, one, from, new)?;
    Ok(one.of.json(before))
}

/// Reads a value of JSON. A text is the label of a choice.
fn parse(one: &CatalogEntry, value: &Json) -> Result<condor_vars::AnyValue, String> {
    match value {
        Json::String(label) if !one.of.labels.is_empty() => one.of.parse(label),
        value => one.of.parse(&value.to_string()),
    }
}
