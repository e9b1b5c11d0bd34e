//! The sentences of section 4.2 of the memo, (a) to (c), about the master: each is typed at its terminal, in
//! virtual time. `restarts.rs` has the one about errant programs.

use crate::typist::{MASTER, SECOND, Typist, run};

fn enabled(typist: &mut Typist<'_>) {
    typist.begin();
    typist.does("enable");
    typist.wait(1.0);
}

/// "(a) It forms the primary interface to the Sun-3, to load and save entire sequences of motions."
#[test]
fn a_it_loads_and_saves_entire_sequences_of_motions_in_files_of_the_host() {
    run(|typist| {
        enabled(typist);
        typist.does("record mine");
        typist.runs("open");
        typist.runs("tripod");
        typist.does("to index.middle 0.9 0.4");
        typist.wait(0.5);
        let saved = typist.says("save");
        assert_eq!(saved, "mine: 3 motions saved\n");
        assert!(!typist.file("motions/mine.motion").is_empty());
        let names = typist.says("motions");
        assert!(names.lines().any(|name| name == "mine"), "{names}");
        // The next incarnation of the program has nothing but the file.
        typist.restart(MASTER);
        typist.begin();
        let loaded = typist.says("open mine");
        assert_eq!(loaded, "mine: 3 motions; `run` runs what is in memory\n");
        typist.types("enable");
        typist.wait(4.0);
        typist.shown.clear();
        typist.types("run");
        typist.expect("mine is done\n", 20.0);
        typist.expect("mine: largest tracking error", 5.0);
        typist.wait(0.2);
        let middle = typist.truth().position[0][2];
        assert!((middle - 0.9).abs() < 0.02, "{middle} rad");
        assert_eq!(typist.says("save copy"), "copy: 3 motions saved\n");
        let (mine, copy) = ("motions/mine.motion", "motions/copy.motion");
        assert!(typist.file(mine) == typist.file(copy));
    });
}

/// The rows of the last table that was shown.
fn last_table(shown: &str) -> Vec<Vec<String>> {
    let (_, last) = shown.rsplit_once("joint  ").expect("a table is shown");
    let rows = last.lines().skip(1).map(|row| row.replace("\x1b[K", ""));
    rows.map(|row| row.split_whitespace().map(String::from).collect())
        .collect()
}

/// "(b) It provides a sophisticated user interface to the user, where a user can select a subset of joints
/// to monitor at any given moment."
#[test]
fn b_a_user_selects_a_subset_of_joints_to_monitor_at_any_given_moment() {
    run(|typist| {
        enabled(typist);
        typist.types("run open");
        typist.expect("open is done\n", 20.0);
        typist.shown.clear();
        typist.types("watch index thumb.distal");
        typist.wait(1.6);
        let shown = std::mem::take(&mut typist.shown);
        // Drawn again in its place, several times a second.
        let redrawn = shown.matches("\x1b[9A").count();
        assert!((3..=6).contains(&redrawn), "{redrawn}: {shown}");
        let table = last_table(&shown);
        let names: Vec<_> = table.iter().map(|row| row[0].as_str()).collect();
        let joints = ["abduction", "proximal", "middle", "distal"];
        let index = joints.map(|joint| format!("index.{joint}"));
        assert_eq!(names[..4], index);
        assert_eq!(names[4], "thumb.distal");
        // Over the actuators of that joint there are other titles.
        let actuators = ["actuator", "thumb.distal-flexor", "thumb.distal-extensor"];
        assert_eq!(names[5..], actuators);
        for row in &table[6..] {
            for column in &row[1..] {
                let effort: f64 = column.parse().unwrap();
                assert!((3.0..130.0).contains(&effort), "{row:?}");
            }
        }
        let truth = typist.truth();
        for (row, is) in table.iter().zip(truth.position[0]) {
            let [position, target, torque] =
                std::array::from_fn(|column| row[column + 1].parse::<f64>().unwrap());
            assert!((position - is).abs() < 0.02, "{row:?} {is}");
            assert!((target - is).abs() < 0.02, "{row:?} {is}");
            assert!(torque.abs() < 2.0, "{row:?}");
            assert_eq!(row[4], "position");
        }
        // Another choice ends it; what moves is seen to move.
        typist.types("watch ring.middle");
        typist.wait(0.6);
        let first: f64 = last_table(&typist.shown)[0][1].parse().unwrap();
        typist.types("to ring.middle 1.1 0.3");
        typist.types("watch");
        typist.shown.clear();
        typist.wait(1.2);
        let last = last_table(&typist.shown);
        let rows: Vec<_> = last.iter().map(|row| row[0].as_str()).collect();
        let actuators = ["actuator", "ring.middle-flexor", "ring.middle-extensor"];
        assert_eq!((rows[0], &rows[1..]), ("ring.middle", &actuators[..]));
        let last: f64 = last[0][1].parse().unwrap();
        assert!(
            (last - 1.1).abs() < 0.02 && (first - last).abs() > 0.1,
            "{first} {last}"
        );
        // What is said meanwhile stays, and the table goes on below it.
        typist.shown.clear();
        typist.restart(SECOND);
        typist.wait(1.0);
        let said = typist.shown.find("processor 2 is gone").unwrap();
        let below = &typist.shown[said..];
        let (between, _) = below.split_once("joint  ").unwrap();
        assert!(!between.contains("\x1b["), "{between:?}");
        assert!(below.contains(" gone") || below.contains(" off"), "{below}");
        // An empty line ends it.
        typist.types("");
        typist.wait(0.3);
        typist.shown.clear();
        typist.wait(1.0);
        assert_eq!(typist.shown, "");
        let said = typist.says("watch pinky");
        assert!(
            said.starts_with("error: word 2: no finger is called \"pinky\""),
            "{said}"
        );
    });
}

/// "The required controller variables can be tuned from this level, …"
#[test]
fn b_the_required_controller_variables_can_be_tuned_from_this_level() {
    run(|typist| {
        enabled(typist);
        let before = typist.says("gains index.proximal");
        assert!(
            before.contains("servo.zeta 1\n") || before.contains("servo.zeta 1 "),
            "{before}"
        );
        let other = typist.says("gains index.middle");
        typist.does("gains index.proximal servo.zeta 1.25 servo.bandwidth_hz 8");
        let after = typist.says("gains index.proximal");
        assert!(after.contains("servo.zeta 1.25"), "{after}");
        assert!(
            after.contains("servo.bandwidth_hz 8\n") || after.contains("servo.bandwidth_hz 8 "),
            "{after}"
        );
        assert_eq!(typist.says("gains index.middle"), other);
    });
}

/// "… and the status of the hand at any given moment can be ascertained."
#[test]
fn b_the_status_of_the_hand_at_any_given_moment_can_be_ascertained() {
    run(|typist| {
        enabled(typist);
        let status = typist.says("status");
        for finger in ["index", "middle", "ring", "thumb"] {
            let mut lines = status.lines();
            let row = lines.find(|line| line.starts_with(finger)).unwrap();
            assert!(row.contains("follows"), "{status}");
        }
        assert!(status.contains("no motion"), "{status}");
        assert!(status.contains("table: "), "{status}");
        typist.types("run wave");
        typist.wait(0.6);
        let moving = typist.says("status");
        assert!(moving.contains("motion wave runs: "), "{moving}");
        typist.types("fault ring.middle-flexor drive");
        typist.expect("ring has a fault: ", 5.0);
        let failed = typist.says("status");
        assert!(
            failed.contains("ring   fault") || failed.contains("ring   rests"),
            "{failed}"
        );
        assert!(failed.contains("ring has a fault: "), "{failed}");
    });
}

/// "(c) Controlling the execution of the servos on the slaves. Using the message passing system, it can
/// enable or disable servos on the other processors, …"
#[test]
fn c_it_can_enable_or_disable_servos_on_the_other_processors() {
    run(|typist| {
        typist.begin();
        // Of each of the two servo processors one finger.
        typist.does("enable middle");
        typist.does("enable thumb");
        let status = typist.says("status");
        for (finger, is, processor) in [
            ("index", "off", 1),
            ("middle", "follows", 1),
            ("ring", "off", 2),
            ("thumb", "follows", 2),
        ] {
            let row = format!("{finger:<6} {is:<10} {processor:>2}");
            assert!(status.contains(&row), "{status}");
        }
        typist.does("disable thumb");
        let status = typist.says("status");
        assert!(
            status.contains("thumb  off") && status.contains("middle follows"),
            "{status}"
        );
        typist.does("enable");
        assert_eq!(typist.says("status").matches(" follows ").count(), 4);
        typist.does("disable");
        assert_eq!(typist.says("status").matches(" off ").count(), 4);
    });
}

/// "… find out their status, …"
#[test]
fn c_it_can_find_out_their_status() {
    run(|typist| {
        enabled(typist);
        typist.restart(SECOND);
        typist.expect("processor 2 was restarted", 5.0);
        let status = typist.says("status");
        assert!(status.contains("ring   off"), "{status}");
        assert!(status.contains("thumb  off"), "{status}");
        assert!(status.contains("index  follows"), "{status}");
    });
}
