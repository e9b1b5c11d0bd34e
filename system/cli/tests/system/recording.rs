//! Recordings of a system of two joints: whole ones, and what is left when the recorder is killed.

use std::io::{Read, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use condor_cli::recording::{RecordingError, RecordingReader};
use condor_host::control::MemberState;
use condor_vars::AnyValue;
use rustix::process::Signal;

use crate::disk;
use crate::joint::{load_joint, start, start_one};
use crate::running::{self, DEADLINE, Up, kill, signal, wait_for_end};

/// A recorder of a system.
struct Recorder<'u> {
    up: &'u Up,
    file: &'u str,
    child: Child,
}

impl<'u> Recorder<'u> {
    fn start(up: &'u Up, file: &'u str, names: &[&str]) -> Self {
        let path = up.path(file);
        let mut command: Command = up.command(&["record"]);
        command.arg(path).args(names).stderr(Stdio::piped());
        let child = command.spawn().unwrap();
        Self { up, file, child }
    }

    /// How many messages were taken, all channels together.
    fn taken(&self) -> u64 {
        taken(&self.up.path(self.file)).iter().sum()
    }

    fn wait_until_taken(&mut self, count: u64) {
        self.wait_until(|this| this.taken() >= count);
    }

    /// Waits until so many rows of the second loop were taken, whose channel follows those of events and of the first.
    fn wait_until_taken_of_b(&mut self, count: u64) {
        self.wait_until(|this| {
            let counts = taken(&this.up.path(this.file));
            counts.get(3).is_some_and(|it| *it >= count)
        });
    }

    fn wait_until(&mut self, happened: impl Fn(&Self) -> bool) {
        let begun = Instant::now();
        while !happened(self) {
            assert!(begun.elapsed() < DEADLINE, "{} were taken", self.taken());
            if self.child.try_wait().unwrap().is_some() {
                let mut told = String::new();
                let mut stderr = self.child.stderr.take().unwrap();
                stderr.read_to_string(&mut told).unwrap();
                panic!("it has ended: {told}");
            }
            std::thread::yield_now();
        }
    }

    /// As ^C does; returns what was told at the end.
    fn end(self) -> String {
        signal(self.child.id(), Signal::INT);
        let output = self.child.wait_with_output().unwrap();
        let told = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success(), "{told}");
        told
    }

    fn kill(mut self) {
        kill(self.child.id());
        self.child.wait().unwrap();
    }
}

/// The counts beside a recording, by channel.
fn taken(file: &Path) -> Vec<u64> {
    let path = format!("{}.taken", file.display());
    let bytes = std::fs::read(path).unwrap_or_default();
    let counts = bytes.get(16..).unwrap_or_default().chunks_exact(8);
    counts
        .map(|count| u64::from_le_bytes(count.try_into().unwrap()))
        .collect()
}

/// A row: its time, tick, number of lost rows before, and values.
type Row = (u64, u64, u64, Vec<AnyValue>);

/// The rows of a loop of a recording.
fn rows(reader: &RecordingReader, processor: &str, owner: &str) -> Vec<Row> {
    let mut sources = reader.sources().iter();
    let source = sources.position(|it| (&*it.processor, &*it.owner) == (processor, owner));
    let source = source.unwrap_or_else(|| panic!("no {processor}:{owner}"));
    let fields = reader.sources()[source].layout.fields().len();
    let mut rows = Vec::new();
    let read = reader.rows(&[source], reader.span(), |_, at_ns, row| {
        let values = (0..fields).map(|field| row.value(field).unwrap()).collect();
        let head = row.head();
        rows.push((at_ns, head.tick, head.lost, values));
        Ok::<_, RecordingError>(())
    });
    read.unwrap();
    rows
}

/// Every row that was not lost is there, with the values that the loop has at that tick.
fn check(rows: &[Row]) {
    for (_, tick, _, values) in rows {
        #[expect(clippy::cast_precision_loss, reason = "there are few ticks")]
        let expected = [AnyValue::F64(0.5 * *tick as f64), AnyValue::Uint(*tick)];
        assert_eq!(values[..], expected);
    }
    for pair in rows.windows(2) {
        let ((before_ns, before, ..), (at_ns, tick, lost, _)) = (&pair[0], &pair[1]);
        assert_eq!(*tick, before + 1 + lost);
        assert!(at_ns > before_ns);
    }
}

const NAMES: [&str; 2] = ["*:joint.position", "*:ticks"];

fn event(reader: &RecordingReader, name: &str, text: &str) {
    let events = reader.events(reader.span()).unwrap();
    let is_it = |log: &condor_ros2::Log| log.name == name && log.text.contains(text);
    let found = events.iter().any(|(_, log)| is_it(log));
    assert!(found, "no {name}: {text} in {events:#?}");
}

#[test]
fn rows_and_events_are_recorded() {
    let up = start(&[]);
    let mut recorder = Recorder::start(&up, "run.mcap", &NAMES);
    recorder.wait_until_taken(50);
    let mut terminal = up.terminal("a");
    terminal.write_all(b"to the recorder\r").unwrap();
    running::read_until(&mut terminal, "typed to the recorder");
    up.run(&["send", "a", "add", "1"]);
    let events = up.events();
    kill(up.status().processors[1].pid.unwrap());
    running::wait(events, "b", MemberState::Running);
    // More rows of it come.
    let so_far = recorder.taken();
    recorder.wait_until_taken(so_far + 300);
    let told = recorder.end();
    assert!(told.contains("/a/servo: "), "{told}");
    let reader = RecordingReader::open(&up.path("run.mcap")).unwrap();
    assert_eq!(reader.sources().len(), 2);
    check(&rows(&reader, "a", "servo"));
    let of_b = rows(&reader, "b", "servo");
    let again = of_b.windows(2).position(|pair| pair[1].1 <= pair[0].1);
    let (before, after) = of_b.split_at(again.unwrap() + 1);
    check(before);
    check(after);
    event(&reader, "a", "typed: to the recorder");
    event(&reader, "a", "messages to vector 5 (add): 1 handled");
    event(&reader, "b", "killed by SIGKILL");
    event(&reader, "record", "b:servo: its rows go on");
    assert!(!up.path("run.mcap.taken").exists());
    // The description is attached.
    let file = std::fs::read(up.path("run.mcap")).unwrap();
    let summary = mcap::Summary::read(&file).unwrap().unwrap();
    let attached = summary.attachment_indexes.iter();
    let attached: Vec<_> = attached.map(|it| it.name.clone()).collect();
    let status = up.status();
    let description = Path::new(&status.file).file_name().unwrap();
    assert_eq!(attached, [description.to_str().unwrap()]);
}

#[test]
fn a_stopped_program_is_recorded_when_it_starts() {
    let up = start(&[]);
    up.run(&["stop", "b"]);
    let mut recorder = Recorder::start(&up, "run.mcap", &NAMES);
    recorder.wait_until_taken(50);
    up.run(&["start", "b"]);
    recorder.wait_until_taken_of_b(50);
    let told = recorder.end();
    let text = "b:servo: processor 1 is not connected: its program has not joined the system, or has just begun; its rows begin when its program answers";
    assert!(told.contains(text), "{told}");
    let reader = RecordingReader::open(&up.path("run.mcap")).unwrap();
    check(&rows(&reader, "a", "servo"));
    check(&rows(&reader, "b", "servo"));
    event(&reader, "record", "b:servo: its rows begin");
}

#[test]
fn a_program_that_is_loaded_later_is_recorded() {
    let up = start_one();
    let mut recorder = Recorder::start(&up, "run.mcap", &NAMES);
    recorder.wait_until_taken(50);
    load_joint(&up);
    recorder.wait_until_taken_of_b(50);
    let told = recorder.end();
    assert!(told.contains("/b/servo: "), "{told}");
    let reader = RecordingReader::open(&up.path("run.mcap")).unwrap();
    check(&rows(&reader, "a", "servo"));
    check(&rows(&reader, "b", "servo"));
    event(&reader, "record", "b:servo: its rows begin");
}

#[test]
fn what_is_sampled_is_not_lost() {
    // So a cell has many values between two looks at it.
    let up = start(&["--clock", "simulated", "--speed", "20"]);
    let path = up.path("run.mcap");
    let arguments = ["a:contact.*", "--for", "20s", "--json"];
    let output = up.run(&[&["record", path.to_str().unwrap()], &arguments[..]].concat());
    let told: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let topics = told["topics"].as_array().unwrap();
    let contact = topics.iter().find(|it| it["topic"] == "/a/contact");
    let contact = contact.unwrap();
    assert_eq!(contact["lost"], 0, "{told}");
    assert!(contact["skipped"].as_u64().unwrap() > 0, "{told}");
    let reader = RecordingReader::open(&path).unwrap();
    let rows = rows(&reader, "a", "contact");
    assert!(rows.iter().all(|(.., lost, _)| *lost == 0), "{rows:?}");
}

#[test]
fn all_variables_and_cells_are_recorded_by_default() {
    let up = start(&[]);
    let mut recorder = Recorder::start(&up, "run.mcap", &[]);
    recorder.wait_until_taken(100);
    recorder.end();
    let reader = RecordingReader::open(&up.path("run.mcap")).unwrap();
    let names = reader.columns(&[]).unwrap();
    assert_eq!(names.len(), 18);
    let mode = reader.columns(&["a:mode".into()]).unwrap();
    assert_eq!(mode[0].variable.labels, ["idle", "hold", "fault"]);
    let contact = rows(&reader, "b", "contact");
    assert_eq!(contact[0].3, [AnyValue::F32(1.5), AnyValue::Uint(3)]);
}

#[test]
fn a_recording_is_exported() {
    let up = start(&[]);
    let mut recorder = Recorder::start(&up, "run.mcap", &["a:*"]);
    recorder.wait_until_taken(100);
    recorder.end();
    let path = |name: &str| up.path(name).to_str().unwrap().to_owned();
    let (file, csv, svg) = (path("run.mcap"), path("run.csv"), path("run.svg"));
    up.run(&["export", &file, "a:mode", "ticks", "beats", "--csv", &csv]);
    let reader = RecordingReader::open(&up.path("run.mcap")).unwrap();
    let mut expected = vec!["time_ns,loop,tick,lost,mode,ticks,beats".to_owned()];
    let mut all = Vec::new();
    let mode = reader.columns(&["mode".into()]).unwrap()[0].field;
    let ticks = reader.columns(&["ticks".into()]).unwrap()[0].field;
    for (at_ns, tick, lost, values) in rows(&reader, "a", "servo") {
        assert_eq!(values[mode], AnyValue::Choice(0));
        let ticks = values[ticks];
        all.push((
            at_ns,
            format!("{at_ns},a:servo,{tick},{lost},idle,{ticks},"),
        ));
    }
    for (at_ns, tick, lost, values) in rows(&reader, "a", "slow") {
        let beats = values[0];
        all.push((at_ns, format!("{at_ns},a:slow,{tick},{lost},,,{beats}")));
    }
    all.sort();
    expected.extend(all.into_iter().map(|(_, line)| line));
    let text = up.file("run.csv");
    let mut lines: Vec<_> = text.lines().collect();
    // Rows of the same instant may come in any order.
    lines[1..].sort_unstable();
    assert_eq!(lines, expected);
    let half = ["--from", "0s", "--to", "200ms"];
    up.run(&[&["export", &file, "a:ticks", "--svg", &svg], &half[..]].concat());
    let text = up.file("run.svg");
    assert!(text.starts_with("<svg ") && text.contains("<polyline class=\"curve c0\""));
}

#[test]
fn simulated_time_is_exact() {
    let up = start(&["--clock", "simulated"]);
    let now_ns = || {
        let seconds = up.status().clock.unwrap().seconds;
        u64::try_from(Duration::from_secs_f64(seconds).as_nanos()).unwrap()
    };
    let before_ns = now_ns();
    let names = [NAMES[0], NAMES[1], "a:contact.*"];
    let mut recorder = Recorder::start(&up, "run.mcap", &names);
    recorder.wait_until_taken(100);
    recorder.end();
    // While a recorder does not get its turn, simulated time goes on: it may be far from that of the last row.
    let during = before_ns..=now_ns();
    let reader = RecordingReader::open(&up.path("run.mcap")).unwrap();
    assert_eq!(reader.about()["clock"], "simulated");
    let ahead_ns: u64 = reader.about()["ahead_ns"].parse().unwrap();
    let instants = |owner| {
        let rows = rows(&reader, "a", owner).into_iter();
        let instants = rows.map(|(at_ns, ..)| at_ns.wrapping_sub(ahead_ns));
        instants.collect::<Vec<_>>()
    };
    // Cells have the time at which they are looked at: that of the same clock.
    let (servo, contact) = (instants("servo"), instants("contact"));
    assert!(
        servo
            .iter()
            .all(|ns| ns % 10_000_000 == servo[0] % 10_000_000)
    );
    assert!(contact.iter().all(|ns| during.contains(ns)), "{contact:?}");
    let rows = rows(&reader, "a", "servo");
    check(&rows);
    for pair in rows.windows(2) {
        let ((before_ns, before, ..), (at_ns, tick, ..)) = (&pair[0], &pair[1]);
        assert_eq!(at_ns - before_ns, 10_000_000 * (tick - before));
    }
}

#[test]
fn a_recorder_that_is_killed_loses_what_is_counted() {
    let up = start(&[]);
    let kills = std::env::var("CONDOR_KILLS").map_or(20, |text| text.parse().unwrap());
    let (mut random, mut counts) = (1_u64, Vec::new());
    for number in 0..kills {
        // Of the period of chunks, and less.
        random = random
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        let mut recorder = Recorder::start(&up, "run.mcap", &NAMES);
        // The counts of the former one are there until it is complete.
        let former = up.path(&format!("run.{number}.mcap"));
        recorder.wait_until(|_| number == 0 || former.exists());
        recorder.wait_until_taken(1 + (random >> 33) % 250);
        recorder.kill();
        counts.push(taken(&up.path("run.mcap")));
    }
    up.run(&["record", "--finish", up.path("run.mcap").to_str().unwrap()]);
    let mut dropped = 0;
    for (number, counts) in (1..).zip(&counts) {
        let name = if number == kills {
            "run.mcap".to_owned()
        } else {
            format!("run.{number}.mcap")
        };
        let reader = RecordingReader::open(&up.path(&name)).unwrap();
        // The first channel is that of events.
        for (place, source) in reader.sources().iter().enumerate() {
            let taken = counts.get(2 + place).copied().unwrap_or(0);
            assert_eq!(source.rows + source.dropped.unwrap(), taken, "{name}");
            dropped += source.dropped.unwrap();
            let rows = rows(&reader, &source.processor, &source.owner);
            assert_eq!(rows.len() as u64, source.rows);
            check(&rows);
        }
    }
    assert!(dropped > 0, "each was killed just after a chunk");
}

#[test]
fn lengths_that_the_file_does_not_have_take_no_memory() {
    let up = start(&[]);
    let mut recorder = Recorder::start(&up, "run.mcap", &NAMES);
    recorder.wait_until_taken(50);
    recorder.end();
    let (file, csv) = (up.path("run.mcap"), up.path("run.csv"));
    let whole = std::fs::read(&file).unwrap();
    let limited = |arguments: &[&str]| {
        let condor = up.command(arguments);
        let mut sh = Command::new("sh");
        // In KiB.
        sh.args(["-c", "ulimit -v 1500000; exec \"$0\" \"$@\""]);
        sh.arg(condor.get_program()).args(condor.get_args());
        sh.envs((condor.get_envs()).filter_map(|(name, value)| Some((name, value?))));
        sh.output().unwrap()
    };
    let topic = b"/a/servo";
    let places = (0..whole.len()).filter(|place| whole[*place..].starts_with(topic));
    let places: Vec<_> = places.collect();
    // In a chunk, in the metadata, and in the summary.
    assert!(places.len() >= 3, "{places:?}");
    for place in places {
        let mut damaged = whole.clone();
        // The highest byte of the length before it.
        damaged[place - 1] = 0x80;
        std::fs::write(&file, &damaged).unwrap();
        let name = file.to_str().unwrap();
        let output = limited(&["export", name, "--csv", csv.to_str().unwrap()]);
        let told = String::from_utf8_lossy(&output.stderr);
        assert!(
            output.status.code().is_some_and(|code| code <= 1),
            "{place}: {told}"
        );
        let output = limited(&["record", "--finish", name]);
        let told = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{place}: {told}");
        let reader = RecordingReader::open(&file).unwrap();
        assert!(rows(&reader, "b", "servo").len() > 10, "{place}");
    }
}

#[test]
fn a_full_disk_ends_a_recording_that_is_complete() {
    let up = start(&[]);
    let script = "\"$0\" record DISK/run.mcap && exit 9; cp DISK/run.mcap DISK/..; ls DISK";
    let Some(output) = disk::with(&up, "160k", script) else {
        return;
    };
    let told = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{told}");
    assert!(told.contains("there is no room for more"), "{told}");
    assert!(told.contains(" dropped, "), "{told}");
    assert_eq!(String::from_utf8_lossy(&output.stdout), "run.mcap\n");
    let reader = RecordingReader::open(&up.path("run.mcap")).unwrap();
    // On a loaded machine it may be a row of any loop that has no room.
    let dropped = reader.sources().iter().filter_map(|it| it.dropped);
    assert!(dropped.sum::<u64>() > 0, "{told}");
    assert!(rows(&reader, "a", "servo").len() > 50, "{told}");
}

#[test]
fn what_cannot_be_recorded_is_told() {
    let up = start(&[]);
    let complaint = |arguments: &[&str]| {
        let output = up.command(arguments).output().unwrap();
        assert!(!output.status.success(), "{arguments:?}");
        String::from_utf8(output.stderr).unwrap()
    };
    let mut recorder = Recorder::start(&up, "other.mcap", &NAMES);
    recorder.wait_until_taken(1);
    let other = up.path("other.mcap");
    let told = complaint(&["record", other.to_str().unwrap()]);
    assert!(told.contains("is being recorded"), "{told}");
    // Without a description there is no robot.
    std::fs::write(up.status().file, "").unwrap();
    let file = up.path("without.mcap");
    let output = up.run(&["record", file.to_str().unwrap(), "--for", "10ms"]);
    let told = String::from_utf8(output.stderr).unwrap();
    assert!(told.contains("lack joints, frames"), "{told}");
    // It ends with the system.
    up.run(&["down"]);
    wait_for_end(recorder.child.id());
    let output = recorder.child.wait_with_output().unwrap();
    assert!(output.status.success());
    check(&rows(&RecordingReader::open(&other).unwrap(), "a", "servo"));
}
