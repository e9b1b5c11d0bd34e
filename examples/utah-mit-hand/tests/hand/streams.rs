//! `utah-mit-hand motion --stream FILE`: a table of points from a shell moves a hand of processes.

use std::fmt::Write as _;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use condor_host::control::{ControlClient, ControlRequest};
use condor_host::view::View;
use condor_mbox::Processor;
use condor_robot::host::{self, QueueSession};
use condor_robot::master::DesiredPositions;
use condor_robot::objects;
use condor_robot::queue::{QueueAnswer, RefusalReason, RequestIdentity, RequestState};

use crate::up::{DEADLINE, Up};

const MASTER: Processor = Processor(0);
const PLANT: Processor = Processor(6);
/// The thumb, its middle joint, and the number of that in the hand.
const FINGER: usize = 3;
const JOINT: usize = 2;
const NUMBER: usize = 14;
/// The time between two points of a table, s.
const STEP_S: f64 = 0.1;

/// The system, whose hand is open, and what it shows.
fn open(name: &'static str) -> (Up, View) {
    // At the speed of the machine, points of a shell would come too late.
    let mut up = Up::start(name, "1", |text| text.replace("run wave", "run open"));
    up.expect("open is done\n");
    let mut view = View::open(&up.directory(), up.status().window_bytes).unwrap();
    view.join().unwrap();
    (up, view)
}

/// The target and velocity of the joint, and its position.
fn seen(view: &View) -> (f64, f64, f64) {
    let master = view.region(MASTER).unwrap();
    let wanted = objects::wanted(&master).unwrap().unwrap();
    let wanted: DesiredPositions = wanted.subscriber(&master).unwrap().read().unwrap().value;
    let plant = view.region(PLANT).unwrap();
    let truth = objects::truth(&plant).unwrap().unwrap();
    let truth = truth.subscriber(&plant).unwrap().read().unwrap().value;
    (
        wanted.position[FINGER][JOINT],
        wanted.velocity[FINGER][JOINT],
        truth.position[FINGER][JOINT],
    )
}

/// A command `motion` on that system.
fn motion(up: &Up, arguments: &[&str]) -> Child {
    Command::new(env!("CARGO_BIN_EXE_utah-mit-hand"))
        .arg("motion")
        .args(arguments)
        .env("XDG_RUNTIME_DIR", up.place())
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

/// What a command has written, and whether it was successful.
fn outcome(child: Child) -> (bool, String) {
    let output = child.wait_with_output().unwrap();
    let text = [output.stdout, output.stderr].concat();
    (output.status.success(), String::from_utf8(text).unwrap())
}

/// Writes a table of swings of 0.3 rad from a position on, and returns its path.
fn table(up: &Up, from: f64, points: u32) -> String {
    let mut text = format!("time,{NUMBER}\n");
    for index in 1..=points {
        let part = f64::from(index) / 10.0;
        let swing = 0.15 * (1.0 - (core::f64::consts::TAU * part).cos());
        writeln!(text, "{},{}", STEP_S * f64::from(index), from + swing).unwrap();
    }
    let path = up.place().join("points.csv");
    std::fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

/// Calls `work` again and again until it returns something.
fn until<T>(mut work: impl FnMut() -> Option<T>) -> T {
    let deadline = Instant::now() + DEADLINE;
    loop {
        if let Some(result) = work() {
            return result;
        }
        assert!(Instant::now() < deadline, "not within {DEADLINE:?}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

#[test]
fn points_of_a_table_move_the_joint_which_follows() {
    let (mut up, view) = open("streams");
    let (from, _, _) = seen(&view);
    let path = table(&up, from, 20);
    let mut child = motion(&up, &["--stream", &path]);
    let (mut farthest, mut error) = (from, 0.0_f64);
    until(|| {
        let (wanted, _, is) = seen(&view);
        farthest = farthest.max(wanted);
        error = error.max((is - wanted).abs());
        child.try_wait().unwrap()
    });
    assert_eq!(outcome(child), (true, "stream: done\n".to_owned()));
    println!("farthest {} rad, error {error} rad", farthest - from);
    assert!(
        (farthest - from - 0.3).abs() < 0.02,
        "{farthest} from {from}"
    );
    assert!(error < 0.1, "{error} rad");
    up.expect(".1 is done\n");
    let (wanted, velocity, is) = seen(&view);
    assert!(
        (wanted - from).abs() < 1e-9 && velocity == 0.0,
        "{wanted} {velocity}"
    );
    assert!((is - from).abs() < 0.02, "{is} for {from}");

    // What the joint cannot do is said, with the joint.
    let path = up.place().join("far.csv");
    std::fs::write(&path, format!("time,{NUMBER}\n0.5,7\n1,7\n")).unwrap();
    let (is_done, text) = outcome(motion(&up, &["--stream", path.to_str().unwrap()]));
    assert!(!is_done);
    let why = "the points from 0.5 s on: joint 14 at 0.5 s: the position, rad, is 7; it must be at most 1.658";
    assert!(text.contains(why), "{text}");
}

#[test]
fn a_hand_whose_points_stay_away_brakes_and_says_why() {
    let (mut up, view) = open("starved");
    let (from, _, _) = seen(&view);
    let path = table(&up, from, 1000);
    let mut child = motion(&up, &["--stream", &path]);
    until(|| (seen(&view).0 > from + 0.25).then_some(()));
    child.kill().unwrap();
    child.wait().unwrap();
    let gone = up.expect(" has ended: no program is in control\n");
    let (_, gone) = gone.rsplit_once("the program of session ").unwrap();
    let session: u32 = gone.split_once(' ').unwrap().0.parse().unwrap();
    up.expect(&format!(
        "stream {session}.1 was not completed: its points did not come in time; send them earlier\n"
    ));
    let (wanted, velocity, _) = seen(&view);
    assert_eq!(velocity.to_bits(), 0.0_f64.to_bits());
    let is = until(|| {
        let (now, _, is) = seen(&view);
        assert_eq!(now.to_bits(), wanted.to_bits(), "it moves");
        ((is - wanted).abs() < 0.02).then_some(is)
    });
    println!("at {is} rad, {} rad from where it began", is - from);
    let mut client = host::connect(&view, &up.status()).unwrap();
    let stream = RequestIdentity { session, number: 1 };
    let answer = client.look(stream, DEADLINE).unwrap().answer;
    assert_eq!(
        answer,
        QueueAnswer::Known(RequestState::Aborted, RefusalReason::Starved)
    );
    // Control is free, and the next motion begins where the joint is.
    let next = outcome(motion(&up, &["open"]));
    assert_eq!(next, (true, "open: done\n".to_owned()));
}

#[test]
fn a_stream_that_a_person_pauses_ends_and_the_next_motion_runs() {
    let (mut up, view) = open("paused-stream");
    let (from, _, _) = seen(&view);
    let path = table(&up, from, 1000);
    let child = motion(&up, &["--stream", &path]);
    until(|| (seen(&view).0 > from + 0.05).then_some(()));
    up.types("pause");
    up.expect("the stream of points ends: nobody can resume it\n");
    let (is_done, text) = outcome(child);
    assert!(!is_done, "{text}");
    let next = outcome(motion(&up, &["open"]));
    assert_eq!(next, (true, "open: done\n".to_owned()));
}

#[test]
fn a_motion_in_paused_time_says_why_it_waits() {
    let mut up = Up::start("paused-motion", "max", |text| {
        text.replace("run wave", "run open")
    });
    up.expect("open is done\n");
    let ask = |request| {
        let mut client = ControlClient::connect(&up.directory()).unwrap();
        client.ask(&request).unwrap();
    };
    ask(ControlRequest::Pause {});
    let mut child = motion(&up, &["--control", "pinch"]);
    let mut said = String::new();
    let mut stderr = BufReader::new(child.stderr.take().unwrap());
    stderr.read_line(&mut said).unwrap();
    assert!(said.contains("time is paused"), "{said}");
    assert!(said.contains("clock resume`"), "{said}");
    ask(ControlRequest::Resume {});
    let (is_done, text) = outcome(child);
    assert!(is_done, "{text}");
    assert_eq!(text, "pinch: done\n");
}

#[test]
fn a_session_that_gave_way_to_others_is_opened_again() {
    let (up, view) = open("sessions");
    let mut queue = host::connect(&view, &up.status()).unwrap();
    let mut session = QueueSession::default();
    let first = session.take_control(&mut queue, false, DEADLINE).unwrap();
    assert_eq!(first.number, 1);
    let answer = host::offer(&mut queue, first, b"open", DEADLINE).unwrap();
    assert_eq!(answer.reason(), None, "{answer}");
    until(|| {
        let seen = queue.look(first, DEADLINE).unwrap();
        seen.answer.is_final().then_some(())
    });
    let second = session.take_control(&mut queue, false, DEADLINE).unwrap();
    assert_eq!((second.session, second.number), (first.session, 2));
    queue.give_up_control(second.session, DEADLINE).unwrap();
    // So many that no place is left.
    for _ in 0..32 {
        queue.open(DEADLINE).unwrap();
    }
    let other = session.take_control(&mut queue, false, DEADLINE).unwrap();
    assert!(other.session > first.session, "{other:?}");
    assert_eq!(other.number, 1);
    let answer = host::offer(&mut queue, other, b"open", DEADLINE).unwrap();
    assert!(matches!(answer, QueueAnswer::Known(..)), "{answer}");
    session.abort(&mut queue, false, DEADLINE).unwrap();
    let seen = until(|| {
        let seen = queue.look(other, DEADLINE).unwrap();
        seen.answer.is_final().then_some(seen.answer)
    });
    assert!(
        matches!(
            seen,
            QueueAnswer::Known(RequestState::Aborted | RequestState::Done, _)
        ),
        "{seen}"
    );
}
