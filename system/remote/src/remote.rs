//! [`Remote`]: a robot, as a client reaches it.

use std::hash::{BuildHasher as _, Hasher as _, RandomState};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use serde::de::DeserializeOwned;
use serde_json::Value as Json;
use zenoh::Wait;
use zenoh::handlers::FifoChannel;
use zenoh::liveliness::LivelinessToken;
use zenoh::query::{QueryTarget, Reply};

use crate::error::RemoteError;
use crate::network::Network;
use crate::stream::RemoteStream;
use crate::wire::{self, Id, RemoteOutcome, RemoteRefusal, RemoteRequest, RemoteTopic};

/// The longest time of one query: what is lost on the way is asked for again after it.
const QUERY: Duration = Duration::from_secs(1);

/// A client's access to one robot: its state, its variables, its motions and its streams. As long as this value exists,
/// the gateway counts the client as present.
#[derive(Debug)]
pub struct Remote {
    network: Network,
    robot: String,
    /// The last identity of a motion.
    last: Mutex<Option<Id>>,
    _here: LivelinessToken,
}

impl Remote {
    /// Makes the access to the robot called `robot`. It does not wait for the robot.
    ///
    /// # Errors
    /// Returns [`RemoteError::Name`] if `robot` is not a valid name; [`RemoteError::Zenoh`] if zenoh fails.
    pub fn new(network: &Network, robot: &str) -> Result<Self, RemoteError> {
        wire::check_name("robot", robot).map_err(RemoteError::Name)?;
        // Its keys are random.
        let token = RandomState::new().build_hasher().finish();
        let key = wire::here(robot, &network.client, token);
        let here = network.session.liveliness().declare_token(key).wait()?;
        Ok(Self {
            network: network.clone(),
            robot: robot.into(),
            last: Mutex::new(None),
            _here: here,
        })
    }

    /// Returns the state of the robot's processors and services, as the JSON object that `condor ps --json` prints on
    /// the robot. Waits for the answer, `timeout` at most.
    ///
    /// # Errors
    /// [`RemoteError::Refused`] if the gateway refuses; [`RemoteError::NoAnswer`] if no answer comes within
    /// `timeout`; [`RemoteError::Strange`] if the answer cannot be read; [`RemoteError::Zenoh`] if zenoh
    /// fails.
    pub fn status(&self, timeout: Duration) -> Result<Json, RemoteError> {
        self.ask_until(&RemoteRequest::Status {}, &[], timeout)
    }

    /// Returns the topics to which the client can [subscribe](Self::subscribe). Waits for the answer, `timeout` at
    /// most.
    ///
    /// # Errors
    /// [`RemoteError::Refused`] if the gateway refuses; [`RemoteError::NoAnswer`] if no answer comes within
    /// `timeout`; [`RemoteError::Strange`] if the answer cannot be read; [`RemoteError::Zenoh`] if zenoh
    /// fails.
    pub fn topics(&self, timeout: Duration) -> Result<Vec<RemoteTopic>, RemoteError> {
        self.ask_until(&RemoteRequest::Topics {}, &[], timeout)
    }

    /// Returns a JSON object for each variable, parameter and field of a published cell in `names`, with its present
    /// value, as `condor vars get --json` prints it. If `names` is empty, these are all of them, as `condor vars list
    /// --json` prints them: variables have no value then. Waits for the answer, `timeout` at most.
    ///
    /// # Errors
    /// [`RemoteError::Refused`] if the gateway refuses; [`RemoteError::NoAnswer`] if no answer comes within
    /// `timeout`; [`RemoteError::Strange`] if the answer cannot be read; [`RemoteError::Zenoh`] if zenoh
    /// fails.
    pub fn variables(&self, names: &[String], timeout: Duration) -> Result<Vec<Json>, RemoteError> {
        let names = names.to_vec();
        self.ask_until(&RemoteRequest::Variables { names }, &[], timeout)
    }

    /// Returns the present value of the variable, parameter or field of a published cell called `name`. Waits for the
    /// answer, `timeout` at most.
    ///
    /// # Errors
    /// [`RemoteError::Refused`] if the gateway refuses; [`RemoteError::NoAnswer`] if no answer comes within
    /// `timeout`; [`RemoteError::Strange`] if the answer cannot be read; [`RemoteError::Zenoh`] if zenoh
    /// fails.
    pub fn get(&self, name: &str, timeout: Duration) -> Result<Json, RemoteError> {
        self.ask_until(&RemoteRequest::Get { name: name.into() }, &[], timeout)
    }

    /// Sets the parameter called `name` to `value`, and returns its previous value. If `from` is a value, the parameter
    /// is set only if it has that value. Waits for the answer, `timeout` at most.
    ///
    /// # Errors
    /// [`RemoteError::Refused`] if the gateway refuses; [`RemoteError::NoAnswer`] if no answer comes within
    /// `timeout`; [`RemoteError::Strange`] if the answer cannot be read; [`RemoteError::Zenoh`] if zenoh
    /// fails. After [`RemoteError::NoAnswer`] the parameter may have been set, or not.
    pub fn set(
        &self,
        name: &str,
        from: Option<Json>,
        value: Json,
        timeout: Duration,
    ) -> Result<Json, RemoteError> {
        let name = name.into();
        self.ask(&RemoteRequest::Set { name, from, value }, &[], timeout)
    }

    /// Sends a message with the word `data` to a vector of the processor called `processor`, and returns the reply.
    /// `vector` is the name or the number of the vector. Waits for the answer, `timeout` at most.
    ///
    /// # Errors
    /// [`RemoteError::Refused`] if the gateway refuses; [`RemoteError::NoAnswer`] if no answer comes within
    /// `timeout`; [`RemoteError::Strange`] if the answer cannot be read; [`RemoteError::Zenoh`] if zenoh
    /// fails. After [`RemoteError::NoAnswer`] the program may have received the message, once.
    pub fn send(
        &self,
        processor: &str,
        vector: &str,
        data: u32,
        timeout: Duration,
    ) -> Result<u32, RemoteError> {
        let (processor, vector) = (processor.into(), vector.into());
        let request = RemoteRequest::Send {
            processor,
            vector,
            data,
        };
        self.ask(&request, &[], timeout)
    }

    /// Returns a new identity for a motion to [`offer`](Self::offer). Waits for the gateway, `timeout` at most.
    ///
    /// # Errors
    /// [`RemoteError::Refused`] if the gateway refuses; [`RemoteError::NoAnswer`] if no answer comes within
    /// `timeout`; [`RemoteError::Strange`] if the answer cannot be read; [`RemoteError::Zenoh`] if zenoh
    /// fails.
    pub fn next_id(&self, timeout: Duration) -> Result<Id, RemoteError> {
        // No other thread may get the same one.
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        let request = RemoteRequest::NextId { last: *last };
        let next = self.ask_until(&request, &[], timeout)?;
        *last = Some(next);
        Ok(next)
    }

    /// Enqueues a motion, and waits until the robot has accepted or refused it, `timeout` at most. `motion` are the
    /// bytes that the robot reads, such as the name of a motion. With `takes_control`, the motion may take control from
    /// another program.
    ///
    /// `id` comes from [`next_id`](Self::next_id). The same motion may be offered again under the same `id`, as often
    /// as needed: it runs at most once.
    ///
    /// # Errors
    /// [`RemoteError::Refused`] if the gateway refuses; [`RemoteError::NoAnswer`] if no answer comes within `timeout`;
    /// [`RemoteError::Strange`] if the answer cannot be read; [`RemoteError::Zenoh`] if zenoh fails.
    ///
    /// After any of these errors the motion may still run. Ask for its [`outcome`](Self::outcome), or
    /// [withdraw](Self::withdraw) it.
    pub fn offer(
        &self,
        id: Id,
        motion: &[u8],
        takes_control: bool,
        timeout: Duration,
    ) -> Result<RemoteOutcome, RemoteError> {
        let request = RemoteRequest::Offer { id, takes_control };
        self.ask_until(&request, motion, timeout)
    }

    /// Returns the present state of the motion `id`, which an earlier incarnation of the client may have offered. Waits
    /// for the answer, `timeout` at most.
    ///
    /// # Errors
    /// [`RemoteError::Refused`] if the gateway refuses; [`RemoteError::NoAnswer`] if no answer comes within
    /// `timeout`; [`RemoteError::Strange`] if the answer cannot be read; [`RemoteError::Zenoh`] if zenoh
    /// fails.
    pub fn outcome(&self, id: Id, timeout: Duration) -> Result<RemoteOutcome, RemoteError> {
        self.ask_until(&RemoteRequest::Outcome { id }, &[], timeout)
    }

    /// Withdraws the motion `id`: if the robot has not received it yet, it never runs. Returns the state of the
    /// motion, which may be running if it was received. Call this after an error of [`offer`](Self::offer), if the
    /// motion is not wanted any more.
    ///
    /// # Errors
    /// [`RemoteError::Refused`] if the gateway refuses; [`RemoteError::NoAnswer`] if no answer comes within
    /// `timeout`; [`RemoteError::Strange`] if the answer cannot be read; [`RemoteError::Zenoh`] if zenoh
    /// fails.
    pub fn withdraw(&self, id: Id, timeout: Duration) -> Result<RemoteOutcome, RemoteError> {
        self.ask_until(&RemoteRequest::Withdraw { id }, &[], timeout)
    }

    /// Waits until the motion `id`, which was [offered](Self::offer), has ended or will certainly not run, `timeout` at
    /// most. Returns its final outcome.
    ///
    /// # Errors
    /// [`RemoteError::Refused`] if the gateway refuses; [`RemoteError::NoAnswer`] if no answer comes within
    /// `timeout`; [`RemoteError::Strange`] if the answer cannot be read; [`RemoteError::Zenoh`] if zenoh
    /// fails. [`RemoteError::NoAnswer`] also if the motion has not ended within `timeout`.
    pub fn wait(&self, id: Id, timeout: Duration) -> Result<RemoteOutcome, RemoteError> {
        let deadline = Instant::now() + timeout;
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            let outcome = self.outcome(id, left)?;
            if outcome.state.is_final() {
                return Ok(outcome);
            }
            if Instant::now() >= deadline {
                return Err(self.no_answer(timeout));
            }
            std::thread::sleep(crate::PAUSE);
        }
    }

    /// Offers a motion under a new identity, and waits for its end, `timeout` at most for both. `motion` are the bytes
    /// that the robot reads, such as the name of a motion. Returns the final outcome. The motion does not take control
    /// from another program.
    ///
    /// # Errors
    /// Returns the error of [`next_id`](Self::next_id), [`offer`](Self::offer) or [`wait`](Self::wait) if
    /// one of them fails.
    pub fn run(&self, motion: &[u8], timeout: Duration) -> Result<RemoteOutcome, RemoteError> {
        let deadline = Instant::now() + timeout;
        let left = || deadline.saturating_duration_since(Instant::now());
        let id = self.next_id(left())?;
        let outcome = self.offer(id, motion, false, left())?;
        if outcome.state.is_final() {
            return Ok(outcome);
        }
        self.wait(id, left())
    }

    /// Aborts the motion that runs, and all that wait, also those of other clients. The joints brake within their
    /// limits. This is not an emergency stop. Waits for the answer, `timeout` at most.
    ///
    /// # Errors
    /// [`RemoteError::Refused`] if the gateway refuses; [`RemoteError::NoAnswer`] if no answer comes within
    /// `timeout`; [`RemoteError::Strange`] if the answer cannot be read; [`RemoteError::Zenoh`] if zenoh
    /// fails.
    pub fn stop(&self, timeout: Duration) -> Result<(), RemoteError> {
        self.ask_until::<Json>(&RemoteRequest::Stop {}, &[], timeout)
            .map(drop)
    }

    /// Subscribes to the topic called `name`, such as `/servo_a/servo`. If no topic has this name, `name` may be a part
    /// of the name of exactly one topic. Waits for the list of topics, `timeout` at most.
    ///
    /// # Errors
    /// Returns [`RemoteError::NoTopic`] if no topic has the name `name`, and none or several have it as a part of their
    /// names; another [`RemoteError`] if [`topics`](Self::topics) fails, or if zenoh fails.
    pub fn subscribe(&self, name: &str, timeout: Duration) -> Result<RemoteStream, RemoteError> {
        let topics = self.topics(timeout)?;
        let exact = topics.iter().find(|topic| topic.name == name);
        let mut parts = topics.iter().filter(|topic| topic.name.contains(name));
        let topic = match (exact, parts.next(), parts.next()) {
            (Some(exact), ..) => exact,
            (None, Some(only), None) => only,
            _ => {
                let there = topics.iter().map(|topic| topic.name.clone()).collect();
                let name = name.into();
                return Err(RemoteError::NoTopic { name, there });
            }
        };
        RemoteStream::open(&self.network, &self.robot, topic)
    }

    /// Asks again until there is an answer that stays. Only for requests that may be carried out twice.
    fn ask_until<T: DeserializeOwned>(
        &self,
        request: &RemoteRequest,
        motion: &[u8],
        timeout: Duration,
    ) -> Result<T, RemoteError> {
        let deadline = Instant::now() + timeout;
        let mut refused = None;
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            match self.ask(request, motion, QUERY.min(left)) {
                // The last query may have had hardly any time: then the refusal before it says more.
                Err(RemoteError::NoAnswer { .. }) if left < QUERY => {}
                Err(RemoteError::NoAnswer { .. }) => refused = None,
                Err(RemoteError::Refused(refusal)) if refusal.again => refused = Some(refusal),
                answer => return answer,
            }
            if Instant::now() >= deadline {
                return Err(refused.map_or_else(|| self.no_answer(timeout), RemoteError::from));
            }
            std::thread::sleep(crate::PAUSE);
        }
    }

    /// Asks once.
    fn ask<T: DeserializeOwned>(
        &self,
        request: &RemoteRequest,
        motion: &[u8],
        timeout: Duration,
    ) -> Result<T, RemoteError> {
        let key = wire::by(&self.robot, &self.network.client, request.right().word());
        let query = self.network.session.get(key).payload(request.payload());
        let query = query.timeout(timeout).target(QueryTarget::BestMatching);
        let query = query.with(FifoChannel::new(4));
        let query = if motion.is_empty() {
            query
        } else {
            query.attachment(motion)
        };
        let replies = query.wait()?;
        match replies.recv_timeout(timeout) {
            Ok(Some(reply)) => read(&reply).unwrap_or_else(|| Err(self.no_answer(timeout))),
            _ => Err(self.no_answer(timeout)),
        }
    }

    fn no_answer(&self, timeout: Duration) -> RemoteError {
        let robot = self.robot.clone();
        RemoteError::NoAnswer { robot, timeout }
    }
}

/// Reads an answer; `None` if zenoh says that none has come.
fn read<T: DeserializeOwned>(reply: &Reply) -> Option<Result<T, RemoteError>> {
    let strange = |bytes: &[u8]| {
        let text: String = String::from_utf8_lossy(bytes).chars().take(200).collect();
        RemoteError::Strange(text)
    };
    Some(match reply.result() {
        Ok(sample) => {
            let bytes = sample.payload().to_bytes();
            serde_json::from_slice(&bytes).map_err(|_| strange(&bytes))
        }
        Err(error) => {
            let refusal: RemoteRefusal =
                serde_json::from_slice(&error.payload().to_bytes()).ok()?;
            Err(refusal.into())
        }
    })
}
