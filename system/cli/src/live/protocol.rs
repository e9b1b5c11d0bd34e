//! The messages of the Foxglove websocket protocol, as far as this server speaks it.
//!
//! Text frames are JSON objects with a field `op`; binary frames begin with a byte, the operation.
//! All numbers of binary frames are little-endian.

use serde::{Deserialize, Serialize};
use serde_json::Value as Json;

/// The names of the subprotocol, the present one first. They stand for the same messages.
pub(crate) const SUBPROTOCOLS: [&str; 2] = ["foxglove.sdk.v1", "foxglove.websocket.v1"];

/// The encoding of what services take and return.
pub(crate) const JSON: &str = "json";
/// The operation of a client's binary frame that calls a service.
const CALL: u8 = 2;

/// A message of a client.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "op", rename_all = "camelCase", rename_all_fields = "camelCase")]
pub(crate) enum Request {
    Subscribe {
        subscriptions: Vec<Wish>,
    },
    Unsubscribe {
        subscription_ids: Vec<u32>,
    },
    /// Asks for parameters; without names, for all.
    GetParameters {
        parameter_names: Vec<String>,
        id: Option<String>,
    },
    SetParameters {
        parameters: Vec<Parameter>,
        id: Option<String>,
    },
    /// Subscribes to changes of parameters; without names, of all.
    SubscribeParameterUpdates {
        parameter_names: Vec<String>,
    },
    /// Ends the subscription to changes of parameters; without names, of all.
    UnsubscribeParameterUpdates {
        parameter_names: Vec<String>,
    },
}

impl Request {
    /// Reads the text of a frame.
    pub(crate) fn read(text: &str) -> Result<Self, serde_json::Error> {
        serde_json::from_str(text)
    }
}

/// Returns the id of a request for parameters, whatever else is wrong with it.
pub(crate) fn id_of_parameters(text: &str) -> Option<String> {
    let request: Json = serde_json::from_str(text).ok()?;
    let op = request.get("op")?.as_str()?;
    let is_it = matches!(op, "getParameters" | "setParameters");
    request
        .get("id")?
        .as_str()
        .filter(|_| is_it)
        .map(str::to_owned)
}

/// A subscription to a channel, with a number that the client has chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Wish {
    pub(crate) id: u32,
    pub(crate) channel_id: u32,
}

/// A parameter and its value.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Parameter {
    pub(crate) name: String,
    /// `None` if it has no value, or one that JSON cannot express.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) value: Option<Json>,
    /// `float64` of a number that may have a fraction: in JavaScript, 2.0 is written as 2.
    #[serde(rename = "type", default, skip_serializing_if = "Option::is_none")]
    pub(crate) kind: Option<String>,
}

/// A message of this server in a text frame.
#[derive(Serialize)]
#[serde(tag = "op", rename_all = "camelCase", rename_all_fields = "camelCase")]
pub(crate) enum Answer<'a> {
    ServerInfo {
        name: &'a str,
        capabilities: &'a [&'a str],
        /// The encodings that clients may send beside text.
        #[serde(skip_serializing_if = "<[_]>::is_empty")]
        supported_encodings: &'a [&'a str],
        session_id: &'a str,
    },
    Advertise {
        channels: Vec<ChannelDescription<'a>>,
    },
    AdvertiseServices {
        services: Vec<AdvertisedService<'a>>,
    },
    ServiceCallFailure {
        service_id: u32,
        call_id: u32,
        message: &'a str,
    },
    Status {
        level: Level,
        message: &'a str,
        /// A status replaces an earlier one of the same id.
        #[serde(skip_serializing_if = "Option::is_none")]
        id: Option<&'a str>,
    },
    ParameterValues {
        parameters: &'a [Parameter],
        #[serde(skip_serializing_if = "Option::is_none")]
        id: Option<&'a str>,
    },
}

impl Answer<'_> {
    /// Writes the text of a frame.
    pub(crate) fn text(&self) -> String {
        // Texts, numbers and lists of them can always be written.
        serde_json::to_string(self).unwrap_or_default()
    }
}

/// The description of a channel for clients.
#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct ChannelDescription<'a> {
    pub(crate) id: u32,
    pub(crate) topic: &'a str,
    pub(crate) encoding: &'a str,
    pub(crate) schema_name: &'a str,
    pub(crate) schema: &'a str,
    pub(crate) schema_encoding: &'a str,
}

/// The description of a service for clients.
#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct AdvertisedService<'a> {
    pub(crate) id: u32,
    pub(crate) name: &'a str,
    #[serde(rename = "type")]
    pub(crate) kind: String,
    /// Always empty: what clients read that do not know `request`.
    pub(crate) request_schema: &'a str,
    /// Always empty, likewise.
    pub(crate) response_schema: &'a str,
    pub(crate) request: Payload,
    pub(crate) response: Payload,
}

/// The description of what a service takes or returns: JSON without a schema.
#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Payload {
    encoding: &'static str,
    schema_name: String,
    schema_encoding: &'static str,
    schema: &'static str,
}

impl<'a> AdvertisedService<'a> {
    pub(crate) fn new(id: u32, name: &'a str) -> Self {
        let kind = format!("condor/{}", name.trim_start_matches('/').replace('/', "_"));
        let payload = |what| Payload {
            encoding: JSON,
            schema_name: format!("{kind}_{what}"),
            schema_encoding: "",
            schema: "",
        };
        Self {
            id,
            name,
            request_schema: "",
            response_schema: "",
            request: payload("request"),
            response: payload("response"),
            kind,
        }
    }
}

/// The importance of a status.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum Level {
    Warning = 1,
    Error = 2,
}

impl Serialize for Level {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_u8(*self as u8)
    }
}

/// A call of a service, in a binary frame of a client.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct ServiceCall<'f> {
    pub(crate) service: u32,
    /// The number that the client has chosen.
    pub(crate) number: u32,
    pub(crate) encoding: &'f [u8],
    pub(crate) payload: &'f [u8],
}

impl<'f> ServiceCall<'f> {
    /// Reads a binary frame. Returns an error that says why the frame is not a call, with the service and
    /// the number of the call if the frame has them.
    pub(crate) fn read(frame: &'f [u8]) -> Result<Self, (String, Option<[u32; 2]>)> {
        let Some((&CALL, rest)) = frame.split_first() else {
            let text = "only calls of services may be binary messages: clients cannot publish here";
            return Err((text.into(), None));
        };
        let cut = || {
            format!(
                "the call of a service ends too early, after {} bytes",
                frame.len()
            )
        };
        let numbers = || {
            let (service, rest) = word(rest)?;
            let (number, rest) = word(rest)?;
            Some(([service, number], rest))
        };
        let (numbers, rest) = numbers().ok_or_else(|| (cut(), None))?;
        let [service, number] = numbers;
        let content = || {
            let (length, rest) = word(rest)?;
            rest.split_at_checked(length as usize)
        };
        let (encoding, payload) = content().ok_or_else(|| (cut(), Some(numbers)))?;
        Ok(Self {
            service,
            number,
            encoding,
            payload,
        })
    }
}

/// Takes a number from the front.
fn word(bytes: &[u8]) -> Option<(u32, &[u8])> {
    let (word, rest) = bytes.split_first_chunk()?;
    Some((u32::from_le_bytes(*word), rest))
}

/// Writes a binary frame with the answer to a call of a service.
pub(crate) fn service_response(service: u32, number: u32, payload: &[u8]) -> Vec<u8> {
    let mut frame = vec![3];
    for word in [service, number, JSON.len() as u32] {
        frame.extend(word.to_le_bytes());
    }
    frame.extend(JSON.as_bytes());
    frame.extend(payload);
    frame
}

/// Writes a binary frame with a message of a channel: operation, subscription, time in ns, payload.
pub(crate) fn message_data(subscription: u32, at_ns: u64, payload: &[u8]) -> Vec<u8> {
    let mut frame = vec![1];
    frame.extend(subscription.to_le_bytes());
    frame.extend(at_ns.to_le_bytes());
    frame.extend(payload);
    frame
}

/// Writes a binary frame with the time of the server in ns.
pub(crate) fn time(at_ns: u64) -> Vec<u8> {
    let mut frame = vec![2];
    frame.extend(at_ns.to_le_bytes());
    frame
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn requests_are_read_as_clients_write_them() {
        let read = |json: Json| Request::read(&json.to_string()).unwrap();
        let subscribe = json!({"op": "subscribe", "subscriptions": [{"id": 0, "channelId": 3}]});
        let subscriptions = vec![Wish {
            id: 0,
            channel_id: 3,
        }];
        assert_eq!(read(subscribe), Request::Subscribe { subscriptions });
        let get = json!({"op": "getParameters", "parameterNames": ["a"], "id": "7"});
        let (parameter_names, id) = (vec!["a".to_owned()], Some("7".to_owned()));
        let wanted = Request::GetParameters {
            parameter_names,
            id,
        };
        assert_eq!(read(get), wanted);
        let set = json!({
            "op": "setParameters",
            "parameters": [{"name": "a", "value": 2, "type": "float64"}, {"name": "b"}]
        });
        let parameter = |name: &str, value, kind| Parameter {
            name: name.into(),
            value,
            kind,
        };
        let parameters = vec![
            parameter("a", Some(json!(2)), Some("float64".into())),
            parameter("b", None, None),
        ];
        let wanted = Request::SetParameters {
            parameters,
            id: None,
        };
        assert_eq!(read(set), wanted);
    }

    #[test]
    fn other_texts_are_refused_with_a_reason() {
        for (text, reason) in [
            ("", "EOF"),
            ("[]", "op"),
            ("{}", "missing field `op`"),
            (
                r#"{"op":"advertise"}"#,
                "unknown variant `advertise`, expected",
            ),
            (r#"{"op":"subscribe"}"#, "missing field `subscriptions`"),
            (
                r#"{"op":"unsubscribe","subscriptionIds":[-1]}"#,
                "expected u32",
            ),
        ] {
            let told = Request::read(text).unwrap_err().to_string();
            assert!(told.contains(reason), "{text}: {told}");
        }
    }

    #[test]
    fn answers_are_as_the_protocol_says() {
        let status = Answer::Status {
            level: Level::Warning,
            message: "slow",
            id: None,
        };
        let wanted = json!({"op": "status", "level": 1, "message": "slow"});
        assert_eq!(status.text().parse::<Json>().unwrap(), wanted);
        let advertise = Answer::Advertise {
            channels: vec![ChannelDescription {
                id: 1,
                topic: "/t",
                encoding: "cdr",
                schema_name: "p/msg/T",
                schema: "float64 x",
                schema_encoding: "ros2msg",
            }],
        };
        let wanted = json!({"op": "advertise", "channels": [{
            "id": 1, "topic": "/t", "encoding": "cdr", "schemaName": "p/msg/T",
            "schema": "float64 x", "schemaEncoding": "ros2msg"
        }]});
        assert_eq!(advertise.text().parse::<Json>().unwrap(), wanted);
        let service = AdvertisedService::new(1, "/sim/pose");
        let services = Answer::AdvertiseServices {
            services: vec![service],
        };
        let of = |what| json!({"encoding": "json", "schemaName": what, "schemaEncoding": "", "schema": ""});
        let wanted = json!({"op": "advertiseServices", "services": [{
            "id": 1, "name": "/sim/pose", "type": "condor/sim_pose",
            "requestSchema": "", "responseSchema": "",
            "request": of("condor/sim_pose_request"), "response": of("condor/sim_pose_response"),
        }]});
        assert_eq!(services.text().parse::<Json>().unwrap(), wanted);
        let failure = Answer::ServiceCallFailure {
            service_id: 1,
            call_id: 2,
            message: "why",
        };
        let wanted =
            json!({"op": "serviceCallFailure", "serviceId": 1, "callId": 2, "message": "why"});
        assert_eq!(failure.text().parse::<Json>().unwrap(), wanted);
        let wanted = [1, 30, 0, 0, 0, 210, 4, 0, 0, 0, 0, 0, 0, 9, 8];
        assert_eq!(message_data(30, 1234, &[9, 8]), wanted);
        assert_eq!(time(1234), [2, 210, 4, 0, 0, 0, 0, 0, 0]);
    }
    #[test]
    fn calls_are_read_whole_or_refused() {
        let frame = service_response(7, 9, b"{}");
        assert_eq!(frame[0], 3);
        let frame = [&[CALL], &frame[1..]].concat();
        let called = ServiceCall {
            service: 7,
            number: 9,
            encoding: b"json",
            payload: b"{}",
        };
        assert_eq!(ServiceCall::read(&frame), Ok(called));
        for length in 1..17 {
            let (told, numbers) = ServiceCall::read(&frame[..length]).unwrap_err();
            assert!(told.contains(&format!("after {length} bytes")), "{told}");
            assert_eq!(numbers, (length >= 9).then_some([7, 9]));
        }
        for other in [&[][..], &[1, 0], &[3; 20]] {
            let (told, _) = ServiceCall::read(other).unwrap_err();
            assert!(told.contains("cannot publish"), "{told}");
        }
    }
}
