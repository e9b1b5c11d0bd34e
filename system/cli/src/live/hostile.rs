//! Clients that send anything, as a script of bytes: for the property test here, and for the fuzzer.

use std::cell::Cell;
use std::collections::{BTreeMap, VecDeque};
use std::io::{self, ErrorKind, Read, Write};
use std::net::{IpAddr, Ipv4Addr};
use std::rc::Rc;
use std::time::{Duration, Instant};

use super::calls::{CALLS, Call, RESPONSE, Service};
use super::connection::{Connection, HANDSHAKE, ServerSettings};
use super::protocol::{Parameter, ServiceCall};
use super::session::{Ask, Catalog, Channel, Frame, QUEUE, REPLIES, Session};
use crate::listening::{Rules, Token, Trust};

const TOPICS: [&str; 3] = ["/a", "/b", "/latched"];
const LATCHED: usize = 2;

fn catalog() -> Catalog {
    let channel = |topic: &str| Channel {
        topic: topic.into(),
        schema_name: "condor_msgs/msg/Row".into(),
        schema: "uint64 tick".into(),
        latched: (topic == TOPICS[LATCHED]).then(|| (7, Rc::from([0xff; 8]))),
        is_whole: false,
    };
    let names = [("kp", 0), ("a:kp", 0), ("mode", 1)];
    Catalog {
        name: "tested".into(),
        session: "1".into(),
        has_time: true,
        channels: TOPICS.map(channel).into(),
        services: [("/look", false), ("/move", true)]
            .map(|(name, needs_token)| Service { name, needs_token })
            .into(),
        parameters: vec!["kp".into(), "mode".into()],
        names: names.map(|(name, place)| (name.into(), place)).into(),
    }
}

/// The samples that a subscription must still get.
#[derive(Default)]
struct Expected {
    /// The numbers of the first sample that may still come, and of the one after the last.
    from: u64,
    to: u64,
}

/// A session, and what is known of it.
struct Trial {
    catalog: Catalog,
    session: Session,
    now: Instant,
    asks: Vec<Ask>,
    /// The call to answer.
    call: Option<Call>,
    /// The number of calls that were heard, and the number that were answered or refused in a frame that was read.
    called: usize,
    told: usize,
    /// The number of requests for parameters with an id that were heard, and the number that were answered in a
    /// frame that was read.
    named: usize,
    valued: usize,
    /// The channel and the samples of each subscription, by its number.
    expected: BTreeMap<u32, (usize, Expected)>,
    pushed: u64,
    dropped: u64,
}

/// Runs a script of requests, samples, answers and reads against a session.
///
/// # Panics
/// If a sample was neither sent, in its order, nor counted as lost, or if something grew without
/// bound.
pub(crate) fn session(bytes: &[u8]) {
    let catalog = catalog();
    let trust = match bytes.len() % 2 {
        0 => Trust::MaySet,
        _ => Trust::MayLook,
    };
    let mut trial = Trial {
        session: Session::new(trust, None, &catalog),
        catalog,
        now: Instant::now(),
        asks: Vec::new(),
        call: None,
        called: 0,
        told: 0,
        named: 0,
        valued: 0,
        expected: BTreeMap::new(),
        pushed: 0,
        dropped: 0,
    };
    let mut rest = bytes;
    while let [op, argument, more @ ..] = rest {
        rest = more;
        let argument = *argument;
        match op % 10 {
            0 => {
                let (text, more) = rest.split_at(rest.len().min(argument.into()));
                rest = more;
                trial.hear(&String::from_utf8_lossy(text));
            }
            1 => trial.subscribe((argument >> 4).into(), (argument & 3).into()),
            2 => trial.unsubscribe((argument >> 4).into()),
            3 => trial.push((argument & 1).into(), 1 << (argument >> 4)),
            4 => trial.read(argument.into()),
            5 => trial.answer(),
            8 => {
                let (frame, more) = rest.split_at(rest.len().min((argument & 31).into()));
                rest = more;
                trial.call(argument >> 5, frame);
            }
            9 => trial.respond(argument),
            6 => {
                trial.session.change((argument & 1).into(), None, None);
                trial.session.set_time(argument.into());
            }
            _ => {
                trial.now += Duration::from_millis(argument.into());
                trial.hear(REQUESTS[usize::from(argument) % REQUESTS.len()]);
            }
        }
    }
    trial.read(usize::MAX);
    while trial.session.calls.count() > 0 {
        trial.respond(0);
        trial.read(usize::MAX);
    }
    while !trial.asks.is_empty() {
        trial.answer();
    }
    trial.read(usize::MAX);
    assert_eq!(trial.called, trial.told);
    assert_eq!(trial.named, trial.valued);
    let sent = trial.session.sent;
    let lost = trial.session.lost();
    assert_eq!(trial.pushed, sent + lost + trial.dropped);
    for (id, (channel, expected)) in trial.expected {
        assert_eq!(expected.from, expected.to, "{id} of {}", TOPICS[channel]);
    }
}

const REQUESTS: [&str; 7] = [
    r#"{"op":"setParameters","parameters":[{"name":"kp","value":2},{"name":"none"}],"id":"2"}"#,
    r#"{"op":"setParameters","parameters":[{}],"id":"3"}"#,
    r#"{"op":"getParameters","parameterNames":[],"id":"1"}"#,
    r#"{"op":"setParameters","parameters":[{"name":"kp","value":2},{"name":"none"}]}"#,
    r#"{"op":"subscribeParameterUpdates","parameterNames":["a:kp","mode","none"]}"#,
    r#"{"op":"unsubscribeParameterUpdates","parameterNames":["kp"]}"#,
    r#"{"op":"subscribeParameterUpdates","parameterNames":[]}"#,
];

impl Trial {
    fn hear(&mut self, text: &str) {
        // As a connection does.
        if self.session.is_busy() {
            return;
        }
        // Numbers of subscriptions would be those of nobody here.
        if text.contains("ubscri") && !text.contains("Parameter") {
            return;
        }
        if let Ok(json) = text.parse::<serde_json::Value>()
            && let (Some("getParameters" | "setParameters"), Some(_)) =
                (json["op"].as_str(), json["id"].as_str())
        {
            self.named += 1;
        }
        let ask = self.session.hear(text, &self.catalog);
        self.asks.extend(ask);
        assert!(self.asks.len() <= REPLIES);
    }

    /// Calls a service by a frame that is whole for an odd `kind`.
    fn call(&mut self, kind: u8, frame: &[u8]) {
        if self.session.is_busy() {
            return;
        }
        if kind.is_multiple_of(2) {
            // A call is answered once, whether it is valid or not.
            let is_call = !matches!(ServiceCall::read(frame), Err((_, None)));
            self.called += usize::from(is_call);
            self.session.hear_binary(frame, &self.catalog);
        } else {
            let head = [2, kind / 2, 0, 0, 0, kind, 0, 0, 0, 4, 0, 0, 0];
            self.called += 1;
            self.session
                .hear_binary(&[&head, &b"json"[..], frame].concat(), &self.catalog);
        }
        assert!(self.session.calls.count() <= CALLS);
    }

    /// Answers the call that was taken, or takes the next one.
    fn respond(&mut self, argument: u8) {
        let Some(call) = self.call.take() else {
            self.call = self.session.calls.take();
            assert!(self.call.is_none() || self.session.calls.take().is_none());
            return;
        };
        let result = match argument % 16 {
            0 => Ok(Vec::new()),
            1 => Err("x".repeat(1 << 13)),
            2 => Ok(vec![b' '; RESPONSE + 1]),
            _ => Ok(call.payload.clone()),
        };
        self.session.respond(&call, result);
    }

    fn subscribe(&mut self, id: u32, channel: usize) {
        let text = format!(
            r#"{{"op":"subscribe","subscriptions":[{{"id":{id},"channelId":{channel}}}]}}"#
        );
        if self.session.is_busy() {
            return;
        }
        assert_eq!(self.session.hear(&text, &self.catalog), None);
        let is_new = !self.expected.contains_key(&id)
            && !self.expected.values().any(|(it, _)| *it == channel);
        if is_new && channel < TOPICS.len() {
            let mut expected = Expected::default();
            if channel == LATCHED {
                expected.to = 1;
                self.pushed += 1;
            }
            self.expected.insert(id, (channel, expected));
        }
    }

    fn unsubscribe(&mut self, id: u32) {
        if self.session.is_busy() {
            return;
        }
        let text = format!(r#"{{"op":"unsubscribe","subscriptionIds":[{id}]}}"#);
        assert_eq!(self.session.hear(&text, &self.catalog), None);
        if let Some((_, expected)) = self.expected.remove(&id) {
            let waiting = (expected.to - expected.from).min(QUEUE as u64);
            self.dropped += waiting;
        }
    }

    fn push(&mut self, channel: usize, count: u32) {
        for _ in 0..count.min(2 * QUEUE as u32) {
            let mut number = 0;
            let mut subscribed = self.expected.values_mut();
            if let Some((_, expected)) = subscribed.find(|(it, _)| *it == channel) {
                number = expected.to;
                expected.to += 1;
                self.pushed += 1;
            }
            let payload = Rc::from(number.to_le_bytes());
            self.session.push(channel, number, &payload);
        }
    }

    fn read(&mut self, most: usize) {
        for _ in 0..most {
            let Some(frame) = self.session.next(self.now, &self.catalog) else {
                return;
            };
            let bytes = match frame {
                Frame::Text(text) => {
                    let json: serde_json::Value = text.parse().expect("JSON");
                    assert!(json["op"].is_string(), "{json}");
                    self.told += usize::from(json["op"] == "serviceCallFailure");
                    let is_answer = json["op"] == "parameterValues" && json["id"].is_string();
                    self.valued += usize::from(is_answer);
                    continue;
                }
                Frame::Binary(bytes) => bytes,
            };
            if let [3, ..] = bytes[..] {
                assert!(bytes.len() <= 17 + RESPONSE);
                self.told += 1;
                continue;
            }
            let [1, id @ .., _, _, _, _, _, _, _, _] = &bytes[..bytes.len().min(13)] else {
                assert_eq!((bytes[0], bytes.len()), (2, 9));
                continue;
            };
            let id = u32::from_le_bytes(id.try_into().expect("4 bytes"));
            let (channel, expected) = self.expected.get_mut(&id).expect("a subscription");
            if *channel == LATCHED {
                assert_eq!(bytes[13..], [0xff; 8]);
                expected.from += 1;
                continue;
            }
            let number = u64::from_le_bytes(bytes[13..].try_into().expect("8 bytes"));
            // The oldest are lost, and none after them.
            let oldest = expected.to.saturating_sub(QUEUE as u64);
            assert_eq!(number, expected.from.max(oldest));
            expected.from = number + 1;
        }
    }

    fn answer(&mut self) {
        let Some(ask) = self.asks.pop() else {
            return;
        };
        let (names, id): (Vec<_>, _) = match ask {
            Ask::Get { wanted, id } => (wanted.into_keys().collect(), id),
            Ask::Set { wanted, id } => (wanted.into_iter().map(|(name, ..)| name).collect(), id),
        };
        let parameter = |name| Parameter {
            name,
            value: None,
            kind: None,
        };
        let parameters: Vec<_> = names.into_iter().map(parameter).collect();
        self.session.answer(&parameters, id.as_deref(), &[]);
    }
}

/// The server's end of a stream: what the client has sent comes in pieces.
struct Stream<'b> {
    pieces: Vec<&'b [u8]>,
    written: Vec<u8>,
}

impl Read for Stream<'_> {
    fn read(&mut self, to: &mut [u8]) -> io::Result<usize> {
        match self.pieces.first_mut() {
            None => Err(ErrorKind::WouldBlock.into()),
            Some([]) => {
                self.pieces.remove(0);
                Err(ErrorKind::WouldBlock.into())
            }
            Some(piece) => piece.read(to),
        }
    }
}

impl Write for Stream<'_> {
    fn write(&mut self, from: &[u8]) -> io::Result<usize> {
        self.written.write(from)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Connects a client that sends fragments without content.
///
/// # Panics
/// If a turn reads them without bound.
#[cfg(test)]
pub(super) fn fragments() {
    let begin: &[u8] = &[0x01, 0x80, 0, 0, 0, 0];
    let more: &[u8] = &[0x00, 0x80, 0, 0, 0, 0];
    let bytes = [begin, &more.repeat(1 << 16)].concat();
    let stream = WholeInput(GREETING.chain(bytes.into()));
    let (catalog, begin) = (catalog(), Instant::now());
    let local = IpAddr::V4(Ipv4Addr::LOCALHOST);
    let mut connection = Connection::new(stream, local, &house(), begin);
    let mut asks = VecDeque::new();
    for _ in 0..2 {
        let turn = connection.turn(begin, &catalog, &mut asks);
        assert_eq!(turn, Ok(()));
    }
    assert!(connection.session().is_some());
}

/// A stream that has all that the client sends at once, and then ends.
#[cfg(test)]
struct WholeInput(io::Chain<&'static [u8], VecDeque<u8>>);

#[cfg(test)]
impl Read for WholeInput {
    fn read(&mut self, to: &mut [u8]) -> io::Result<usize> {
        self.0.read(to)
    }
}

#[cfg(test)]
impl Write for WholeInput {
    fn write(&mut self, from: &[u8]) -> io::Result<usize> {
        Ok(from.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

fn house() -> Rc<ServerSettings> {
    Rc::new(ServerSettings {
        rules: Rules {
            origins: Vec::new(),
            token: Token::of([0; 16]),
        },
        most: 1,
        present: Cell::new(0),
    })
}

/// A good request for a connection.
const GREETING: &[u8] = b"GET /?token=00000000000000000000000000000000 HTTP/1.1\r\n\
    Host: localhost:8765\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
    Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\
    Sec-WebSocket-Protocol: x, foxglove.sdk.v1\r\n\r\n";

/// A plain request, as far as its target.
const PLAIN: &[u8] = b"GET /";

/// Connects a client that sends these bytes: after a good request if the first byte is even, and after the beginning of
/// a plain one if it is 1 more than a multiple of 4.
///
/// # Panics
/// If the server goes on with a client that does not finish its handshake, or does not answer as
/// the protocol says.
pub(crate) fn connection(bytes: &[u8]) {
    let Some((first, bytes)) = bytes.split_first() else {
        return;
    };
    let greeting = match first % 4 {
        0 | 2 => GREETING,
        1 => PLAIN,
        _ => &[],
    };
    let size = usize::from(first / 2) + 1;
    let pieces = [greeting].into_iter().chain(bytes.chunks(size)).collect();
    let stream = Stream {
        pieces,
        written: Vec::new(),
    };
    let (catalog, begin) = (catalog(), Instant::now());
    let local = IpAddr::V4(Ipv4Addr::LOCALHOST);
    let mut connection = Connection::new(stream, local, &house(), begin);
    let mut asks = VecDeque::new();
    // Each piece is read in a turn of its own, at least.
    for _ in 0..bytes.len() + 2 {
        if connection.turn(begin, &catalog, &mut asks).is_err() {
            return;
        }
        assert!(asks.len() <= REPLIES);
        if let Some(session) = connection.session() {
            session.push(0, 1, &Rc::from([0; 8]));
        }
    }
    let is_open = connection.session().is_some();
    let late = connection.turn(begin + HANDSHAKE, &catalog, &mut asks);
    assert!(is_open || late.is_err(), "it still waits for the handshake");
}
