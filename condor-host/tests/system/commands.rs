//! What the commands say of a system of two fingers.

use std::io::Write;
use std::process::Stdio;

use crate::running::{self, Up};
use condor_hand::monitor::Selection;
use condor_host::view::{View, ViewError};
use condor_mbox::{Messenger, Processor};
use condor_rt::numbers::VISITORS;
use serde_json::Value;

const TWO: &str = r#"
    [[processors]]
    number = 0
    name = "a"
    program = "THIS"
    arguments = ["finger"]
    [[processors]]
    number = 1
    name = "b"
    program = "THIS"
    arguments = ["finger"]
"#;

/// A system of two fingers, whose loops have run and whose terminals are served.
fn start() -> Up {
    let up = Up::start(TWO, &[]);
    for name in ["a", "b"] {
        let mut terminal = up.terminal(name);
        terminal.write_all(b"settled\r").unwrap();
        running::read_until(&mut terminal, "typed settled");
    }
    up
}

fn text(up: &Up, arguments: &[&str]) -> String {
    String::from_utf8(up.run(arguments).stdout).unwrap()
}

fn json(up: &Up, arguments: &[&str]) -> Value {
    let text = text(up, &[arguments, &["--json"]].concat());
    serde_json::from_str(&text).unwrap_or_else(|error| panic!("{error}: {text}"))
}

/// What a command that fails says.
fn complaint(up: &Up, arguments: &[&str]) -> String {
    let output = up.command(arguments).output().unwrap();
    assert!(!output.status.success(), "{arguments:?}: {output:?}");
    String::from_utf8(output.stderr).unwrap()
}

fn strings(rows: &Value, field: &str) -> Vec<String> {
    let rows = rows.as_array().unwrap().iter();
    rows.map(|row| row[field].as_str().unwrap().to_owned())
        .collect()
}

#[test]
fn processors_and_their_loops_are_shown() {
    let up = start();
    let ps = json(&up, &["ps"]);
    let names = strings(&ps["processors"], "name");
    assert_eq!(names, ["a", "b", "files", "terminals"]);
    let b = &ps["processors"][1];
    assert_eq!(b["heart"]["presence"], "up");
    assert_eq!((&b["state"], &b["loops"]), (&"running".into(), &1.into()));
    assert_eq!(b["terminals"][0]["name"], "console");
    assert_eq!(b["terminals"][0]["reader"], 9);
    let table = text(&up, &["ps", "--system", "tested"]);
    assert!(table.starts_with("tested: up "), "{table}");
    assert!(
        table.contains("     1  b          process  running"),
        "{table}"
    );

    let top = json(&up, &["top", "--once"]);
    assert_eq!(strings(&top["loops"], "processor"), ["a", "b"]);
    let servo = &top["loops"][0];
    assert_eq!(servo["name"], "servo");
    assert_eq!(servo["rate_hz"], 100.0);
    assert!(servo["reached_hz"].as_f64().unwrap() > 0.0, "{servo}");
    assert!(servo["worst_run_us"].as_f64().unwrap() > 0.0, "{servo}");
    let table = text(&up, &["top", "--once", "--every", "100ms"]);
    assert_eq!(table.lines().count(), 3, "{table}");

    let wrong = complaint(&up, &["ps", "--system", "other"]);
    assert!(wrong.contains("there are tested"), "{wrong}");
}

#[test]
fn messages_are_sent_and_counted() {
    let up = start();
    let reply = text(&up, &["send", "b", "5", "40", "--reply"]);
    assert_eq!(reply, "42 (0x2a)\n");
    let reply = json(&up, &["send", "1", "add", "0xffff_ffff", "--reply"]);
    assert_eq!(
        (&reply["processor"], &reply["reply"]),
        (&"b".into(), &1.into())
    );
    for _ in 0..3 {
        text(&up, &["send", "b", "0x5", "1"]);
    }
    let vectors = json(&up, &["vectors", "b"]);
    let add = &vectors["vectors"][0];
    assert_eq!((&add["vector"], &add["name"]), (&5.into(), &"add".into()));
    assert_eq!(add["handled"], 5);
    let table = text(&up, &["vectors"]);
    let terminals = table.lines().filter(|line| line.starts_with("terminals "));
    assert!(terminals.count() > 0, "{table}");

    let wrong = complaint(&up, &["send", "c", "5", "1"]);
    assert!(
        wrong.contains("there are a (0), b (1), files (8)"),
        "{wrong}"
    );
    let wrong = complaint(&up, &["send", "b", "ad", "1"]);
    assert!(wrong.contains("`ad` is no vector of b"), "{wrong}");
    assert!(wrong.contains("add (5)"), "{wrong}");
    let wrong = complaint(&up, &["send", "b", "6", "1", "--reply"]);
    assert!(wrong.contains("vector 6"), "{wrong}");
    let wrong = complaint(&up, &["send", "b", "5", "4294967296"]);
    assert!(wrong.contains("a word is 0 to 4294967295"), "{wrong}");
}

#[test]
fn variables_are_watched_and_gains_set() {
    let up = start();
    let list = json(&up, &["vars", "list", "b"]);
    let names = strings(&list["variables"], "name");
    let position = names
        .iter()
        .find(|name| name.ends_with(".position"))
        .unwrap();
    let rows = list["variables"].as_array().unwrap();
    let gain = rows.iter().find(|row| row["can_be_set"] == true).unwrap();
    let gain_name = gain["name"].as_str().unwrap().to_owned();
    let joint = position.strip_suffix("position").unwrap();
    assert!(
        gain_name.starts_with(joint),
        "{gain_name} is not of {joint}"
    );
    let before = gain["value"].as_f64().unwrap();

    let get = json(&up, &["vars", "get", &gain_name, position]);
    assert_eq!(get["variables"][0]["value"], before);
    let value = get["variables"][1]["value"].as_f64().unwrap();
    assert!((value - 0.1).abs() < 1e-3, "{get}");

    let set = json(&up, &["vars", "set", &gain_name, "1.25"]);
    assert_eq!(
        (&set["before"], &set["value"]),
        (&before.into(), &1.25.into())
    );
    let get = json(&up, &["vars", "get", &gain_name]);
    assert_eq!(get["variables"][0]["value"], 1.25);

    let watch = ["vars", "watch", position, "--every", "2", "--for", "1s"];
    let lines = text(&up, &[&watch[..], &["--json"]].concat());
    let lines: Vec<Value> = lines
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    let (end, rows) = lines.split_last().unwrap();
    assert_eq!(end["rows"], rows.len());
    assert!(rows.len() >= 2, "{lines:?}");
    for pair in rows.windows(2) {
        let [from, to] = [0, 1].map(|place: usize| pair[place]["tick"].as_u64().unwrap());
        assert!(to > from && (to - from) % 2 == 0, "{pair:?}");
        assert_eq!(
            end["lost"] == 0,
            to - from == 2 || end["lost"] != 0,
            "{pair:?}"
        );
    }

    let wrong = complaint(
        &up,
        &["vars", "get", &gain_name.replace(joint, "other.joint.")],
    );
    assert!(wrong.contains("the most similar are"), "{wrong}");
    let wrong = complaint(&up, &["vars", "set", position, "1"]);
    assert!(wrong.contains("cannot be set"), "{wrong}");
    let wrong = complaint(&up, &["vars", "set", &gain_name, "-1"]);
    assert!(wrong.contains("-1"), "{wrong}");
}

#[test]
fn a_watcher_leaves_the_selection_of_another() {
    let up = start();
    let system = up.directory().system(65536).unwrap();
    let mut view = View::open(&system).unwrap();
    view.join().unwrap();
    let monitor = view.monitor(Processor(0)).unwrap().unwrap();
    let variables = monitor.variables().unwrap();
    let (name, other) = (variables[1].1.name.clone(), variables[7].0);
    let watch = monitor.watch(view.post(), &[other], 3).unwrap();
    let served = std::thread::scope(|threads| {
        threads
            .spawn(|| json(&up, &["vars", "get", &format!("a:{name}")]))
            .join()
    });
    assert!(served.unwrap()["variables"][0]["value"].is_number());
    let again = view.monitor(Processor(0)).unwrap().unwrap();
    let deadline = std::time::Instant::now() + running::DEADLINE;
    while again.selection().unwrap() != Some(Selection::new([other], 3).unwrap()) {
        assert!(std::time::Instant::now() < deadline, "it is another one");
        view.post()
            .serve(std::time::Duration::from_millis(5))
            .unwrap();
    }
    let mut watch = watch;
    let deadline = std::time::Instant::now() + running::DEADLINE;
    // The rows of the other watcher, and after them its own again, as if nothing had been.
    let mut ticks = Vec::new();
    while ticks.len() < 20 {
        assert!(std::time::Instant::now() < deadline, "{ticks:?}");
        if let Some(sample) = watch.sample().unwrap() {
            assert!(sample.value(other, &variables[7].1).is_some());
            ticks.push(sample.tick);
        }
    }
    let spaced = ticks.windows(2).all(|pair| pair[1] - pair[0] >= 3);
    assert!(spaced, "{ticks:?}");
    watch.end().unwrap();
}

#[test]
fn what_a_killed_watcher_watched_is_forgotten_by_the_next() {
    let up = start();
    let system = up.directory().system(65536).unwrap();
    let mut view = View::open(&system).unwrap();
    view.join().unwrap();
    let monitor = || view.monitor(Processor(0)).unwrap().unwrap();
    let variables = monitor().variables().unwrap();
    let selected = |expected: &[usize]| {
        let deadline = std::time::Instant::now() + running::DEADLINE;
        let monitor = monitor();
        loop {
            let selection = monitor.selection().unwrap();
            let found: Option<Vec<_>> = selection.map(|it| it.variables().collect());
            if found.as_deref() == Some(expected) {
                return;
            }
            assert!(std::time::Instant::now() < deadline, "{found:?}");
            let nap = std::time::Duration::from_millis(5);
            view.post().serve(nap).unwrap();
        }
    };
    let mut watchers = Vec::new();
    for (_, variable) in variables.iter().take(2) {
        let name = format!("a:{}", variable.name);
        let mut command = up.command(&["vars", "watch", &name]);
        watchers.push(command.stdout(Stdio::null()).spawn().unwrap());
    }
    selected(&[0, 1]);
    let [mut first, mut second] = <[_; 2]>::try_from(watchers).unwrap();
    first.kill().unwrap();
    first.wait().unwrap();
    // Nobody has told the monitor yet; who begins does, and keeps what the living one watches.
    let watch = monitor().watch(view.post(), &[variables[7].0], 1).unwrap();
    selected(&[1, 7]);
    second.kill().unwrap();
    second.wait().unwrap();
    watch.end().unwrap();
    selected(&[]);
}

#[test]
fn a_terminal_can_be_typed_at_from_a_script() {
    let up = start();
    let mut child = up
        .command(&["tty", "a", "--for", "5s"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    child.stdin.take().unwrap().write_all(b"ahoy\r").unwrap();
    let mut output = child.stdout.take().unwrap();
    running::read_until(&mut output, "typed ahoy");
    assert!(child.wait().unwrap().success());
    let wrong = complaint(&up, &["tty", "files"]);
    assert!(wrong.contains("there are a (0), b (1)"), "{wrong}");
}

#[test]
fn when_all_visitors_are_there_the_next_is_told_who_they_are() {
    let up = start();
    let system = up.directory().system(65536).unwrap();
    let views: Vec<_> = VISITORS.map(|_| View::open(&system).unwrap()).collect();
    let Err(ViewError::Full { holders }) = View::open(&system) else {
        panic!("there was room for another");
    };
    let this = std::process::id();
    assert!(holders.iter().all(|(_, process)| *process == this));
    assert_eq!(holders.len(), VISITORS.count());
    let wrong = complaint(&up, &["ps"]);
    assert!(
        wrong.contains("all numbers for visitors are taken"),
        "{wrong}"
    );
    assert!(wrong.contains(&format!("{this} (number 11)")), "{wrong}");
    drop(views);
    text(&up, &["ps"]);
}
