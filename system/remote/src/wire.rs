//! Keys, requests and answers between clients and gateways.
//!
//! A request is a query of zenoh. Its key names the client and the right that the request needs, so that the access
//! control of zenoh binds both; its payload is JSON, with the [`VERSION`]; the bytes of a motion are its attachment.
//! The answer is JSON, too: what was asked for, or a [`RemoteRefusal`] as an error of zenoh.
//!
//! | key | is |
//! |---|---|
//! | `condor/ROBOT/alive` | a liveliness token, as long as the gateway runs |
//! | `condor/ROBOT/here/CLIENT/TOKEN` | a liveliness token, as long as the client is there |
//! | `condor/ROBOT/by/CLIENT/RIGHT` | takes queries: requests of the client |
//! | `condor/ROBOT/streams/…` | has the messages of a topic, each with a [`StreamPosition`] as attachment |

use serde::{Deserialize, Serialize};
use serde_json::Value as Json;

/// The version of the protocol between clients and gateways. A gateway refuses requests of another version.
pub const VERSION: u32 = 2;
/// The greatest length of the JSON text of a request, in bytes.
pub const REQUEST_BYTES: usize = 4096;
/// The greatest length of the bytes of a motion that a client sends, in bytes.
pub const MOTION_BYTES: usize = 480;
/// The greatest length of the name of a robot or a client, in bytes.
pub const NAME_BYTES: usize = 32;
/// The first part of all keys.
const ROOT: &str = "condor";

/// A right of a client: the kind of requests that it may make. The access control of zenoh checks it by the key of a
/// request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Right {
    /// To see states, variables, parameters and streams.
    Look,
    /// To set parameters.
    Tune,
    /// To send messages, and to have the robot move and stop.
    Move,
}

impl Right {
    /// All rights, in the order of the variants.
    pub const ALL: [Self; 3] = [Self::Look, Self::Tune, Self::Move];

    /// Returns the word that stands for this right in keys and in configurations: `look`, `tune` or `move`.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Look => "look",
            Self::Tune => "tune",
            Self::Move => "move",
        }
    }
}

/// The identity of a motion among all motions of one robot, which its queue assigns. It is never used for another motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Id {
    /// The number of the session with the robot's queue, which the gateway has opened for the client.
    pub session: u32,
    /// The number of the request in this session, from 1 on.
    pub number: u32,
}

impl core::fmt::Display for Id {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{}.{}", self.session, self.number)
    }
}

/// A request of a client to the gateway of a robot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "do", rename_all = "kebab-case", deny_unknown_fields)]
#[non_exhaustive]
pub enum RemoteRequest {
    /// Asks for the state of processors and services: the [status](https://docs.rs/condor-host) of the system.
    Status {},
    /// Asks for the [`RemoteTopic`]s of streams.
    Topics {},
    /// Asks for variables, parameters and fields of published cells, with values.
    Variables {
        /// The names; if empty, all of them are listed, variables without values.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        names: Vec<String>,
    },
    /// Asks for the value of a variable, of a parameter, or of a field of a published cell.
    Get {
        /// The name of the variable, parameter or field.
        name: String,
    },
    /// Sets a parameter, and returns the value that it had.
    Set {
        /// The name of the parameter.
        name: String,
        /// The value that the parameter must have now; `null` for any.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        from: Option<Json>,
        /// The new value: a number, a boolean or a label.
        value: Json,
    },
    /// Sends a message, and returns the reply. The program receives the message at most once, and may have
    /// received it even if no answer comes.
    Send {
        /// The name of the processor.
        processor: String,
        /// The name or the number of the vector.
        vector: String,
        /// The word of data that the handler of the vector gets.
        data: u32,
    },
    /// Asks for the identity of the client's next motion; returns an [`Id`].
    NextId {
        /// The last identity that the client had: the next one is of the same session, if that is still open. Without
        /// it, the gateway opens a session.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        last: Option<Id>,
    },
    /// Enqueues a motion, unless this request was received before; returns a [`RemoteOutcome`].
    Offer {
        /// The identity of the motion.
        id: Id,
        /// True if the motion takes control from another program.
        #[serde(default)]
        takes_control: bool,
    },
    /// Asks for the outcome of a motion; returns a [`RemoteOutcome`].
    Outcome {
        /// The identity of the motion.
        id: Id,
    },
    /// Ensures that a motion never runs if it was not received yet; returns a [`RemoteOutcome`], which is
    /// never [`RemoteState::New`].
    Withdraw {
        /// The identity of the motion.
        id: Id,
    },
    /// Ends all motion of the robot, also that of other clients.
    Stop {},
}

impl RemoteRequest {
    /// Returns the right that a client needs for this request.
    #[must_use]
    pub const fn right(&self) -> Right {
        match self {
            Self::Status {} | Self::Topics {} | Self::Variables { .. } | Self::Get { .. } => {
                Right::Look
            }
            Self::Outcome { .. } => Right::Look,
            Self::Set { .. } => Right::Tune,
            Self::Send { .. }
            | Self::NextId { .. }
            | Self::Offer { .. }
            | Self::Withdraw { .. }
            | Self::Stop {} => Right::Move,
        }
    }

    /// Encodes the request as the payload of a zenoh query: JSON, with the [`VERSION`].
    #[must_use]
    pub fn payload(&self) -> Vec<u8> {
        let mut json = serde_json::to_value(self).unwrap_or_default();
        if let Some(fields) = json.as_object_mut() {
            fields.insert("version".into(), VERSION.into());
        }
        json.to_string().into()
    }
}

/// A request as a gateway receives it: with the name of the client that makes it, and the bytes of a motion.
#[derive(Clone, Debug, PartialEq)]
pub struct ClientRequest {
    /// The name of the client.
    pub client: String,
    /// The request that the client makes.
    pub request: RemoteRequest,
    /// The bytes of the motion of a [`RemoteRequest::Offer`]; empty for other requests.
    pub motion: Vec<u8>,
}

impl ClientRequest {
    /// Reads a request from a zenoh query to the gateway of `robot`: from its `key`, its `payload` and its
    /// `attachment`. The attachment is empty if the query has none.
    ///
    /// # Errors
    /// Returns a [`RemoteRefusal`] if the key, the version, the request, or the length of the payload or the attachment
    /// is not valid; its text says what is wrong.
    pub fn read(
        robot: &str,
        key: &str,
        payload: &[u8],
        attachment: &[u8],
    ) -> Result<Self, RemoteRefusal> {
        let wrong = |text: String| RemoteRefusal::new(text, false);
        let rest = key.strip_prefix(&format!("{ROOT}/{robot}/by/"));
        let parts = rest.and_then(|rest| rest.split_once('/'));
        let (client, word) =
            parts.ok_or_else(|| wrong("the key is not condor/ROBOT/by/CLIENT/RIGHT".into()))?;
        check_name("client", client).map_err(wrong)?;
        if payload.len() > REQUEST_BYTES {
            let length = payload.len();
            let text = format!("a request has at most {REQUEST_BYTES} bytes, not {length}");
            return Err(wrong(text));
        }
        let json: Result<serde_json::Map<_, _>, _> = serde_json::from_slice(payload);
        let mut json =
            json.map_err(|error| wrong(format!("the request is not a JSON object: {error}")))?;
        match json.remove("version") {
            Some(version) if version == VERSION => {}
            Some(other) => {
                let text = format!("the request has version {other}; this gateway reads {VERSION}");
                return Err(wrong(text));
            }
            None => return Err(wrong("the request has no `version`".into())),
        }
        let request: Result<RemoteRequest, _> = serde_json::from_value(json.into());
        let request =
            request.map_err(|error| wrong(format!("cannot understand the request: {error}")))?;
        if let RemoteRequest::Offer { id, .. }
        | RemoteRequest::Outcome { id }
        | RemoteRequest::Withdraw { id } = &request
            && id.number == 0
        {
            let text = format!("there is no motion {id}: the numbers of a session begin with 1");
            return Err(wrong(text));
        }
        if request.right().word() != word {
            let right = request.right().word();
            return Err(wrong(format!(
                "this request must be sent by the key of the right `{right}`, not of `{word}`"
            )));
        }
        let most = match &request {
            RemoteRequest::Offer { .. } => MOTION_BYTES,
            _ => 0,
        };
        if attachment.len() > most || attachment.is_empty() && most > 0 {
            let length = attachment.len();
            let text = format!(
                "the attachment has {length} bytes; a motion has 1 to {MOTION_BYTES}, and other requests have none"
            );
            return Err(wrong(text));
        }
        Ok(Self {
            client: client.into(),
            request,
            motion: attachment.into(),
        })
    }
}

/// The reason why a gateway has refused a request, as a text for people, and whether the request may succeed later.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[error("{error}")]
pub struct RemoteRefusal {
    /// The reason, as a text for people.
    pub error: String,
    /// True if the same request may succeed later. A refusal does not say what becomes of a motion: see
    /// [`RemoteRequest::Withdraw`].
    pub again: bool,
}

impl RemoteRefusal {
    /// Makes a refusal with the reason `error`, a text for people. `again` is true if the same request may succeed
    /// later.
    #[must_use]
    pub fn new(error: impl Into<String>, again: bool) -> Self {
        Self {
            error: error.into(),
            again,
        }
    }
}

/// The state of a motion that a client has offered, as the robot's queue knows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RemoteState {
    /// The robot has not received the motion. A request that is still on its way may arrive; see
    /// [`RemoteRequest::Withdraw`].
    New,
    /// The motion waits for its turn.
    Accepted,
    /// The motion runs.
    Started,
    /// The motion has run to its end.
    Done,
    /// The motion ran until a guard of its own stopped it.
    Stopped,
    /// The motion waited or ran, and was ended by a command, a failure, or the absence of its client.
    Aborted,
    /// The robot refused the motion, or the client withdrew it before the robot received it: it did not run.
    Refused,
    /// The robot's program ended before the turn of the motion came: it did not run.
    Lost,
    /// The robot's program ended while the motion ran.
    BrokenOff,
    /// The gateway ended before the robot had the motion, or a later one of the session came first: it did not run.
    Never,
    /// The motion will not run any more, and no record tells whether it did.
    Forgotten,
}

impl RemoteState {
    /// Returns true if the state does not change any more: the motion has ended, or will never run.
    #[must_use]
    pub const fn is_final(self) -> bool {
        !matches!(self, Self::New | Self::Accepted | Self::Started)
    }

    /// Returns true if it is certain that the motion has not run, and never will.
    #[must_use]
    pub const fn did_not_run(self) -> bool {
        matches!(self, Self::Refused | Self::Lost | Self::Never)
    }
}

impl core::fmt::Display for RemoteState {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let word = serde_json::to_value(self).unwrap_or_default();
        f.pad(word.as_str().unwrap_or_default())
    }
}

/// The state of a motion, with the reason for it and the progress. The gateway answers requests about motions with it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RemoteOutcome {
    /// The present or final state of the motion.
    pub state: RemoteState,
    /// The reason for which the motion was refused or has ended early; empty if there is none.
    #[serde(default)]
    pub reason: String,
    /// The part of the motion that is done, in 0..=1; `None` if the motion does not run, or if this is not
    /// known.
    #[serde(default)]
    pub progress: Option<f64>,
}

/// A topic whose messages a client can receive as a stream.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RemoteTopic {
    /// The name of the topic, as in a recording, such as `/servo_a/servo`.
    pub name: String,
    /// The name of the type of the messages.
    pub schema_name: String,
    /// The text of the type, as `ros2msg`. Messages are encoded as CDR.
    pub schema: String,
    /// True if each message is a row of variables; otherwise each is an event.
    pub has_rows: bool,
}

/// The position of a message in the stream of its topic. A gateway attaches it to each message, so that the receiver
/// can count lost messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StreamPosition {
    /// A number that no other incarnation of the stream has.
    pub incarnation: u64,
    /// The number of the message in this incarnation, from 0. Numbers that are missing were lost on the
    /// way.
    pub number: u64,
}

impl StreamPosition {
    /// Encodes the position: the incarnation and the number, each as 8 bytes, little-endian.
    #[must_use]
    pub fn bytes(self) -> [u8; 16] {
        let mut bytes = [0; 16];
        let (incarnation, number) = bytes.split_at_mut(8);
        incarnation.copy_from_slice(&self.incarnation.to_le_bytes());
        number.copy_from_slice(&self.number.to_le_bytes());
        bytes
    }

    /// Decodes a position from what [`bytes`](Self::bytes) returns; returns `None` if `bytes` has another length than
    /// 16.
    #[must_use]
    pub fn read(bytes: &[u8]) -> Option<Self> {
        let (incarnation, number) = bytes.split_first_chunk::<8>()?;
        Some(Self {
            incarnation: u64::from_le_bytes(*incarnation),
            number: u64::from_le_bytes(number.try_into().ok()?),
        })
    }
}

/// Returns the prefix of all zenoh keys of the robot `robot`, without a `/` at its end.
#[must_use]
pub fn root(robot: &str) -> String {
    format!("{ROOT}/{robot}")
}

/// Returns the key of the zenoh liveliness token that exists while the gateway of `robot` runs. `*` stands for any
/// robot.
#[must_use]
pub fn alive(robot: &str) -> String {
    format!("{ROOT}/{robot}/alive")
}

/// Returns the name of the robot to which the key `alive` of a gateway's liveliness token belongs; `None` if it is
/// another key. [`alive`] makes such keys.
#[must_use]
pub fn robot_of(alive: &str) -> Option<&str> {
    alive
        .strip_prefix(ROOT)?
        .strip_prefix('/')?
        .strip_suffix("/alive")
}

/// Returns the key of the zenoh liveliness token that exists while the client `client` is present at `robot`. `token`
/// is a random number, which makes the key different from those of other processes.
#[must_use]
pub fn here(robot: &str, client: &str, token: u64) -> String {
    format!("{ROOT}/{robot}/here/{client}/{token}")
}

/// Returns the key expression for all liveliness tokens of the client `client` at `robot`. `*` stands for any client.
#[must_use]
pub fn all_here(robot: &str, client: &str) -> String {
    format!("{ROOT}/{robot}/here/{client}/*")
}

/// Returns the name of the client and the token in the key `here` of a client's liveliness token at `robot`; `None` if
/// it is another key. [`here`] makes such keys.
#[must_use]
pub fn client_of(robot: &str, here: &str) -> Option<(String, u64)> {
    let rest = here.strip_prefix(&format!("{ROOT}/{robot}/here/"))?;
    let (client, token) = rest.split_once('/')?;
    Some((client.into(), token.parse().ok()?))
}

/// Returns the key of the zenoh queries to `robot` by which the client `client` makes requests that need the right
/// `right`. `*` stands for any client or any right.
#[must_use]
pub fn by(robot: &str, client: &str, right: &str) -> String {
    format!("{ROOT}/{robot}/by/{client}/{right}")
}

/// Returns the key of the messages of the topic `topic` of `robot`. The name of a topic begins with `/`; `/**` stands
/// for all topics.
#[must_use]
pub fn stream(robot: &str, topic: &str) -> String {
    format!("{ROOT}/{robot}/streams{topic}")
}

/// Checks that `name` has 1 to [`NAME_BYTES`] ASCII letters, digits, `-` and `_`. `what` is the word for the owner of
/// the name in the error: `robot` or `client`.
///
/// # Errors
/// Returns the text of an error, which says which names are valid, if `name` is not.
pub fn check_name(what: &str, name: &str) -> Result<(), String> {
    let is_right = |byte: u8| byte.is_ascii_alphanumeric() || matches!(byte, b'-' | b'_');
    if (1..=NAME_BYTES).contains(&name.len()) && name.bytes().all(is_right) {
        return Ok(());
    }
    let shown: String = name
        .chars()
        .take(NAME_BYTES)
        .flat_map(char::escape_default)
        .collect();
    Err(format!(
        "`{shown}` cannot be the name of a {what}: a name has 1 to {NAME_BYTES} letters, digits, `-` and `_`"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(key: &str, payload: &[u8], motion: &[u8]) -> Result<ClientRequest, String> {
        ClientRequest::read("hand", key, payload, motion).map_err(|it| it.error)
    }

    #[test]
    fn a_request_is_read_as_it_was_written() {
        let id = Id {
            session: 7,
            number: 3,
        };
        let requests = [
            (RemoteRequest::Status {}, &b""[..]),
            (
                RemoteRequest::Set {
                    name: "kp".into(),
                    from: None,
                    value: 2.5.into(),
                },
                b"",
            ),
            (
                RemoteRequest::Offer {
                    id,
                    takes_control: true,
                },
                b"wave",
            ),
            (RemoteRequest::Withdraw { id }, b""),
            (RemoteRequest::NextId { last: None }, b""),
            (RemoteRequest::NextId { last: Some(id) }, b""),
        ];
        for (request, motion) in requests {
            let key = by("hand", "lab", request.right().word());
            let asked = read(&key, &request.payload(), motion);
            let motion = motion.to_vec();
            assert_eq!(
                asked,
                Ok(ClientRequest {
                    client: "lab".into(),
                    request,
                    motion
                })
            );
        }
    }

    #[test]
    fn what_is_no_request_is_told() {
        let status = RemoteRequest::Status {}.payload();
        let key = by("hand", "lab", "look");
        for (key, payload, motion, complaint) in [
            (
                "condor/arm/by/lab/look",
                &status[..],
                &b""[..],
                "the key is not",
            ),
            (
                "condor/hand/by/l?b/look",
                &status,
                b"",
                "the name of a client",
            ),
            (
                "condor/hand/by/lab/move",
                &status,
                b"",
                "the key of the right `look`, not of `move`",
            ),
            (&key, b"[]", b"", "a JSON object"),
            (&key, b"{}", b"", "no `version`"),
            (
                &key,
                br#"{"version":1,"do":"status"}"#,
                b"",
                "version 1; this gateway reads 2",
            ),
            (
                &key,
                br#"{"version":2,"do":"fly"}"#,
                b"",
                "unknown variant `fly`",
            ),
            (
                &key,
                br#"{"version":2,"do":"status","x":1}"#,
                b"",
                "unknown field `x`",
            ),
            (&key, &status, b"wave", "the attachment has 4 bytes"),
            (
                &key,
                &[b' '; REQUEST_BYTES + 1],
                b"",
                "at most 4096 bytes, not 4097",
            ),
        ] {
            let error = read(key, payload, motion).unwrap_err();
            assert!(error.contains(complaint), "{error}");
        }
    }

    #[test]
    fn keys_are_read_as_they_are_written() {
        assert_eq!(
            client_of("hand", &here("hand", "lab", 7)),
            Some(("lab".into(), 7))
        );
        assert_eq!(client_of("arm", &here("hand", "lab", 7)), None);
        assert_eq!(robot_of(&alive("hand")), Some("hand"));
        let place = StreamPosition {
            incarnation: 3,
            number: 1 << 40,
        };
        assert_eq!(StreamPosition::read(&place.bytes()), Some(place));
        assert_eq!(StreamPosition::read(&[0; 15]), None);
    }
}
