//! What the commands say of a system of two joints.

use std::io::{BufRead, BufReader, Read, Write};
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use crate::joint::{TWO, load_joint, start_one};
use crate::running::{self, Up};
use condor_host::view::{View, ViewError};
use condor_rt::numbers::VISITORS;
use rustix::process::Signal;
use serde_json::{Value, json};

/// A system of two joints, whose loops have run and whose terminals are served.
fn start() -> Up {
    let up = Up::start(TWO, &[]);
    for name in ["a", "b"] {
        let mut terminal = up.terminal(name);
        terminal.write_all(b"settled\r").unwrap();
        running::read_until(&mut terminal, "typed settled");
    }
    up
}

pub(crate) fn text(up: &Up, arguments: &[&str]) -> String {
    String::from_utf8(up.run(arguments).stdout).unwrap()
}

pub(crate) fn answer(up: &Up, arguments: &[&str]) -> Value {
    let text = text(up, &[arguments, &["--json"]].concat());
    serde_json::from_str(&text).unwrap_or_else(|error| panic!("{error}: {text}"))
}

/// What a command that fails says.
pub(crate) fn complaint(up: &Up, arguments: &[&str]) -> String {
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
    let ps = answer(&up, &["ps"]);
    let names = strings(&ps["processors"], "name");
    assert_eq!(names, ["a", "b", "files", "terminals"]);
    let b = &ps["processors"][1];
    assert_eq!(b["heart"]["presence"], "up");
    assert_eq!((&b["state"], &b["loops"]), (&"running".into(), &2.into()));
    assert_eq!(b["terminals"][0]["name"], "console");
    assert_eq!(b["terminals"][0]["reader"], 14);
    let table = text(&up, &["ps", "--system", "tested"]);
    assert!(table.starts_with("tested: up "), "{table}");
    assert!(
        table.contains("     1  b          process  running"),
        "{table}"
    );

    let top = answer(&up, &["top", "--once"]);
    assert_eq!(strings(&top["loops"], "processor"), ["a", "a", "b", "b"]);
    let servo = &top["loops"][0];
    assert_eq!(servo["name"], "servo");
    assert_eq!(servo["rate_hz"], 100.0);
    assert!(servo["reached_hz"].as_f64().unwrap() > 0.0, "{servo}");
    assert!(servo["worst_run_us"].as_f64().unwrap() > 0.0, "{servo}");
    let table = text(&up, &["top", "--once", "--every", "100ms"]);
    assert_eq!(table.lines().count(), 15, "{table}");
    let late = &servo["lateness_percentiles_us"];
    assert!(late["p50"].as_f64() <= late["p99_9"].as_f64(), "{servo}");
    assert!(
        late["p99_9"].as_f64() <= servo["worst_lateness_us"].as_f64(),
        "{servo}"
    );
    assert!(
        servo["run_percentiles_us"]["p50"].as_f64().unwrap() > 0.0,
        "{servo}"
    );
}

#[test]
fn messages_are_sent_and_counted() {
    let up = start();
    let reply = text(&up, &["send", "b", "5", "40", "--reply"]);
    assert_eq!(reply, "42 (0x2a)\n");
    let reply = text(&up, &["send", "b", "5", "-300", "--reply"]);
    assert_eq!(reply, "4294966998 (0xfffffed6, as a signed number -298)\n");
    for arguments in [["-0x12c", "--reply"], ["--reply", "-0x12c"]] {
        let again = text(&up, &[&["send", "b", "5"], &arguments[..]].concat());
        assert_eq!(again, reply);
    }
    let reply = answer(&up, &["send", "1", "add", "0xffff_ffff", "--reply"]);
    assert_eq!(
        (&reply["processor"], &reply["reply"]),
        (&"b".into(), &1.into())
    );
    for _ in 0..3 {
        text(&up, &["send", "b", "0x5", "1"]);
    }
    let vectors = answer(&up, &["vectors", "b"]);
    let add = &vectors["vectors"][0];
    assert_eq!((&add["vector"], &add["name"]), (&5.into(), &"add".into()));
    assert_eq!(add["handled"], 8);
    let table = text(&up, &["vectors"]);
    let terminals = table.lines().filter(|line| line.starts_with("terminals "));
    assert!(terminals.count() > 0, "{table}");
}

#[test]
fn variables_parameters_and_fields_are_listed() {
    let up = start();
    let list = answer(&up, &["vars", "list", "b"]);
    let rows = list["variables"].as_array().unwrap();
    let names = strings(&list["variables"], "name");
    let row = |name: &str| {
        let place = names.iter().position(|it| it == name);
        let place = place.unwrap_or_else(|| panic!("no {name}: {names:?}"));
        rows[place].clone()
    };
    assert_eq!(
        row("joint.position"),
        json!({
            "processor": "b", "loop": "servo", "name": "joint.position", "type": "f64",
            "unit": "rad", "about": "Filtered.", "can_be_set": false
        })
    );
    assert_eq!(
        row("joint.stiffness"),
        json!({
            "processor": "b", "loop": "servo", "name": "joint.stiffness", "type": "f64",
            "unit": "N m/rad", "about": "", "can_be_set": true, "bounds": [0.0, 50.0],
            "value": 2.0
        })
    );
    assert_eq!(
        row("mode"),
        json!({
            "processor": "b", "loop": "servo", "name": "mode", "type": "choice",
            "unit": "", "about": "", "can_be_set": true, "bounds": ["idle", "hold"],
            "labels": ["idle", "hold", "fault"], "value": "idle"
        })
    );
    assert_eq!(
        row("contact.force"),
        json!({
            "processor": "b", "cell": "contact", "name": "contact.force", "type": "f32",
            "unit": "N", "about": "At the tip.", "can_be_set": false, "value": 1.5
        })
    );
    assert_eq!(row("beats")["loop"], "slow");
    assert!(rows.iter().all(|row| row["processor"] == "b"), "{list}");

    let table = text(&up, &["vars", "list"]);
    let lines = |begin: &str| table.lines().filter(|line| line.starts_with(begin)).count();
    assert_eq!((lines("a "), lines("b ")), (rows.len(), rows.len()));
    assert!(table.contains("idle, hold"), "{table}");
    assert!(table.contains("0.0 to 50.0"), "{table}");
}

#[test]
fn values_are_shown_and_parameters_set() {
    let up = start();
    let names = [
        "b:joint.stiffness",
        "b:ticks",
        "b:contact.fingers",
        "a:mode",
    ];
    let get = answer(&up, &[&["vars", "get"], &names[..]].concat());
    let value = |place: usize| get["variables"][place]["value"].clone();
    assert_eq!(
        [value(0), value(2), value(3)],
        [json!(2.0), json!(3), json!("idle")]
    );
    assert!(value(1).as_u64().unwrap() > 0, "{get}");

    let set = answer(&up, &["vars", "set", "b:joint.stiffness", "1.25"]);
    assert_eq!((&set["before"], &set["value"]), (&json!(2.0), &json!(1.25)));
    let told = text(&up, &["vars", "set", "b:joint.stiffness", "1e1"]);
    assert_eq!(told, "b:joint.stiffness: 1.25 -> 10.0 N m/rad\n");
    let told = text(&up, &["vars", "set", "b:servo:mode", "hold"]);
    assert_eq!(told, "b:servo:mode: idle -> hold\n");
    let told = text(&up, &["vars", "set", "b:soft", "true", "--from", "false"]);
    assert_eq!(told, "b:soft: false -> true\n");
    let names = ["a:joint.stiffness", "b:joint.stiffness", "b:mode", "b:soft"];
    let get = answer(&up, &[&["vars", "get"], &names[..]].concat());
    let value = |place: usize| get["variables"][place]["value"].clone();
    let values = [value(0), value(1), value(2), value(3)];
    assert_eq!(
        values,
        [json!(2.0), json!(10.0), json!("hold"), json!(true)]
    );
}

#[test]
fn people_set_the_rates_of_loops() {
    let up = start();
    let followed = |is: &dyn Fn(&Value) -> bool| {
        let deadline = Instant::now() + Duration::from_secs(60);
        let slow = || answer(&up, &["top", "--once", "--every", "50ms"])["loops"][3].clone();
        while !is(&slow()) {
            assert!(Instant::now() < deadline, "{}", slow());
        }
    };
    let told = text(&up, &["vars", "set", "b:slow.hz", "12.5"]);
    assert_eq!(told, "b:slow.hz: 20.0 -> 12.5 Hz\n");
    followed(&|slow| slow["rate_hz"] == 12.5);
    text(&up, &["vars", "set", "b:slow.hz", "0"]);
    followed(&|slow| slow["enabled"] == false);
    text(&up, &["vars", "set", "b:slow.hz", "20"]);
    followed(&|slow| slow["enabled"] == true && slow["rate_hz"] == 20.0);
    let told = complaint(&up, &["vars", "set", "b:slow.hz", "21"]);
    assert!(
        told.contains("`b:slow.hz` must be from 0.0 to 20.0 Hz, not 21.0"),
        "{told}"
    );
    let told = complaint(&up, &["vars", "set", "b:servo.hz", "50"]);
    assert!(told.contains("`b:servo.hz`"), "{told}");
}

#[test]
fn patterns_choose_variables_and_fields() {
    let up = start();
    let names = ["a:t?cks", "*:contact.f?rce", "a:ticks"];
    let text = text(
        &up,
        &[&["vars", "watch"], &names[..], &["--for", "1s", "--json"]].concat(),
    );
    let (rows, summary) = rows(&text);
    let mut seen: Vec<_> = rows
        .iter()
        .flat_map(|row| row["values"].as_object().unwrap().keys().cloned())
        .collect();
    seen.sort();
    seen.dedup();
    assert_eq!(seen, ["a:contact.force", "a:ticks", "b:contact.force"]);
    assert_eq!(summary["loops"].as_array().unwrap().len(), 3, "{summary}");
}

/// The rows of a `vars watch`, and its summary.
fn rows(text: &str) -> (Vec<Value>, Value) {
    let lines = text.lines().map(|line| serde_json::from_str(line).unwrap());
    let mut lines: Vec<Value> = lines.collect();
    let summary = lines.pop().unwrap();
    (lines, summary)
}

fn number(row: &Value, field: &str) -> u64 {
    let number = row[field].as_u64();
    number.unwrap_or_else(|| panic!("no {field}: {row}"))
}

#[test]
fn loops_of_two_processors_are_watched_on_one_axis() {
    let up = start();
    let names = ["a:joint.position", "b:mode", "b:ticks", "b:beats"];
    let options = ["--every", "2", "--for", "2s", "--json"];
    let (rows, summary) = rows(&text(
        &up,
        &[&["vars", "watch"], &names[..], &options].concat(),
    ));
    assert_eq!(summary["rows"], rows.len());
    let times: Vec<_> = rows.iter().map(|row| number(row, "released_ns")).collect();
    assert!(times.is_sorted(), "{times:?}");
    for (name, shown) in [
        ("a:servo", &names[..1]),
        ("b:servo", &names[1..3]),
        ("b:slow", &names[3..]),
    ] {
        let of_loop: Vec<_> = rows.iter().filter(|row| row["loop"] == name).collect();
        let loops = summary["loops"].as_array().unwrap();
        let counted = loops.iter().find(|it| it["loop"] == name).unwrap();
        assert_eq!(counted["rows"], of_loop.len(), "{summary}");
        let [first, .., last] = &of_loop[..] else {
            panic!("{name}: {of_loop:?}");
        };
        // Each is a row, or is counted.
        let ticks = number(last, "tick") - number(first, "tick");
        let missed = number(counted, "lost");
        assert_eq!(ticks / 2 + 1, of_loop.len() as u64 + missed, "{summary}");
        for row in of_loop {
            let (tick, values) = (number(row, "tick"), row["values"].as_object().unwrap());
            assert!(values.keys().eq(shown), "{row}");
            for (name, value) in values {
                let expected = match name.as_str() {
                    "a:joint.position" => json!(0.5 * f64::from(u32::try_from(tick).unwrap())),
                    "b:mode" => json!("idle"),
                    _ => json!(tick),
                };
                assert_eq!(*value, expected, "{row}");
            }
        }
    }

    let output = up.run(&["vars", "watch", "a:joint.position", "b:mode", "--for", "1s"]);
    let (text, told) = (
        String::from_utf8(output.stdout).unwrap(),
        String::from_utf8(output.stderr).unwrap(),
    );
    let title = text.lines().next().unwrap();
    assert!(
        title.ends_with("  a:joint.position [rad]        b:mode"),
        "{title}"
    );
    assert!(text.lines().any(|line| line.ends_with(" idle")), "{text}");
    assert!(
        told.contains("a:servo: ") && told.contains("b:servo: "),
        "{told}"
    );
}

#[test]
fn rows_that_a_watcher_misses_are_counted() {
    let up = start();
    let mut command = up.command(&["vars", "watch", "a:ticks", "--json"]);
    let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap());
    let mut text = String::new();
    lines.read_line(&mut text).unwrap();
    running::signal(child.id(), Signal::STOP);
    let ticks = || {
        let get = answer(&up, &["vars", "get", "a:ticks"]);
        number(&get["variables"][0], "value")
    };
    // Longer than its ring keeps rows.
    let begin = ticks();
    while ticks() < begin + 300 {}
    running::signal(child.id(), Signal::INT);
    running::signal(child.id(), Signal::CONT);
    lines.read_to_string(&mut text).unwrap();
    assert!(child.wait().unwrap().success());
    let (rows, summary) = rows(&text);
    let [first, .., last] = &rows[..] else {
        panic!("{rows:?}");
    };
    let missed = number(&summary, "lost");
    assert!(missed > 0, "{summary}");
    let ticks = number(last, "tick") - number(first, "tick");
    assert_eq!(ticks + 1, rows.len() as u64 + missed, "{summary}");
}

#[test]
fn watchers_have_a_selection_each_and_end_by_themselves() {
    let up = start();
    let watch = |name: &str, every: &str| {
        let mut command = up.command(&["vars", "watch", name, "--every", every, "--json"]);
        let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap());
        let mut first = String::new();
        lines.read_line(&mut first).unwrap();
        (child, lines, first)
    };
    // Twice as many as a loop has slots: each gives its own back.
    for _ in 0..2 {
        let watchers = [
            watch("a:ticks", "3"),
            watch("a:joint.position", "1"),
            watch("a:mode", "5"),
            watch("a:soft", "1"),
        ];
        let wrong = complaint(&up, &["vars", "get", "a:ticks"]);
        assert!(
            wrong.contains("all 4 slots for watchers are in use"),
            "{wrong}"
        );
        for ((mut child, mut lines, mut text), (name, every)) in watchers.into_iter().zip([
            ("a:ticks", 3),
            ("a:joint.position", 1),
            ("a:mode", 5),
            ("a:soft", 1),
        ]) {
            running::signal(child.id(), Signal::INT);
            lines.read_to_string(&mut text).unwrap();
            assert!(child.wait().unwrap().success());
            let (rows, summary) = rows(&text);
            assert_eq!(summary["rows"], rows.len());
            for row in &rows {
                assert!(
                    row["values"].as_object().unwrap().keys().eq([name]),
                    "{row}"
                );
            }
            for pair in rows.windows(2) {
                let ticks = number(&pair[1], "tick") - number(&pair[0], "tick");
                assert!(ticks > 0 && ticks.is_multiple_of(every), "{pair:?}");
            }
        }
    }
}

#[test]
fn the_slot_of_a_killed_watcher_is_taken_back() {
    let up = start();
    let mut watchers: Vec<_> = ["a:ticks", "a:mode", "a:soft", "a:joint.position"]
        .into_iter()
        .map(|name| {
            let mut command = up.command(&["vars", "watch", name]);
            let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
            let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
            // The titles, and the first row: it has its slot.
            assert!(lines.by_ref().take(2).all(|line| line.is_ok()));
            (child, lines)
        })
        .collect();
    let wrong = complaint(&up, &["vars", "get", "a:ticks"]);
    assert!(
        wrong.contains("all 4 slots for watchers are in use"),
        "{wrong}"
    );
    let (killed, _) = &mut watchers[1];
    killed.kill().unwrap();
    killed.wait().unwrap();
    let get = answer(&up, &["vars", "get", "a:ticks"]);
    assert!(number(&get["variables"][0], "value") > 0);
    for (mut child, _) in watchers {
        let _ = child.kill();
        child.wait().unwrap();
    }
}

#[test]
fn a_watch_tells_of_programs_that_come_later() {
    let up = start_one();
    let mut command = up.command(&["vars", "watch", "*:ticks", "--json"]);
    let command = command.stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    let mut rows = BufReader::new(child.stdout.take().unwrap()).lines();
    // It knows what is there.
    rows.next().unwrap().unwrap();
    let others = thread::spawn(|| rows.for_each(|row| drop(row.unwrap())));
    load_joint(&up);
    let told = BufReader::new(child.stderr.take().unwrap()).lines();
    let text = "condor: b:servo started later and is not shown; run the command again to watch it";
    let is_told = told.map(Result::unwrap).any(|line| line == text);
    running::signal(child.id(), Signal::INT);
    assert!(child.wait().unwrap().success() && is_told);
    others.join().unwrap();
}

#[test]
fn a_watch_of_a_stopped_program_begins_with_it() {
    let up = start();
    up.run(&["stop", "b"]);
    // A watch of it waits for its program.
    let mut command = up.command(&["vars", "watch", "b:ticks", "--json"]);
    let command = command.stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    let mut told = String::new();
    BufReader::new(child.stderr.as_mut().unwrap())
        .read_line(&mut told)
        .unwrap();
    assert!(
        told.contains("its rows begin when its program answers"),
        "{told}"
    );
    up.run(&["start", "b"]);
    let row = BufReader::new(child.stdout.take().unwrap()).lines().next();
    assert!(row.unwrap().unwrap().contains("\"b:ticks\""));
    running::signal(child.id(), Signal::INT);
    child.wait().unwrap();
}

#[test]
fn a_watch_goes_on_when_its_program_is_started_anew() {
    let up = start();
    let mut command = up.command(&["vars", "watch", "a:ticks", "--json"]);
    let command = command.stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let row = |lines: &mut dyn Iterator<Item = std::io::Result<String>>| {
        let line = lines.next().unwrap().unwrap();
        let row = serde_json::from_str(&line).unwrap();
        (number(&row, "tick"), number(&row, "lost"))
    };
    let mut last = row(&mut lines);
    while last.0 < 100 {
        last = row(&mut lines);
    }
    running::kill(up.status().processors[0].pid.unwrap());
    let first = loop {
        let next = row(&mut lines);
        if next.0 <= last.0 {
            break next;
        }
        last = next;
    };
    // The new program counts its ticks anew, and nobody has read the first ones.
    assert_eq!(first.0, first.1);
    running::signal(child.id(), Signal::INT);
    assert!(lines.all(|line| line.is_ok()));
    let output = child.wait_with_output().unwrap();
    let told = String::from_utf8(output.stderr).unwrap();
    for text in [
        "a:servo: the program was restarted",
        "a:servo: its rows go on",
    ] {
        assert!(told.contains(text), "{told}");
    }
    assert!(output.status.success());
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
}

#[test]
fn when_all_visitors_are_there_the_next_is_told_who_they_are() {
    let up = start();
    let open = || View::open(&up.directory(), 65536);
    let views: Vec<_> = VISITORS.map(|_| open().unwrap()).collect();
    let Err(ViewError::Full { holders }) = open() else {
        panic!("there was room for another");
    };
    let this = std::process::id();
    assert!(holders.iter().all(|(_, process)| *process == this));
    assert_eq!(holders.len(), VISITORS.count());
    let wrong = complaint(&up, &["ps"]);
    assert!(
        wrong.contains("too many programs look at the system"),
        "{wrong}"
    );
    assert!(wrong.contains(&format!("{this} (number 20)")), "{wrong}");
    drop(views);
    text(&up, &["ps"]);
}

#[test]
fn a_relative_runtime_directory_counts_as_missing() {
    let up = Up::start(TWO, &[]);
    let mut command = up.command(&["ps", "--system", "tested"]);
    command.current_dir(up.path("."));
    assert!(command.output().unwrap().status.success());
    // Each program would look in another directory.
    command.env("XDG_RUNTIME_DIR", ".");
    assert!(!command.output().unwrap().status.success());
}

#[test]
fn a_project_is_made_as_a_whole_or_not_at_all() {
    let place = tempfile::tempdir().unwrap();
    let template = place.path().join("condor/examples/two-processors");
    std::fs::create_dir_all(&template).unwrap();
    std::fs::write(template.join("Cargo.toml"), "name = \"two-processors\"\n").unwrap();
    let new = || {
        let mut new = Command::new(env!("CARGO_BIN_EXE_condor"));
        new.current_dir(place.path());
        new.args(["new", "mine", "--path", "condor"]);
        new.output().unwrap()
    };
    let there = || std::fs::read_dir(place.path()).unwrap().count();
    std::fs::write(template.join("wrong"), [0xff]).unwrap();
    assert!(!new().status.success());
    assert_eq!(there(), 1);
    std::fs::remove_file(template.join("wrong")).unwrap();
    assert!(new().status.success());
    let manifest = std::fs::read_to_string(place.path().join("mine/Cargo.toml")).unwrap();
    assert!(manifest.starts_with("name = \"mine\"\n"), "{manifest}");
    let again = String::from_utf8(new().stderr).unwrap();
    assert!(again.contains("`mine` exists already"), "{again}");
    assert_eq!(there(), 2);
}
