//! [`Desk`]: answers requests about states, variables, parameters and messages.

use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use condor_host::cli::AnyError;
use condor_host::streams::Parameters;
use condor_host::view::View;
use condor_mbox::{Messenger, Vector};
use condor_remote::wire::{Asked, Refusal, Request, Topic};
use serde_json::{Value as Json, json};

use crate::job::Job;
use crate::log;
use crate::system::{Found, Which, status};

/// The time between two looks for a system that does not run.
const LOOK: Duration = Duration::from_millis(200);
/// How long a program may take to reply to a message.
const REPLY: Duration = Duration::from_secs(2);

/// The thread that answers these requests.
pub(crate) struct Desk {
    /// The system that is served.
    pub(crate) which: Which,
    /// The requests.
    pub(crate) jobs: Receiver<Job>,
    /// The topics of the streams, while there are some.
    pub(crate) topics: Arc<Mutex<Vec<Topic>>>,
}

impl Desk {
    /// Answers until nobody can ask any more.
    pub(crate) fn work(&self) {
        loop {
            let why = match self.serve() {
                Ok(true) => return,
                Ok(false) => "the system has ended".to_owned(),
                Err(error) => error.to_string(),
            };
            match self.jobs.recv_timeout(LOOK) {
                Ok(job) => job.refuse(&Refusal::new(why, true)),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return,
            }
        }
    }

    /// Answers as long as the system runs; returns whether nobody can ask any more.
    fn serve(&self) -> Result<bool, AnyError> {
        let mut found = self.which.find()?;
        let mut view = View::open(&found.directory, found.status.window_bytes)?;
        view.join()?;
        let mut parameters = Parameters::new(&view);
        while found.is_there() {
            match self.jobs.recv_timeout(LOOK) {
                Ok(job) => {
                    let answer = self.answer(&job.asked, &found, &view, &mut parameters);
                    job.answer(answer.map_err(|error| Refusal::new(error.to_string(), false)));
                }
                Err(RecvTimeoutError::Timeout) => {
                    // Whoever sends to this visitor is answered that it has no such handler.
                    view.post().serve(Duration::ZERO)?;
                }
                Err(RecvTimeoutError::Disconnected) => return Ok(true),
            }
        }
        Ok(false)
    }

    fn answer(
        &self,
        asked: &Asked,
        found: &Found,
        view: &View,
        parameters: &mut Parameters<'_>,
    ) -> Result<Json, AnyError> {
        let members = &found.status.processors;
        match &asked.request {
            Request::Status {} => Ok(serde_json::to_value(status(&found.directory)?)?),
            Request::Topics {} => {
                let topics = self.topics.lock().unwrap_or_else(PoisonError::into_inner);
                Ok(serde_json::to_value(&*topics)?)
            }
            Request::Variables {} => parameters.list(members),
            Request::Get { name } => parameters.get(members, name),
            Request::Set { name, from, value } => {
                let set = parameters.set(members, name, from.as_ref(), value);
                let how = match &set {
                    Ok(before) => format!("it was {before}"),
                    Err(error) => error.to_string(),
                };
                log::tell(&asked.client, &format!("sets {name} to {value}: {how}"));
                set
            }
            Request::Send {
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
            _ => Err("this is a request about motions".into()),
        }
    }
}

fn send(
    found: &Found,
    view: &View,
    processor: &str,
    vector: &str,
    data: u32,
) -> Result<u32, AnyError> {
    let mut members = found.status.members();
    let member = members.find(|it| it.name == processor);
    let member = member.ok_or_else(|| {
        let there: Vec<_> = found.status.members().map(|it| it.name.as_str()).collect();
        format!(
            "there is no processor `{processor}`; there are {}",
            there.join(", ")
        )
    })?;
    let there = view.vectors(member.processor())?;
    let by_name = there
        .iter()
        .find(|it| it.name == vector)
        .map(|it| it.vector);
    let number = by_name.or_else(|| vector.parse().ok());
    let number = number.filter(|it| usize::from(*it) < Vector::COUNT);
    let number = number.ok_or_else(|| {
        let names: Vec<_> = there
            .iter()
            .map(|it| it.name.as_str())
            .filter(|it| !it.is_empty())
            .collect();
        format!(
            "{processor} has no vector `{vector}`; there are {}",
            names.join(", ")
        )
    })?;
    Ok(view
        .post()
        .send_with_reply(member.processor(), Vector(number), data, REPLY)?)
}
