//! A motion that a person composes at a page moves a hand of processes.

use std::io::{BufRead, BufReader, ErrorKind};
use std::net::TcpStream;
use std::path::PathBuf;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::time::Instant;

use condor_host::view::View;
use condor_mbox::Processor;
use condor_robot::objects;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::{Value, json};
use tungstenite::client::IntoClientRequest;
use tungstenite::http::HeaderValue;
use tungstenite::{Error, Message, WebSocket};

use crate::up::{DEADLINE, Up};

const PLANT: Processor = Processor(6);
/// The thumb and its middle joint.
const PLACE: [usize; 2] = [3, 2];

/// A running `utah-mit-hand view`, which is killed when the test ends.
struct Server {
    child: Child,
    /// What it prints; it ends if nobody could read that.
    _output: BufReader<ChildStdout>,
    /// The addresses without and with the token.
    addresses: [String; 2],
}

impl Server {
    fn start(up: &Up) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_utah-mit-hand"))
            .args(["view", "--port", "0"])
            .env("XDG_RUNTIME_DIR", up.place())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut output = BufReader::new(child.stdout.take().unwrap());
        let addresses = core::array::from_fn(|_| {
            let mut line = String::new();
            output.read_line(&mut line).unwrap();
            let mut words = line.split(' ');
            words.find(|it| it.starts_with("ws://")).unwrap().to_owned()
        });
        Self {
            child,
            _output: output,
            addresses,
        }
    }

    fn end(mut self) {
        kill_process(Pid::from_child(&self.child), Signal::INT).unwrap();
        assert!(self.child.wait().unwrap().success());
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A page, as far as it calls services.
struct Page {
    socket: WebSocket<TcpStream>,
    services: Vec<Value>,
}

impl Page {
    fn open(address: &str) -> Self {
        let mut request = address.into_client_request().unwrap();
        let offered = HeaderValue::from_static("foxglove.sdk.v1");
        request
            .headers_mut()
            .insert("sec-websocket-protocol", offered);
        let stream = TcpStream::connect(request.uri().authority().unwrap().as_str()).unwrap();
        stream.set_read_timeout(Some(DEADLINE)).unwrap();
        let (mut socket, _) = tungstenite::client(request, stream).unwrap();
        loop {
            let Message::Text(text) = read(&mut socket) else {
                continue;
            };
            let message: Value = text.parse().unwrap();
            if message["op"] == "advertiseServices" {
                let services = message["services"].as_array().unwrap().clone();
                return Self { socket, services };
            }
        }
    }

    fn call(&mut self, name: &str, payload: &Value) -> Result<Value, String> {
        let service = self.services.iter().find(|it| it["name"] == name);
        let service = service.unwrap_or_else(|| panic!("{name}: {:?}", self.services));
        let service = u32::try_from(service["id"].as_u64().unwrap()).unwrap();
        let head = [service, 5, 4].map(u32::to_le_bytes);
        let payload = payload.to_string();
        let frame = [&[2], head.as_flattened(), b"json", payload.as_bytes()].concat();
        self.socket.send(Message::binary(frame)).unwrap();
        loop {
            match read(&mut self.socket) {
                Message::Binary(bytes) if bytes[0] == 3 => {
                    return Ok(serde_json::from_slice(&bytes[17..]).unwrap());
                }
                Message::Text(text) if text.contains("serviceCallFailure") => {
                    let message: Value = text.parse().unwrap();
                    return Err(message["message"].as_str().unwrap().to_owned());
                }
                _ => {}
            }
        }
    }

    fn good(&mut self, name: &str, payload: &Value) -> Value {
        let answer = self.call(name, payload);
        answer.unwrap_or_else(|reason| panic!("{name}: {reason}"))
    }

    fn fails(&mut self, name: &str, payload: &Value, reason: &str) {
        let told = self.call(name, payload).unwrap_err();
        assert!(told.contains(reason), "{name}: {told}");
    }

    /// Waits until a motion has ended.
    fn end(&mut self, id: &Value) -> Value {
        let deadline = Instant::now() + DEADLINE;
        loop {
            let outcome = self.good("/sim/outcome", &json!({ "id": id }));
            if outcome["isFinal"] == true {
                return outcome;
            }
            assert!(Instant::now() < deadline, "{outcome}");
        }
    }
}

/// Reads a message. A read with a timeout is not restarted after a signal, such as that of a child's end.
fn read(socket: &mut WebSocket<TcpStream>) -> Message {
    loop {
        match socket.read() {
            Err(Error::Io(error)) if error.kind() == ErrorKind::Interrupted => {}
            read => return read.unwrap(),
        }
    }
}

fn motion(position: f64) -> String {
    format!(
        "[[motion]]\nprofile = \"minimum-jerk\"\nduration = 0.3\nto = {{ \"thumb.middle\" = {position} }}\n"
    )
}

/// Returns the names of composed motions that lie where the master finds them.
fn offered(up: &Up) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(up.place().join("files/motions")).unwrap();
    let paths = entries.map(|entry| entry.unwrap().path());
    let is_offered = |path: &PathBuf| path.to_string_lossy().contains("/view-");
    paths.filter(is_offered).collect()
}

#[test]
fn a_composed_motion_moves_the_hand() {
    let mut up = Up::start("composed", "1", |text| text.replace("run wave", "run open"));
    up.expect("open is done\n");
    let view = View::open(&up.directory(), up.status().window_bytes).unwrap();
    let server = Server::start(&up);
    let [looking, trusted] = &server.addresses;
    let (mut stranger, mut page) = (Page::open(looking), Page::open(trusted));
    let robot = stranger.good("/sim/robot", &json!({}));
    assert_eq!(robot["hasQueue"], true);
    assert_eq!(robot["hasMotions"], true);
    let tips = ["index.tip", "middle.tip", "ring.tip", "thumb.tip"];
    assert_eq!(robot["handles"], json!(tips));
    let plan = json!({ "from": robot["start"], "text": motion(0.9) });
    assert_eq!(stranger.good("/sim/plan", &plan)["duration"], 0.3);

    let composed = json!({ "text": motion(0.9), "control": false });
    stranger.fails("/sim/enqueue", &composed, "without the token");
    let id = page.good("/sim/enqueue", &composed)["id"].clone();
    let outcome = page.end(&id);
    assert_eq!(outcome["state"], "done", "{outcome}");
    assert_eq!(outcome["reason"], Value::Null);
    up.expect(" is done\n");
    let region = view.region(PLANT).unwrap();
    let truth = objects::truth(&region).unwrap().unwrap();
    let truth = truth.subscriber(&region).unwrap().read().unwrap().value;
    let [finger, joint] = PLACE;
    let middle = truth.position[finger][joint];
    assert!((middle - 0.9).abs() < 0.02, "{middle}");
    assert_eq!(offered(&up), Vec::<PathBuf>::new());

    // A motion that cannot be is refused, and the outcome says why.
    let far = json!({ "text": motion(7.0) });
    let id = page.good("/sim/enqueue", &far)["id"].clone();
    let outcome = stranger.end(&id);
    assert_eq!(outcome["state"], "refused");
    let reason = "a position, a pace or a guard is not possible; the master's terminal says which";
    assert_eq!(outcome["reason"], reason);
    page.fails("/sim/enqueue", &json!({ "text": "[[motion" }), "motion:1");
    page.fails(
        "/sim/outcome",
        &json!({ "id": 99 }),
        "does not know motion 99",
    );

    // Somebody at the terminal is in control until it is taken.
    up.types("control");
    // Its answer comes after the terminal has taken control.
    up.types("status");
    up.expect("table: ");
    page.fails("/sim/enqueue", &composed, " is in control");
    assert_eq!(offered(&up), Vec::<PathBuf>::new());
    let slow = motion(0.5).replace("0.3", "5.0");
    let taking = json!({ "text": slow, "control": true });
    page.good("/sim/enqueue", &taking);
    page.good("/sim/enqueue", &composed);
    assert_eq!(offered(&up).len(), 2);
    drop((stranger, page));
    server.end();
    assert_eq!(offered(&up), Vec::<PathBuf>::new());
}

#[test]
fn motions_are_opened_and_saved() {
    let mut up = Up::start("saved", "1", |text| {
        text.replace("root = \"files\"", "root = \"own/files\"")
    });
    // The master answers when it has set up what it publishes.
    up.types("status");
    up.expect("table: ");
    let server = Server::start(&up);
    let [looking, trusted] = &server.addresses;
    let (mut stranger, mut page) = (Page::open(looking), Page::open(trusted));
    let files = |page: &mut Page| page.good("/sim/motions", &json!({}))["files"].clone();
    assert_eq!(files(&mut stranger), json!([]));
    let save = |text: &str, replace: bool| json!({ "file": "mine.toml", "text": text, "replace": replace });
    let (one, other) = (motion(0.9), motion(0.8));
    stranger.fails("/sim/save", &save(&one, false), "without the token");
    page.good("/sim/save", &save(&one, false));
    page.fails(
        "/sim/save",
        &save(&other, false),
        "the file mine.toml exists already",
    );
    assert_eq!(files(&mut stranger), json!(["mine.toml"]));
    let open = json!({ "file": "mine.toml" });
    assert_eq!(stranger.good("/sim/open", &open)["text"], one);
    page.good("/sim/save", &save(&other, true));
    assert_eq!(stranger.good("/sim/open", &open)["text"], other);
    // The system would not come up with it.
    let wrong = other.replace("thumb", "toe");
    page.fails("/sim/save", &save(&wrong, true), "mine.toml:4");
    for name in [
        "../mine.toml",
        "/etc/passwd",
        "mine",
        ".toml",
        "a/b.toml",
        "mine.toml\0",
    ] {
        let file = json!({ "file": name });
        stranger.fails("/sim/open", &file, "cannot be the name of a motion file");
        let file = json!({ "file": name, "text": one });
        page.fails("/sim/save", &file, "cannot be the name of a motion file");
    }
    stranger.fails("/sim/open", &json!({ "file": "none.toml" }), "none.toml");
}
