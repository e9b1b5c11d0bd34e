//! [`Gateway`]: serves a system until it is dropped.

use std::collections::BTreeMap;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use condor_host::error::AnyError;
use condor_remote::wire::{
    ClientRequest, RemoteRefusal, RemoteRequest, alive, all_here, by, client_of,
};
use zenoh::liveliness::LivelinessToken;
use zenoh::query::Query;
use zenoh::sample::SampleKind;
use zenoh::{Session, Wait};

use crate::config::Config;
use crate::feed::Feed;
use crate::job::{Job, refuse};
use crate::log;
use crate::motions::{Motions, MotionsLink};
use crate::parameter_worker::ParameterWorker;
use crate::presence::Presence;
use crate::system::SystemChoice;

/// The greatest number of requests that wait for a thread; more are refused.
const WAITING: usize = 64;
/// The time between two looks what has become of motions.
const LOOK: Duration = Duration::from_millis(20);
/// The time between two attempts to find the system.
const AGAIN: Duration = Duration::from_millis(100);
/// The least time between two lines of the log about refusals to one client.
const REPORT: Duration = Duration::from_secs(1);

/// A running gateway, which serves a system to clients on other machines.
pub struct Gateway {
    session: Session,
    _alive: LivelinessToken,
}

impl Gateway {
    /// Starts a gateway with the configuration `config` for the system `which`: opens the session of
    /// zenoh, and starts the threads that serve clients. It does not wait for the system.
    ///
    /// # Errors
    /// Returns an error if the session of zenoh cannot be opened; the text says why.
    pub fn start(config: &Config, which: &SystemChoice) -> Result<Self, AnyError> {
        let presence = Presence::new(config.stops(), config.grace(), Instant::now());
        let presence = Arc::new(Mutex::new(presence));
        let session = zenoh::open(config.zenoh()?).wait();
        let session = session.map_err(|error| error.to_string())?;
        let gateway = Self::declare(config, which, session, &presence);
        let (gateway, motions) = gateway.map_err(|error| error.to_string())?;
        let which = which.clone();
        thread::spawn(move || keep(Motions::new(presence), &which, &motions));
        Ok(gateway)
    }

    fn declare(
        config: &Config,
        which: &SystemChoice,
        session: Session,
        presence: &Arc<Mutex<Presence>>,
    ) -> zenoh::Result<(Self, Receiver<Job>)> {
        let robot = config.robot.clone();
        let presence = presence.clone();
        let of = robot.clone();
        let here = session
            .liveliness()
            .declare_subscriber(all_here(&robot, "*"));
        let here = here.history(true).callback(move |sample| {
            if let Some((client, token)) = client_of(&of, sample.key_expr().as_str()) {
                let is_here = sample.kind() == SampleKind::Put;
                let mut presence = presence.lock().unwrap_or_else(PoisonError::into_inner);
                presence.set(&client, token, is_here, Instant::now());
            }
        });
        here.background().wait()?;
        let topics = Arc::new(Mutex::new(Vec::new()));
        let (parameters, jobs) = sync_channel(WAITING);
        let (motions, of_motions) = sync_channel(WAITING);
        let own = ParameterWorker {
            which: which.clone(),
            jobs,
            topics: topics.clone(),
        };
        thread::spawn(move || own.work());
        let feed = Feed {
            which: which.clone(),
            session: session.clone(),
            robot: robot.clone(),
            variables: config.variables.clone(),
            every: config.every,
            topics,
        };
        thread::spawn(move || feed.work());
        let door = Door {
            config: config.clone(),
            parameters,
            motions,
            reported: Mutex::new(BTreeMap::new()),
        };
        let queryable = session.declare_queryable(by(&robot, "*", "*"));
        let queryable = queryable
            .complete(true)
            .callback(move |query| door.take(query));
        queryable.background().wait()?;
        let alive = session.liveliness().declare_token(alive(&robot)).wait()?;
        let gateway = Self {
            session,
            _alive: alive,
        };
        Ok((gateway, of_motions))
    }
}

impl Drop for Gateway {
    fn drop(&mut self) {
        // The session ends with the process in any case.
        let _ = self.session.close().wait();
    }
}

/// The entry of requests, which checks them.
struct Door {
    config: Config,
    parameters: SyncSender<Job>,
    motions: SyncSender<Job>,
    /// When refusals to each client were told last, and how many were not.
    reported: Mutex<BTreeMap<String, (Instant, u64)>>,
}

impl Door {
    /// Checks a request, and passes it to its thread. It never waits.
    fn take(&self, query: Query) {
        let bytes = |bytes: Option<&zenoh::bytes::ZBytes>| {
            bytes
                .map(|it| it.to_bytes().into_owned())
                .unwrap_or_default()
        };
        let (payload, attachment) = (bytes(query.payload()), bytes(query.attachment()));
        let key = query.key_expr().as_str();
        let asked = ClientRequest::read(&self.config.robot, key, &payload, &attachment);
        let asked = asked.and_then(|asked| {
            let right = asked.request.right();
            if self.config.may(&asked.client, right) {
                return Ok(asked);
            }
            let (client, right) = (&asked.client, right.word());
            self.tell(client, right);
            let error = format!(
                "the client `{client}` does not have the right `{right}`; the gateway's \
                                 configuration grants rights"
            );
            Err(RemoteRefusal::new(error, false))
        });
        let job = match asked {
            Ok(asked) => Job { asked, query },
            Err(refusal) => return refuse(&query, &refusal),
        };
        let to = match job.asked.request {
            RemoteRequest::NextId { .. }
            | RemoteRequest::Offer { .. }
            | RemoteRequest::Outcome { .. }
            | RemoteRequest::Withdraw { .. }
            | RemoteRequest::Stop {} => &self.motions,
            _ => &self.parameters,
        };
        if let Err(TrySendError::Full(job) | TrySendError::Disconnected(job)) = to.try_send(job) {
            job.refuse(&RemoteRefusal::new(
                format!("{WAITING} requests are waiting already; try again"),
                true,
            ));
        }
    }

    /// Tells that a client was refused, once a second at most.
    fn tell(&self, client: &str, right: &str) {
        let now = Instant::now();
        let mut reported = self.reported.lock().unwrap_or_else(PoisonError::into_inner);
        reported.retain(|_, (at, _)| now.duration_since(*at) < REPORT);
        // Names are made up easily.
        if reported.len() < WAITING && !reported.contains_key(client) {
            reported.insert(client.into(), (now, 0));
            log::tell(
                client,
                &format!("was refused: it does not have the right `{right}`"),
            );
        }
    }
}

/// Carries out requests about motions, and looks what has become of those that have not ended.
fn keep(mut keeper: Motions, which: &SystemChoice, jobs: &Receiver<Job>) {
    let mut found = None;
    let mut looked: Option<Instant> = None;
    let mut turned = Instant::now();
    loop {
        // However much is asked for: clients may be gone whose motions must stop.
        if turned.elapsed() >= LOOK {
            keeper.turn();
            turned = Instant::now();
        }
        if found
            .as_mut()
            .is_some_and(|it: &mut crate::system::RunningSystem| !it.is_there())
        {
            found = None;
            keeper.set_way(None);
        }
        if !keeper.has_way() && looked.is_none_or(|at| at.elapsed() >= AGAIN) {
            looked = Some(Instant::now());
            let there = which.find();
            let way =
                there.and_then(|it| Ok((MotionsLink::find(&it.directory, it.status.clone())?, it)));
            // The client is told that the system does not run.
            if let Ok((way, there)) = way {
                keeper.set_way(Some(way));
                found = Some(there);
            }
        }
        match jobs.recv_timeout(LOOK.saturating_sub(turned.elapsed())) {
            Ok(job) => job.answer(keeper.answer(&job.asked)),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return,
        }
    }
}
