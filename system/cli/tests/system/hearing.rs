//! Who hears the messages to a processor of another one.

use std::io::{BufRead, BufReader, Lines, Read};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};

use condor_cli::recording::{RecordingError, RecordingReader};
use condor_host::control::MemberState;
use condor_host::view::View;
use condor_mbox::{Messenger, Processor, Vector};
use condor_vars::AnyValue;
use rustix::process::Signal;
use serde_json::{Value, json};

use crate::clock::{DIARIES, SIMULATED, assert_same, outcome};
use crate::joint::{start, start_one};
use crate::running::{self, DEADLINE, Up, kill, signal};

const B: Processor = Processor(1);
const ADD: Vector = Vector(5);
const PATIENCE: Duration = Duration::from_secs(60);
/// So many messages that a delay of 100 ms for each ringful would last longer than [`DEADLINE`].
const MANY: u32 = 20_000;

/// A `vectors --follow` that has begun to hear what it is to hear.
struct Observer {
    child: Child,
    lines: Lines<BufReader<ChildStdout>>,
    told: BufReader<std::process::ChildStderr>,
}

impl Observer {
    fn start(up: &Up, arguments: &[&str], hears: &[&str]) -> Self {
        let mut command: Command = up.command(&["vectors", "--follow"]);
        let command = command.args(arguments);
        let mut child = command
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let told = BufReader::new(child.stderr.take().unwrap());
        let mut observer = Self { child, lines, told };
        for _ in hears {
            let line = observer.told();
            let begins = |name: &&&str| line.ends_with(&format!("hears the messages to {name}\n"));
            assert!(hears.iter().any(|name| begins(&name)), "{line}");
        }
        observer
    }

    /// The next line of standard error.
    fn told(&mut self) -> String {
        let mut line = String::new();
        self.told.read_line(&mut line).unwrap();
        line
    }

    fn line(&mut self) -> String {
        self.lines.next().expect("a line").unwrap()
    }

    /// The next message.
    fn message(&mut self) -> Value {
        let line = self.line();
        serde_json::from_str(&line).unwrap_or_else(|error| panic!("{error}: {line}"))
    }

    /// The next message to be added to; the terminal service sends others.
    fn added(&mut self) -> Value {
        loop {
            let message = self.message();
            if message["name"] == "add" {
                return message;
            }
        }
    }

    /// As ^C does; returns the rest of both outputs.
    fn end(self) -> (Vec<String>, String) {
        signal(self.child.id(), Signal::INT);
        self.ended()
    }

    fn ended(mut self) -> (Vec<String>, String) {
        let lines = self.lines.map(Result::unwrap).collect();
        let mut told = String::new();
        self.told.read_to_string(&mut told).unwrap();
        assert!(self.child.wait().unwrap().success(), "{told}");
        (lines, told)
    }
}

/// Sends `MANY` messages with replies to B, one after the other, and returns their sender.
fn send_many(up: &Up) -> View {
    let mut view = View::open(&up.directory(), 65536).unwrap();
    let post = view.join().unwrap();
    let begun = Instant::now();
    for data in 0..MANY {
        let reply = post.send_with_reply(B, ADD, data, PATIENCE);
        assert_eq!(reply, Ok(data + 2));
        assert!(begun.elapsed() < DEADLINE, "{data} messages were sent");
    }
    view
}

#[test]
fn messages_are_shown_as_they_come() {
    let up = start(&[]);
    let mut one = Observer::start(&up, &["b", "--json"], &["b"]);
    let mut all = Observer::start(&up, &[], &["a", "b"]);
    up.run(&["send", "b", "add", "-300", "--reply"]);
    up.run(&["send", "a", "63", "7"]);
    let message = one.message();
    assert!(message["heard_ns"].as_u64() > Some(0), "{message}");
    let sender = message["from"].as_str().unwrap();
    assert!(sender.starts_with("visitor "), "{message}");
    let fields = ["to", "vector", "name", "data", "missed"].map(|name| message[name].clone());
    let expected = [
        json!("b"),
        json!(5),
        json!("add"),
        json!(0xffff_fed4_u32),
        json!(0),
    ];
    assert_eq!(fields, expected);
    let titles = all.line();
    assert!(titles.ends_with("data"), "{titles}");
    let to_b = all.line();
    assert!(to_b.starts_with("    0.000000  visitor "), "{to_b}");
    assert!(
        to_b.ends_with("  b             5 add                 0xfffffed4  4294966996 or -300"),
        "{to_b}"
    );
    // Nobody handles it, and it is shown.
    let to_a = all.line();
    assert!(
        to_a.ends_with("  a             63                    0x00000007  7"),
        "{to_a}"
    );
    let (rest, _) = one.end();
    let summary: Value = serde_json::from_str(&rest[0]).unwrap();
    let expected = json!({ "processors": [{ "processor": "b", "messages": 1, "missed": 0 }] });
    assert_eq!(summary, expected);
    let (_, told) = all.end();
    assert!(
        told.contains("a: 1 messages, 0 missed\nb: 1 messages, 0 missed"),
        "{told}"
    );
}

#[test]
fn a_processor_is_heard_when_it_comes_and_after_a_restart_until_the_system_ends() {
    let up = start_one();
    up.run(&["stop", "b"]);
    let mut observer = Observer::start(&up, &["b", "--json"], &[]);
    let line = observer.told();
    assert!(line.contains("waits until b is up: "), "{line}");
    crate::joint::load_joint(&up);
    let line = observer.told();
    assert!(line.ends_with("hears the messages to b\n"), "{line}");
    up.run(&["send", "b", "add", "1", "--reply"]);
    assert_eq!(observer.added()["data"], 1);
    let events = up.events();
    kill(up.status().processors[1].pid.unwrap());
    running::wait(events, "b", MemberState::Running);
    up.read_terminal("b", "hello");
    up.run(&["send", "b", "add", "2", "--reply"]);
    assert_eq!(observer.added()["data"], 2);
    up.run(&["down"]);
    let (_, told) = observer.ended();
    assert!(told.contains("the system has ended"), "{told}");
}

/// A sender that waits for its messages to be taken is delayed once, and one that waits for a reply gets it.
#[test]
fn an_observer_that_is_stopped_delays_a_sender_once_and_counts_what_it_missed() {
    let up = start(&[]);
    let mut observer = Observer::start(&up, &["b", "--json"], &["b"]);
    signal(observer.child.id(), Signal::STOP);
    let _sender = send_many(&up);
    signal(observer.child.id(), Signal::CONT);
    up.run(&["send", "b", "add", "4321", "--reply"]);
    let mut counts = [0, 0];
    loop {
        let message = observer.message();
        counts[0] += 1;
        counts[1] += message["missed"].as_u64().unwrap();
        if message["data"] == 4321 {
            break;
        }
    }
    assert_eq!(counts[0] + counts[1], u64::from(MANY) + 1, "{counts:?}");
    assert!(counts[1] > 0, "{counts:?}");
    let (rest, _) = observer.end();
    let summary: Value = serde_json::from_str(&rest[0]).unwrap();
    assert_eq!(summary["processors"][0]["missed"], counts[1]);
}

#[test]
fn an_observer_that_is_killed_delays_nobody() {
    let up = start(&[]);
    let mut observer = Observer::start(&up, &["b", "--json"], &["b"]);
    // Its number stays in the list of the listeners.
    kill(observer.child.id());
    observer.child.wait().unwrap();
    send_many(&up);
    // Another observer takes its number.
    let mut next = Observer::start(&up, &["b", "--json"], &["b"]);
    up.run(&["send", "b", "add", "4321", "--reply"]);
    assert_eq!(next.message()["data"], 4321);
    next.end();
}

/// Whether somebody listens, and how fast, changes nothing in simulated time.
#[test]
fn a_run_in_simulated_time_is_the_same_with_an_observer() {
    let run = |speed: &str| {
        let options = [SIMULATED, &["--for", "3s", "--speed", speed]].concat();
        Up::launch(DIARIES, &options, |_| {})
    };
    let unobserved = outcome(&run("max"));
    let up = run("1");
    up.wait_until_started();
    let mut command = up.command(&["vectors", "--follow", "b", "--json"]);
    let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let of_a = lines.find(|line| line.as_ref().unwrap().contains("\"from\":\"a\""));
    let message: Value = serde_json::from_str(&of_a.unwrap().unwrap()).unwrap();
    assert_eq!(
        (&message["to"], &message["name"]),
        (&"b".into(), &"add".into())
    );
    // It hears nothing for some time.
    signal(child.id(), Signal::STOP);
    let seconds = || up.status().clock.expect("a simulated clock").seconds;
    let stopped = seconds();
    while seconds() < stopped + 0.5 {}
    signal(child.id(), Signal::CONT);
    let observed = outcome(&up);
    assert_eq!(
        lines
            .last()
            .map(|it| it.unwrap().contains("\"processors\"")),
        Some(true)
    );
    assert!(child.wait().unwrap().success());
    assert_same(&unobserved, &observed);
}

#[test]
fn messages_are_recorded_as_rows() {
    let up = start(&[]);
    let path = up.path("run.mcap");
    let mut command: Command = up.command(&["record"]);
    command.arg(&path).args(["a:ticks", "--messages", "b"]);
    let mut child = command.stderr(Stdio::piped()).spawn().unwrap();
    // Until it hears; the first of them is recorded.
    let begun = Instant::now();
    let counts = || {
        let bytes = std::fs::read(up.path("run.mcap.taken")).unwrap_or_default();
        let counts = bytes.get(16..).unwrap_or_default().chunks_exact(8);
        let counts = counts.map(|count| u64::from_le_bytes(count.try_into().unwrap()));
        // The last channel is that of the messages.
        counts.collect::<Vec<_>>().get(3).copied().unwrap_or(0)
    };
    while counts() == 0 {
        up.run(&["send", "b", "add", "17", "--reply"]);
        assert!(begun.elapsed() < DEADLINE);
    }
    let before = counts();
    up.run(&["send", "b", "add", "300", "--reply"]);
    while counts() == before {
        assert!(begun.elapsed() < DEADLINE);
    }
    signal(child.id(), Signal::INT);
    let mut told = String::new();
    child
        .stderr
        .take()
        .unwrap()
        .read_to_string(&mut told)
        .unwrap();
    assert!(child.wait().unwrap().success(), "{told}");
    assert!(told.contains("/b/messages: "), "{told}");
    let reader = RecordingReader::open(&path).unwrap();
    let source = reader
        .sources()
        .iter()
        .position(|it| it.owner == "messages");
    let mut rows = Vec::new();
    let read = reader.rows(&[source.unwrap()], reader.span(), |_, _, row| {
        let values = [0, 1, 2].map(|field| row.value(field).unwrap());
        rows.push((row.head().tick, row.head().lost, values));
        Ok::<_, RecordingError>(())
    });
    read.unwrap();
    for (number, (tick, lost, [sender, vector, _])) in (0..).zip(&rows) {
        assert_eq!((*tick, *lost), (number, 0));
        assert!(matches!(sender, AnyValue::Choice(20..=31)), "{sender}");
        assert_eq!(*vector, AnyValue::Uint(5));
    }
    let data: Vec<_> = rows.iter().map(|(.., [.., data])| *data).collect();
    assert_eq!(data.first(), Some(&AnyValue::Uint(17)));
    assert_eq!(data.last(), Some(&AnyValue::Uint(300)));
    let csv = up.path("run.csv");
    let (run, csv_path) = (path.to_str().unwrap(), csv.to_str().unwrap());
    up.run(&["export", run, "b:message.*", "--csv", csv_path]);
    let text = std::fs::read_to_string(csv).unwrap();
    assert!(text.contains(",b:messages,0,0,visitor "), "{text}");
    assert!(text.trim_end().ends_with(",5,300"), "{text}");
}
