//! A running `condor view`, and a client of it.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, ErrorKind, Read};
use std::net::TcpStream;
use std::process::{Child, ChildStdout, Command, Stdio};

use condor_ros2::Layout;
use rustix::process::Signal;
use serde_json::{Value, json};
use tungstenite::client::IntoClientRequest;
use tungstenite::handshake::client::Request;
use tungstenite::http::HeaderValue;
use tungstenite::protocol::frame::coding::CloseCode;
use tungstenite::{Error, HandshakeError, Message, WebSocket};

use crate::running::{self, DEADLINE, Up};

/// A running `condor view`.
pub(super) struct Live {
    child: Child,
    output: BufReader<ChildStdout>,
    port: u16,
    /// The query that lets a client set parameters.
    pub(super) query: String,
}

impl Live {
    pub(super) fn start(up: &Up, arguments: &[&str]) -> Self {
        Self::of(up.command(&[&["view", "--port", "0"], arguments].concat()))
    }

    pub(super) fn of(mut command: Command) -> Self {
        let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
        let mut output = BufReader::new(child.stdout.take().unwrap());
        let mut line = || {
            let mut line = String::new();
            output.read_line(&mut line).unwrap();
            let mut words = line.split(' ');
            words.find(|it| it.starts_with("ws://")).unwrap().to_owned()
        };
        let (looking, setting) = (line(), line());
        let port = looking.strip_prefix("ws://127.0.0.1:").unwrap();
        let port = port.strip_suffix('/').unwrap().parse().unwrap();
        let mut hint = String::new();
        output.read_line(&mut hint).unwrap();
        let query = setting.strip_prefix(&looking).unwrap().to_owned();
        Self {
            child,
            output,
            port,
            query,
        }
    }

    pub(super) fn socket(&self) -> TcpStream {
        let stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        stream.set_read_timeout(Some(DEADLINE)).unwrap();
        stream.set_write_timeout(Some(DEADLINE)).unwrap();
        stream
    }

    /// The request of a good client.
    pub(super) fn request(&self, query: &str) -> Request {
        let mut request = format!("ws://localhost:{}/{query}", self.port)
            .into_client_request()
            .unwrap();
        let offered = HeaderValue::from_static("other, foxglove.sdk.v1");
        let headers = request.headers_mut();
        headers.insert("sec-websocket-protocol", offered);
        request
    }

    pub(super) fn viewer(&self) -> Viewer {
        Viewer::of(self.socket(), self.request(""))
    }

    /// A client that may set parameters.
    pub(super) fn setter(&self) -> Viewer {
        Viewer::of(self.socket(), self.request(&self.query))
    }

    /// The status and the text with which a request is refused.
    pub(super) fn refused(&self, request: Request) -> (u16, String) {
        match tungstenite::client(request, self.socket()) {
            Err(HandshakeError::Failure(Error::Http(response))) => {
                let (parts, _) = response.into_parts();
                (parts.status.as_u16(), format!("{:?}", parts.headers))
            }
            Err(error) => panic!("{error}"),
            Ok((socket, _)) => panic!("{:?}", socket.get_config()),
        }
    }

    /// Ends it, and returns the rest of what it has printed.
    pub(super) fn end(mut self) -> String {
        running::signal(self.child.id(), Signal::INT);
        let mut text = String::new();
        self.output.read_to_string(&mut text).unwrap();
        assert!(self.child.wait().unwrap().success());
        text
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        // It has ended already, unless the test has failed.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A connected client.
pub(super) struct Viewer {
    pub(super) socket: WebSocket<TcpStream>,
    pub(super) info: Value,
    /// By topic: the number and the schema.
    pub(super) channels: BTreeMap<String, (u64, String)>,
}

/// A message of a channel.
pub(super) struct Data {
    pub(super) subscription: u32,
    pub(super) at_ns: u64,
    pub(super) payload: Vec<u8>,
}

impl Viewer {
    pub(super) fn of(stream: TcpStream, request: Request) -> Self {
        let (socket, _) = tungstenite::client(request, stream).unwrap();
        let mut this = Self {
            socket,
            info: Value::Null,
            channels: BTreeMap::new(),
        };
        this.info = this.answer("serverInfo");
        this.take_offer();
        this
    }

    /// Reads until channels are offered.
    pub(super) fn take_offer(&mut self) {
        let advertise = self.answer("advertise");
        for channel in advertise["channels"].as_array().unwrap() {
            assert_eq!(channel["encoding"], "cdr");
            assert_eq!(channel["schemaEncoding"], "ros2msg");
            let text = |key: &str| channel[key].as_str().unwrap().to_owned();
            let number = channel["id"].as_u64().unwrap();
            self.channels
                .insert(text("topic"), (number, text("schema")));
        }
    }

    pub(super) fn send(&mut self, message: &Value) {
        self.socket
            .send(Message::text(message.to_string()))
            .unwrap();
    }

    pub(super) fn subscribe(&mut self, id: u32, topic: &str) -> Layout {
        self.follow(id, topic);
        Layout::of_schema(&self.channels[topic].1).unwrap()
    }

    /// Subscribes to a channel that has no rows.
    pub(super) fn follow(&mut self, id: u32, topic: &str) {
        let (number, _) = self.channels[topic];
        let subscriptions = json!([{ "id": id, "channelId": number }]);
        self.send(&json!({ "op": "subscribe", "subscriptions": subscriptions }));
    }

    /// Reads the services that are offered: their names, at the places that are their numbers.
    pub(super) fn services(&mut self) -> Vec<String> {
        let advertised = self.answer("advertiseServices");
        let services = advertised["services"].as_array().unwrap().iter();
        let service = |(place, service): (usize, &Value)| {
            assert_eq!(service["id"], place);
            assert_eq!(service["request"]["encoding"], "json");
            service["name"].as_str().unwrap().to_owned()
        };
        services.enumerate().map(service).collect()
    }

    /// Calls a service, and sends it at the next flush.
    pub(super) fn write_call(&mut self, service: usize, number: u32, payload: &[u8]) {
        let service = u32::try_from(service).unwrap();
        let head = [service, number, 4].map(u32::to_le_bytes);
        let frame = [&[2], head.as_flattened(), b"json", payload].concat();
        self.socket.write(Message::binary(frame)).unwrap();
    }

    /// Calls a service, and returns the answer or the reason of its failure.
    pub(super) fn call(&mut self, service: usize, payload: &[u8]) -> Result<Value, String> {
        self.write_call(service, 77, payload);
        self.socket.flush().unwrap();
        let (number, result) = self.result();
        assert_eq!(number, 77);
        result
    }

    /// Reads the answer to a call, or the reason of its failure, with the number of the call.
    pub(super) fn result(&mut self) -> (u64, Result<Value, String>) {
        loop {
            match self.read() {
                Message::Text(text) => {
                    let message: Value = serde_json::from_str(&text).unwrap();
                    if message["op"] == "serviceCallFailure" {
                        let reason = message["message"].as_str().unwrap().to_owned();
                        return (message["callId"].as_u64().unwrap(), Err(reason));
                    }
                }
                Message::Binary(bytes) if bytes[0] == 3 => {
                    let number = u32::from_le_bytes(bytes[5..9].try_into().unwrap());
                    assert_eq!(bytes[9..17], *b"\x04\0\0\0json");
                    let answer = serde_json::from_slice(&bytes[17..]).unwrap();
                    return (number.into(), Ok(answer));
                }
                _ => {}
            }
        }
    }

    /// Reads a message. A read with a timeout is not restarted after a signal, such as that of a child's end.
    pub(super) fn read(&mut self) -> Message {
        loop {
            match self.socket.read() {
                Err(Error::Io(error)) if error.kind() == ErrorKind::Interrupted => {}
                read => return read.unwrap(),
            }
        }
    }

    /// Reads until a text of this operation has come.
    pub(super) fn answer(&mut self, op: &str) -> Value {
        loop {
            if let Message::Text(text) = self.read() {
                let message: Value = serde_json::from_str(&text).unwrap();
                if message["op"] == op {
                    return message;
                }
            }
        }
    }

    /// Reads until a status has come that has this text.
    pub(super) fn status(&mut self, text: &str) -> Value {
        loop {
            let status = self.answer("status");
            if status["message"].as_str().unwrap().contains(text) {
                return status;
            }
        }
    }

    /// Reads until a binary message of this operation has come.
    pub(super) fn binary(&mut self, op: u8) -> Vec<u8> {
        loop {
            if let Message::Binary(bytes) = self.read()
                && bytes[0] == op
            {
                return bytes[1..].to_vec();
            }
        }
    }

    pub(super) fn data(&mut self) -> Data {
        let bytes = self.binary(1);
        let (head, payload) = bytes.split_at(12);
        Data {
            subscription: u32::from_le_bytes(head[..4].try_into().unwrap()),
            at_ns: u64::from_le_bytes(head[4..].try_into().unwrap()),
            payload: payload.to_vec(),
        }
    }

    /// The value of a parameter.
    pub(super) fn get(&mut self, name: &str) -> Value {
        self.send(&json!({ "op": "getParameters", "parameterNames": [name], "id": name }));
        let values = self.answered(name);
        assert_eq!(values["parameters"][0]["name"], name);
        values["parameters"][0]["value"].clone()
    }

    /// Reads until the values have come for which the client has asked by `id`.
    pub(super) fn answered(&mut self, id: &str) -> Value {
        loop {
            let values = self.answer("parameterValues");
            if values["id"] == id {
                return values;
            }
        }
    }

    pub(super) fn set(&mut self, name: &str, value: impl Into<Value>) {
        let parameter = json!({ "name": name, "value": value.into() });
        self.send(&json!({ "op": "setParameters", "parameters": [parameter], "id": "set" }));
    }

    /// Reads until the server has ended the connection, and returns what it says of that.
    pub(super) fn closed(mut self) -> CloseCode {
        loop {
            if let Message::Close(frame) = self.read() {
                return frame.unwrap().code;
            }
        }
    }
}

/// The ticks of a loop that a client gets.
#[derive(Default)]
pub(super) struct Ticks {
    last: Option<u64>,
    /// How many were not told as lost and did not come.
    pub(super) missed: u64,
}

impl Ticks {
    pub(super) fn take(&mut self, layout: &Layout, data: &Data) {
        let row = layout.decode(&data.payload).unwrap();
        let head = row.head();
        if let Some(last) = self.last {
            let between = head.tick - last - 1;
            self.missed += between.saturating_sub(head.lost);
        }
        self.last = Some(head.tick);
    }
}
