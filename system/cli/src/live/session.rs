//! [`Session`]: what one client has asked for, and what it is to be sent.
//!
//! Nothing here waits or grows without bound: of the samples of a channel, a client that reads too
//! slowly loses the oldest.

use std::collections::{BTreeMap, VecDeque};
use std::rc::Rc;
use std::time::{Duration, Instant};

use condor_ros2::{ENCODING, SCHEMA_ENCODING};
use serde_json::Value as Json;

use super::calls::{Call, Calls, Service};
use super::protocol::{
    self, Answer, ChannelDescription, JSON, Level, Parameter, Request, ServiceCall, Wish,
};
use crate::listening::Trust;

/// The greatest number of samples of a channel that wait for a client.
pub(crate) const QUEUE: usize = 1024;
/// The greatest number of answers that wait for a client. Nothing more is read from it until some are
/// sent.
pub(crate) const REPLIES: usize = 64;
/// The longest name of a question, in bytes.
const ID: usize = 256;
/// The greatest number of troubles that a status names.
const TROUBLES: usize = 8;
/// The number of characters that are told of the reason of a failure.
const REASON: usize = 4 << 10;
/// The least time between two statuses of lost samples.
const TELLING: Duration = Duration::from_secs(1);

/// The offer of the server to all clients: its channels, services and parameters.
#[derive(Default)]
pub(crate) struct Catalog {
    /// The name of the system.
    pub(crate) name: String,
    /// Another one each time that the server starts, so that clients forget what was before.
    pub(crate) session: String,
    /// Whether clients are told the time, because it is simulated.
    pub(crate) has_time: bool,
    /// The channels; the place of each is its number.
    pub(crate) channels: Vec<Channel>,
    /// The services; the place of each is its number.
    pub(crate) services: Vec<Service>,
    /// The shortest name of each parameter.
    pub(crate) parameters: Vec<String>,
    /// All names that a parameter has, each with its place in `parameters`.
    pub(crate) names: BTreeMap<String, usize>,
}

/// A channel: messages of one type.
pub(crate) struct Channel {
    pub(crate) topic: String,
    /// The name of the type, such as `sensor_msgs/msg/JointState`.
    pub(crate) schema_name: String,
    /// The definition of the type, in the language of `.msg` files.
    pub(crate) schema: String,
    /// A message that everybody gets who subscribes, and its time in ns.
    pub(crate) latched: Option<(u64, Rc<[u8]>)>,
    /// Whether a client with a pace gets all of its messages, too.
    pub(crate) is_whole: bool,
}

impl Channel {
    fn advertised(&self, id: u32) -> ChannelDescription<'_> {
        ChannelDescription {
            id,
            topic: &self.topic,
            encoding: ENCODING,
            schema_name: &self.schema_name,
            schema: &self.schema,
            schema_encoding: SCHEMA_ENCODING,
        }
    }
}

/// A question of a client that only the programs of the system can answer. The client gets the
/// [`answer`](Session::answer).
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Ask {
    Get {
        /// The names by which the client has asked, and the places of the parameters.
        wanted: BTreeMap<String, usize>,
        id: Option<String>,
    },
    Set {
        /// Names, places and new values; `None` leaves the value, which is told nevertheless.
        wanted: Vec<(String, usize, Option<Json>)>,
        id: Option<String>,
    },
}

/// A frame to send.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Frame {
    Text(String),
    Binary(Vec<u8>),
}

/// A client.
pub(crate) struct Session {
    trust: Trust,
    pace: Option<Pace>,
    /// The subscriptions, by the number that the client has chosen.
    subscriptions: BTreeMap<u32, Subscription>,
    /// The parameters of which the client wants to know changes, by the names that it uses.
    watched: BTreeMap<String, usize>,
    /// Changes of which it was not told yet.
    changed: BTreeMap<String, Parameter>,
    replies: VecDeque<String>,
    pub(crate) calls: Calls,
    /// The number of questions that are not answered yet.
    asked: usize,
    time_ns: Option<u64>,
    /// The number of the next sample.
    order: u64,
    lost: Lost,
    /// The number of samples that were sent.
    pub(crate) sent: u64,
}

/// The rate at which a client gets samples, of each channel the newest.
struct Pace {
    least: Duration,
    /// When the next samples go.
    due: Option<Instant>,
}

struct Subscription {
    channel: usize,
    is_whole: bool,
    queue: VecDeque<Sample>,
}

struct Sample {
    order: u64,
    at_ns: u64,
    payload: Rc<[u8]>,
}

#[derive(Default)]
struct Lost {
    all: u64,
    /// The number of samples lost since the client was told last, by channel.
    untold: BTreeMap<usize, u64>,
    told: Option<Instant>,
}

impl Session {
    /// Begins a session, whose first frames say what there is. With `pace`, the client gets the newest sample of
    /// each channel after that time, and no others.
    pub(crate) fn new(trust: Trust, pace: Option<Duration>, catalog: &Catalog) -> Self {
        let time: &[&str] = if catalog.has_time { &["time"] } else { &[] };
        let has_services = !catalog.services.is_empty();
        let services: &[&str] = if has_services { &["services"] } else { &[] };
        let capabilities = [&["parameters", "parametersSubscribe"], time, services].concat();
        let info = Answer::ServerInfo {
            name: &catalog.name,
            capabilities: &capabilities,
            supported_encodings: if has_services { &[JSON] } else { &[] },
            session_id: &catalog.session,
        };
        let mut replies = VecDeque::from([info.text(), catalog.advertised(0)]);
        if has_services {
            let services = catalog.services.iter().zip(0..);
            let services = services
                .map(|(service, id)| service.advertised(id))
                .collect();
            replies.push_back(Answer::AdvertiseServices { services }.text());
        }
        Self {
            trust,
            pace: pace.map(|least| Pace { least, due: None }),
            subscriptions: BTreeMap::new(),
            watched: BTreeMap::new(),
            changed: BTreeMap::new(),
            replies,
            calls: Calls::default(),
            asked: 0,
            time_ns: None,
            order: 0,
            lost: Lost::default(),
            sent: 0,
        }
    }

    /// Returns how many samples the client has lost.
    pub(crate) const fn lost(&self) -> u64 {
        self.lost.all
    }

    /// Returns how many samples wait for the client.
    pub(crate) fn waiting(&self) -> u64 {
        let queues = self.subscriptions.values();
        queues.map(|it| it.queue.len() as u64).sum()
    }

    /// Returns whether as many answers wait as may; nothing is to be heard until some are sent.
    pub(crate) fn is_busy(&self) -> bool {
        self.replies.len() + self.asked >= REPLIES
    }

    /// Takes the text of a frame. Returns what has to be asked for the answer.
    pub(crate) fn hear(&mut self, text: &str, catalog: &Catalog) -> Option<Ask> {
        let request = match Request::read(text) {
            Ok(request) => request,
            Err(error) => {
                self.tell(
                    Level::Error,
                    &format!("cannot understand the message: {error}"),
                );
                // A client that sends an id waits for the answer with that id.
                let id = protocol::id_of_parameters(text).filter(|id| id.len() <= ID)?;
                let wanted = Vec::new();
                self.asked += 1;
                return Some(Ask::Set {
                    wanted,
                    id: Some(id),
                });
            }
        };
        if let Request::GetParameters { id, .. } | Request::SetParameters { id, .. } = &request
            && let Some(bytes) = id.as_ref().map(String::len)
            && bytes > ID
        {
            let text = format!("the id has {bytes} bytes; it may have {ID} at most");
            self.tell(Level::Error, &text);
            return None;
        }
        let mut troubles = Vec::new();
        let ask = self.carry_out(request, catalog, &mut troubles);
        self.complain(&troubles);
        self.asked += usize::from(ask.is_some());
        ask
    }

    /// Takes a binary frame, which is a call of a service.
    pub(crate) fn hear_binary(&mut self, frame: &[u8], catalog: &Catalog) {
        let called = match ServiceCall::read(frame) {
            Ok(called) => called,
            Err((trouble, None)) => return self.tell(Level::Error, &trouble),
            Err((trouble, Some([service, number]))) => {
                return self.fail(service, number, &trouble);
            }
        };
        let heard = self.calls.hear(&called, self.trust, &catalog.services);
        if let Err(reason) = heard {
            self.fail(called.service, called.number, &reason);
        }
    }

    /// Keeps the answer to a call that was taken.
    pub(crate) fn respond(&mut self, call: &Call, result: Result<Vec<u8>, String>) {
        if let Err(reason) = self.calls.answer(call, result) {
            self.fail(call.service, call.number, &reason);
        }
    }

    /// Keeps the failure of a call.
    fn fail(&mut self, service_id: u32, call_id: u32, reason: &str) {
        let message: String = reason.chars().take(REASON).collect();
        let failure = Answer::ServiceCallFailure {
            service_id,
            call_id,
            message: &message,
        };
        self.replies.push_back(failure.text());
    }

    fn carry_out(
        &mut self,
        request: Request,
        catalog: &Catalog,
        troubles: &mut Vec<String>,
    ) -> Option<Ask> {
        match request {
            Request::Subscribe { subscriptions } => {
                for wish in subscriptions {
                    troubles.extend(self.subscribe(wish, catalog).err());
                }
            }
            Request::Unsubscribe { subscription_ids } => {
                for id in subscription_ids {
                    if self.subscriptions.remove(&id).is_none() {
                        troubles.push(format!("there is no subscription {id}"));
                    }
                }
            }
            Request::GetParameters {
                parameter_names,
                id,
            } => {
                let wanted = catalog.places(parameter_names, troubles).collect();
                return Some(Ask::Get { wanted, id });
            }
            Request::SetParameters { parameters, id } => {
                let may_set = self.trust == Trust::MaySet;
                if !may_set {
                    troubles.push(
                        "parameters cannot be set without the token: connect to the address with `?token=` that the \
                         server has printed"
                            .into(),
                    );
                }
                let mut wanted = Vec::new();
                for Parameter { name, value, .. } in parameters {
                    match catalog.place(&name) {
                        Ok(place) => {
                            if value.is_none() {
                                troubles.push(format!("`{name}` cannot be removed"));
                            }
                            wanted.push((name, place, value.filter(|_| may_set)));
                        }
                        Err(trouble) => troubles.push(trouble),
                    }
                }
                let sets = wanted.iter().any(|(.., value)| value.is_some());
                // A client that sends an id waits for the values that hold, whatever was refused.
                return (sets || id.is_some()).then_some(Ask::Set { wanted, id });
            }
            Request::SubscribeParameterUpdates { parameter_names } => {
                let wanted: BTreeMap<_, _> = catalog.places(parameter_names, troubles).collect();
                self.watched.extend(wanted.clone());
                // A value that was set between the last question and this one is not a change any more.
                return (!wanted.is_empty()).then_some(Ask::Get { wanted, id: None });
            }
            Request::UnsubscribeParameterUpdates { parameter_names } => {
                if parameter_names.is_empty() {
                    self.watched.clear();
                }
                for name in parameter_names {
                    self.watched.remove(&name);
                }
            }
        }
        None
    }

    fn subscribe(&mut self, wish: Wish, catalog: &Catalog) -> Result<(), String> {
        let Wish { id, channel_id } = wish;
        let channel = channel_id as usize;
        let offered = catalog.channels.get(channel);
        let offered = offered.ok_or_else(|| format!("there is no channel {channel_id}"))?;
        let mut present = self.subscriptions.iter();
        if let Some((other, _)) = present.find(|(other, it)| **other == id || it.channel == channel)
        {
            let topic = &offered.topic;
            return Err(format!(
                "subscription {id} to {topic} is refused: there is subscription {other} already"
            ));
        }
        let subscription = Subscription {
            channel,
            is_whole: offered.is_whole,
            queue: VecDeque::new(),
        };
        self.subscriptions.insert(id, subscription);
        if let Some((at_ns, payload)) = &offered.latched {
            self.push(channel, *at_ns, payload);
        }
        Ok(())
    }

    /// Keeps a sample of a channel for the client, if it has subscribed.
    pub(crate) fn push(&mut self, channel: usize, at_ns: u64, payload: &Rc<[u8]>) {
        let mut all = self.subscriptions.values_mut();
        let Some(subscription) = all.find(|it| it.channel == channel) else {
            return;
        };
        if self.pace.is_some() && !subscription.is_whole {
            subscription.queue.clear();
        } else if subscription.queue.len() == QUEUE {
            subscription.queue.pop_front();
            self.lost.all += 1;
            *self.lost.untold.entry(channel).or_default() += 1;
        }
        subscription.queue.push_back(Sample {
            order: self.order,
            at_ns,
            payload: payload.clone(),
        });
        self.order += 1;
    }

    /// Keeps the time for the client, in the place of an earlier one.
    pub(crate) const fn set_time(&mut self, at_ns: u64) {
        self.time_ns = Some(at_ns);
    }

    /// Keeps the offer of further channels for the client.
    pub(crate) fn advertise(&mut self, offer: &str) {
        self.replies.push_back(offer.to_owned());
    }

    /// Keeps a status for the client.
    pub(crate) fn tell(&mut self, level: Level, message: &str) {
        // A client that takes nothing misses what all are told.
        if self.replies.len() < 2 * REPLIES {
            let id = None;
            let status = Answer::Status { level, message, id };
            self.replies.push_back(status.text());
        }
    }

    /// Keeps a status of what went wrong, if anything did.
    fn complain(&mut self, troubles: &[String]) {
        let (named, rest) = troubles.split_at(troubles.len().min(TROUBLES));
        if named.is_empty() {
            return;
        }
        let named = named.join("; ");
        let text = match rest.len() {
            0 => named,
            more => format!("{named}; and {more} more"),
        };
        self.tell(Level::Error, &text);
    }

    /// Keeps the answer to what was asked.
    pub(crate) fn answer(
        &mut self,
        parameters: &[Parameter],
        id: Option<&str>,
        troubles: &[String],
    ) {
        self.asked = self.asked.saturating_sub(1);
        self.replies
            .push_back(Answer::ParameterValues { parameters, id }.text());
        self.complain(troubles);
    }

    /// Returns the channels to which the client has subscribed.
    pub(crate) fn channels(&self) -> impl Iterator<Item = usize> {
        self.subscriptions.values().map(|it| it.channel)
    }

    /// Returns the places of the parameters of which the client wants to know changes.
    pub(crate) fn watched(&self) -> impl Iterator<Item = usize> {
        self.watched.values().copied()
    }

    /// Keeps a changed value of the parameter at `place`, in the place of an earlier one.
    pub(crate) fn change(&mut self, place: usize, value: Option<&Json>, kind: Option<&str>) {
        for (name, _) in self.watched.iter().filter(|(_, it)| **it == place) {
            let parameter = Parameter {
                name: name.clone(),
                value: value.cloned(),
                kind: kind.map(str::to_owned),
            };
            self.changed.insert(name.clone(), parameter);
        }
    }

    /// Returns the next frame to send: answers first, then samples in the order in which they came.
    pub(crate) fn next(&mut self, now: Instant, catalog: &Catalog) -> Option<Frame> {
        if let Some(reply) = self.replies.pop_front() {
            return Some(Frame::Text(reply));
        }
        if let Some(status) = self.lost.status(now, catalog) {
            return Some(Frame::Text(status));
        }
        if let Some(response) = self.calls.next() {
            return Some(Frame::Binary(response));
        }
        if !self.changed.is_empty() {
            let changed: Vec<_> = core::mem::take(&mut self.changed).into_values().collect();
            let parameters = &changed;
            let id = None;
            let text = Answer::ParameterValues { parameters, id }.text();
            return Some(Frame::Text(text));
        }
        if let Some(at_ns) = self.time_ns.take() {
            return Some(Frame::Binary(protocol::time(at_ns)));
        }
        if let Some(Pace { due: Some(due), .. }) = self.pace
            && now < due
        {
            return None;
        }
        let all = self.subscriptions.iter_mut();
        let oldest = all.filter_map(|(id, it)| Some((it.queue.front()?.order, *id, it)));
        let (_, id, subscription) = oldest.min_by_key(|(order, ..)| *order)?;
        let sample = subscription.queue.pop_front()?;
        self.sent += 1;
        let frame = protocol::message_data(id, sample.at_ns, &sample.payload);
        if let Some(pace) = &mut self.pace
            && self.subscriptions.values().all(|it| it.queue.is_empty())
        {
            pace.due = Some(now + pace.least);
        }
        Some(Frame::Binary(frame))
    }
}

impl Lost {
    /// Returns a status of what was lost, at most once in [`TELLING`].
    fn status(&mut self, now: Instant, catalog: &Catalog) -> Option<String> {
        let is_soon = |told| now.saturating_duration_since(told) < TELLING;
        if self.untold.is_empty() || self.told.is_some_and(is_soon) {
            return None;
        }
        self.told = Some(now);
        let untold = core::mem::take(&mut self.untold);
        let texts = untold.into_iter().filter_map(|(channel, count)| {
            let topic = &catalog.channels.get(channel)?.topic;
            Some(format!("{count} of {topic}"))
        });
        let texts = texts.collect::<Vec<_>>().join(", ");
        let status = Answer::Status {
            level: Level::Warning,
            message: &format!("samples were lost because this client reads too slowly: {texts}"),
            id: Some("lost"),
        };
        Some(status.text())
    }
}

impl Catalog {
    /// Adds channels. Returns the text that offers them.
    pub(crate) fn add(&mut self, channels: Vec<Channel>) -> String {
        let first = self.channels.len();
        self.channels.extend(channels);
        self.advertised(first)
    }

    /// Returns the text that offers the channels from number `first` on.
    fn advertised(&self, first: usize) -> String {
        let channels = (0..).zip(&self.channels).skip(first);
        let channels = channels.map(|(id, channel)| channel.advertised(id));
        let channels = channels.collect();
        Answer::Advertise { channels }.text()
    }

    fn place(&self, name: &str) -> Result<usize, String> {
        let place = self.names.get(name).copied();
        place.ok_or_else(|| format!("there is no parameter `{name}`"))
    }

    /// Returns the places of parameters; of all, by their shortest names, if there is no name.
    fn places(
        &self,
        names: Vec<String>,
        troubles: &mut Vec<String>,
    ) -> impl Iterator<Item = (String, usize)> {
        let all = names.is_empty().then_some(&self.parameters);
        let all = all.into_iter().flatten().cloned().zip(0..);
        let chosen = names
            .into_iter()
            .filter_map(|name| match self.place(&name) {
                Ok(place) => Some((name, place)),
                Err(trouble) => {
                    troubles.push(trouble);
                    None
                }
            });
        all.chain(chosen).collect::<Vec<_>>().into_iter()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn catalog() -> Catalog {
        let channel = |topic: &str| Channel {
            topic: topic.into(),
            schema_name: String::new(),
            schema: String::new(),
            latched: None,
            is_whole: false,
        };
        Catalog {
            channels: ["/a", "/b"].map(channel).into(),
            parameters: vec!["kp".into()],
            names: [("kp".into(), 0)].into(),
            ..Catalog::default()
        }
    }

    fn told(session: &mut Session, catalog: &Catalog, now: Instant) -> String {
        match session.next(now, catalog) {
            Some(Frame::Text(text)) => text,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn losses_are_told_at_most_once_in_a_second() {
        let (catalog, begin) = (catalog(), Instant::now());
        let mut session = Session::new(Trust::MayLook, None, &catalog);
        let text = r#"{"op":"subscribe","subscriptions":[{"id":5,"channelId":1}]}"#;
        assert_eq!(session.hear(text, &catalog), None);
        for _ in 0..2 {
            told(&mut session, &catalog, begin);
        }
        let overflow = |session: &mut Session| {
            for at_ns in 0..QUEUE as u64 + 3 {
                session.push(1, at_ns, &Rc::from([]));
            }
        };
        overflow(&mut session);
        let text = told(&mut session, &catalog, begin);
        assert!(text.contains("3 of /b"), "{text}");
        overflow(&mut session);
        let soon = begin + TELLING / 2;
        let frame = session.next(soon, &catalog);
        assert!(matches!(frame, Some(Frame::Binary(_))), "{frame:?}");
        let text = told(&mut session, &catalog, begin + TELLING);
        let count = QUEUE + 3;
        assert!(text.contains(&format!("{count} of /b")), "{text}");
        assert_eq!(session.lost(), 3 + count as u64);
        assert_eq!(session.waiting(), QUEUE as u64 - 1);
    }

    #[test]
    fn a_client_with_a_pace_gets_the_newest() {
        let (catalog, begin) = (catalog(), Instant::now());
        let pace = Duration::from_millis(33);
        let mut session = Session::new(Trust::MayLook, Some(pace), &catalog);
        let text =
            r#"{"op":"subscribe","subscriptions":[{"id":0,"channelId":0},{"id":1,"channelId":1}]}"#;
        assert_eq!(session.hear(text, &catalog), None);
        for _ in 0..2 {
            told(&mut session, &catalog, begin);
        }
        let mut got = |now, times: core::ops::Range<u64>| {
            for at_ns in times {
                session.push(0, at_ns, &Rc::from([]));
                session.push(1, at_ns, &Rc::from([]));
            }
            let mut got = Vec::new();
            while let Some(Frame::Binary(frame)) = session.next(now, &catalog) {
                got.push((frame[1], frame[5]));
            }
            (got, session.lost())
        };
        assert_eq!(got(begin, 0..5), (vec![(0, 4), (1, 4)], 0));
        assert_eq!(got(begin + pace / 2, 5..7), (vec![], 0));
        assert_eq!(got(begin + pace, 7..9), (vec![(0, 8), (1, 8)], 0));
    }

    #[test]
    fn a_status_names_few_troubles() {
        let (catalog, begin) = (catalog(), Instant::now());
        let mut session = Session::new(Trust::MayLook, None, &catalog);
        let ids = vec!["1"; 30_000].join(",");
        let text = format!(r#"{{"op":"unsubscribe","subscriptionIds":[{ids}]}}"#);
        assert_eq!(session.hear(&text, &catalog), None);
        for _ in 0..2 {
            told(&mut session, &catalog, begin);
        }
        let status = told(&mut session, &catalog, begin);
        assert!(status.contains("; and 29992 more"), "{}", status.len());
    }

    #[test]
    fn long_ids_are_refused() {
        let (catalog, begin) = (catalog(), Instant::now());
        let mut session = Session::new(Trust::MayLook, None, &catalog);
        let get = |id: &str| format!(r#"{{"op":"getParameters","parameterNames":[],"id":"{id}"}}"#);
        assert!(session.hear(&get(&"x".repeat(ID)), &catalog).is_some());
        assert_eq!(session.hear(&get(&"x".repeat(ID + 1)), &catalog), None);
        for _ in 0..2 {
            told(&mut session, &catalog, begin);
        }
        let status = told(&mut session, &catalog, begin);
        assert!(status.contains("257 bytes"), "{status}");
    }

    #[test]
    fn what_is_not_set_is_told_with_the_values_that_hold() {
        let (catalog, begin) = (catalog(), Instant::now());
        let set = |trust, parameters: &str, more: &str| {
            let mut session = Session::new(trust, None, &catalog);
            let text = format!(r#"{{"op":"setParameters","parameters":[{parameters}]{more}}}"#);
            let ask = session.hear(&text, &catalog);
            for _ in 0..2 {
                told(&mut session, &catalog, begin);
            }
            let status = session.next(begin, &catalog).map(|frame| match frame {
                Frame::Text(text) => text,
                Frame::Binary(bytes) => panic!("{bytes:?}"),
            });
            (ask, status.unwrap_or_default())
        };
        let asked = |value: Option<i32>, id: Option<&str>| {
            let wanted = vec![("kp".into(), 0, value.map(Json::from))];
            let id = id.map(str::to_owned);
            Some(Ask::Set { wanted, id })
        };
        let nothing = Some(Ask::Set {
            wanted: Vec::new(),
            id: Some("7".into()),
        });
        let (kp, id) = (r#"{"name":"kp","value":2}"#, r#","id":"7""#);
        let (ask, status) = set(Trust::MayLook, kp, "");
        assert_eq!(ask, None);
        assert!(status.contains("without the token"), "{status}");
        let (ask, status) = set(Trust::MayLook, kp, id);
        assert_eq!(ask, asked(None, Some("7")));
        assert!(status.contains("without the token"), "{status}");
        let (ask, status) = set(Trust::MaySet, kp, "");
        assert_eq!((ask, &*status), (asked(Some(2), None), ""));
        let (ask, status) = set(Trust::MaySet, r#"{"name":"kp"}"#, id);
        assert_eq!(ask, asked(None, Some("7")));
        assert!(status.contains("`kp` cannot be removed"), "{status}");
        let (ask, status) = set(Trust::MaySet, r#"{"name":"none","value":2}"#, id);
        assert_eq!(ask, nothing);
        assert!(status.contains("there is no parameter `none`"), "{status}");
        let (ask, status) = set(Trust::MaySet, r#"{"value":2}"#, id);
        assert_eq!(ask, nothing);
        assert!(status.contains("cannot understand"), "{status}");
    }

    #[test]
    fn services_are_offered_and_calls_answered() {
        let begin = Instant::now();
        let name = "/sim/robot";
        let services = [false, true].map(|needs_token| Service { name, needs_token });
        let catalog = Catalog {
            services: services.into(),
            ..catalog()
        };
        let mut session = Session::new(Trust::MayLook, None, &catalog);
        let info = told(&mut session, &catalog, begin);
        assert!(info.contains(r#""supportedEncodings":["json"]"#), "{info}");
        told(&mut session, &catalog, begin);
        let offered = told(&mut session, &catalog, begin);
        assert!(
            offered.contains(r#"{"id":1,"name":"/sim/robot""#),
            "{offered}"
        );
        let frame = |service, number| {
            let head = [2, service, 0, 0, 0, number, 0, 0, 0, 4, 0, 0, 0];
            [&head, &b"json{}"[..]].concat()
        };
        session.hear_binary(&frame(1, 7), &catalog);
        let refused = told(&mut session, &catalog, begin);
        let failure = r#"{"op":"serviceCallFailure","serviceId":1,"callId":7,"#;
        assert!(refused.starts_with(failure), "{refused}");
        assert!(refused.contains("without the token"), "{refused}");
        session.hear_binary(&frame(0, 7)[..12], &catalog);
        let refused = told(&mut session, &catalog, begin);
        assert!(
            refused.contains(r#""serviceId":0,"callId":7,"#),
            "{refused}"
        );
        for number in [8, 9] {
            session.hear_binary(&frame(0, number), &catalog);
        }
        let call = session.calls.take().unwrap();
        session.respond(&call, Ok(b"{}".into()));
        let answer = protocol::service_response(0, 8, b"{}");
        let next = session.next(begin, &catalog);
        assert_eq!(next, Some(Frame::Binary(answer)));
        let call = session.calls.take().unwrap();
        session.respond(&call, Err("x".repeat(2 * REASON)));
        let failure = told(&mut session, &catalog, begin);
        assert!(failure.len() < REASON + 100, "{failure}");
        assert_eq!(session.next(begin, &catalog), None);
    }
}
