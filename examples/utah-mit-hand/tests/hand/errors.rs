//! Every error of the master's terminal, provoked: each has the user's name of the thing, and a remedy. The table is
//! the file `errors.md`.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use condor_hand::grasp::distributed::GraspSettings;
use condor_robot::RobotDescription;

use crate::clients::{control, open};
use crate::typist::{FIRST, MASTER, PLANT, TABLE, Typist, hand, run, run_with};
use crate::up::Up;

const ERRORS: &str = include_str!("errors.md");
/// The enumeration of the master's errors.
const PROBLEM: &str = include_str!("../../../../system/robot/src/master/words.rs");

const OTHER_ROBOT: &str = "of another robot";
const SUPERVISED: &str = "with a supervisor";
const FORBIDDEN: &str = "without leave to restart";
const NOT_TYPED: &str = "that nobody can type";

/// A scene: the state in which errors are provoked, and their rows.
struct Scene {
    state: &'static str,
    rows: Vec<Vec<&'static str>>,
}

fn scenes() -> Vec<Scene> {
    let sections = ERRORS.split("\n## ").skip(1);
    let scene = |section: &'static str| {
        let (state, table) = section.split_once('\n').unwrap();
        // Below the titles and the line under them.
        let lines = table.lines().filter(|line| line.starts_with("| ")).skip(1);
        let cells = |line: &'static str| line.trim_matches('|').split('|').map(str::trim).collect();
        let rows = lines.map(cells).collect();
        Scene { state, rows }
    };
    sections.map(scene).collect()
}

/// The rows of one state.
fn rows_of(state: &str) -> Vec<Vec<&'static str>> {
    let mut scenes = scenes().into_iter();
    scenes.find(|scene| scene.state == state).unwrap().rows
}

/// Brings the robot from one state into the next one; returns false if that is not a state of this robot.
fn prepare(typist: &mut Typist<'_>, state: &str) -> bool {
    match state {
        "at the beginning" => typist.begin(),
        "with wrong files" => {
            write_wrong_files(typist);
            typist.does("open wave");
        }
        "enabled" => {
            typist.does("enable");
            typist.wait(1.0);
            typist.runs("open");
        }
        "in another mode" => typist.does("mode index impedance"),
        "while a motion runs" => {
            typist.does("enable index");
            typist.does("to ring.middle 0.9 5");
        }
        "while the motion in memory waits" => typist.does("run"),
        "when the queue is full" => {
            for _ in 0..7 {
                typist.types("run wave");
            }
            typist.wait(0.3);
        }
        "when the recording is full" => fill_recording(typist),
        "in a grasp" => {
            typist.does("save");
            typist.runs("open");
            typist.runs("grasp");
            typist.does("ball");
            typist.does("grasp 150");
            typist.wait(2.0);
        }
        "with a grasp that no hand can hold" => typist.does("release"),
        "after a fault" => {
            typist.does("enable");
            typist.wait(1.0);
            typist.runs("open");
            typist.types("fault index.proximal-flexor drive");
            typist.expect("index has a fault: ", 5.0);
            typist.wait(4.0);
        }
        "when another program is in control" => {
            typist.does("clear");
            let session = open(typist);
            control(typist, session, true);
            typist.wait(0.1);
        }
        "when the ledger is cut" => {
            typist.does("control");
            typist.cut_file("motions.ledger", Some(100));
            typist.shown.clear();
            open(typist);
            typist.wait(0.3);
        }
        "when the ledger cannot be read" => {
            typist.cut_file("motions.ledger", Some(100));
            typist.restart(MASTER);
            typist.expect("motions.ledger: ", 5.0);
            typist.wait(1.0);
        }
        "without the table" => {
            typist.cut_file("motions.ledger", None);
            typist.ends(TABLE);
        }
        "without the simulation" => {
            typist.types("enable");
            typist.wait(4.0);
            typist.ends(PLANT);
        }
        "without a servo processor" => typist.ends(FIRST),
        "without motions" => std::fs::remove_dir_all(typist.files.join("motions")).unwrap(),
        OTHER_ROBOT | SUPERVISED | FORBIDDEN | NOT_TYPED => return false,
        other => panic!("{other:?} is not a state"),
    }
    true
}

/// A step of a motion, after its title.
const STEP: &str = "[[motion]]\nprofile = \"cubic\"\nduration = 0.01\n";

/// Writes files that the master cannot use.
fn write_wrong_files(typist: &Typist<'_>) {
    let file = |name: &str| typist.files.join(name);
    std::fs::create_dir(file("motions/wall.motion")).unwrap();
    std::fs::write(file("motions/wrong.motion"), "text").unwrap();
    std::fs::write(file("grasps/wrong.grasp"), "text").unwrap();
    let settings = GraspSettings::diagonal([1e300; 6], [1.0; 6]);
    let mut image = [0; GraspSettings::IMAGE_BYTES];
    settings.to_image(&mut image).unwrap();
    std::fs::write(file("grasps/hard.grasp"), image).unwrap();
    let far = format!("{STEP}[motion.by]\n\"ring.middle\" = 9.0\n");
    typist.writes("far", &far);
}

/// Records motions until there is no room for more.
fn fill_recording(typist: &mut Typist<'_>) {
    typist.does("abort");
    typist.does("record mine");
    let step = format!("{STEP}[motion.by]\n\"ring.middle\" = 0.0\n");
    typist.writes("long", &step.repeat(110));
    typist.runs("long");
    typist.shown.clear();
    typist.types("run long");
    typist.wait(0.3);
}

/// Types what a scene says; returns the answers that lack something.
fn provoke(typist: &mut Typist<'_>, rows: &[Vec<&str>]) -> String {
    let mut wrong = String::new();
    for row in rows {
        let [_, line, name, remedy] = row[..] else {
            panic!("{row:?}");
        };
        let mut answer = match line {
            "-" => std::mem::take(&mut typist.shown),
            line => typist.says(line),
        };
        if answer.is_empty() {
            // Until a finger has come to rest, or not.
            typist.wait(4.0);
            answer = std::mem::take(&mut typist.shown);
        }
        if !answer.contains(name) || !answer.contains(remedy) {
            writeln!(wrong, "{line}: {answer}lacks: {name} | {remedy}").unwrap();
        }
    }
    wrong
}

#[test]
fn every_error_names_the_thing_and_a_remedy() {
    let wrong = run(|typist| {
        let mut wrong = String::new();
        for Scene { state, rows } in scenes() {
            if prepare(typist, state) {
                wrong += &provoke(typist, &rows);
            }
        }
        wrong
    });
    assert!(wrong.is_empty(), "{wrong}");
}

#[test]
fn errors_of_another_robot_name_the_thing_and_a_remedy() {
    // It has no table, no tactile sensor and not all sensors of effort at the ring finger, and its joints rest past their
    // limits.
    let mut hand: RobotDescription = hand();
    hand.fingers[2].touch = None;
    let actuator = &mut hand.fingers[2].actuators[0];
    (actuator.adc, actuator.cutoff_hz) = (None, None);
    (actuator.faults, actuator.gains) = Default::default();
    hand.table = None;
    hand.processors.retain(|it| it.number != TABLE.0);
    hand.faults.overtravel_rad = 1e-5;
    hand.faults.sensor_samples = 1;
    let wrong = run_with(&hand, |typist| {
        typist.begin();
        typist.wait(1.0);
        let guard = "stop = { contact = true }\n[motion.by]\n\"ring.middle\" = 0.1\n";
        typist.writes("touch", &format!("{STEP}{guard}"));
        provoke(typist, &rows_of(OTHER_ROBOT))
    });
    assert!(wrong.is_empty(), "{wrong}");
}

#[test]
fn errors_of_the_supervisor_name_the_thing_and_a_remedy() {
    for (name, state) in [("errors", SUPERVISED), ("forbidden", FORBIDDEN)] {
        let mut up = Up::start(name, "max", |text| match state {
            FORBIDDEN => text.replace("may_ask = ", "# may_ask = "),
            _ => text,
        });
        for row in rows_of(state) {
            let [_, line, name, remedy] = row[..] else {
                panic!("{row:?}");
            };
            up.types(&line.replace(" / ", "\n"));
            up.expect(name);
            up.expect(remedy);
        }
    }
}

#[test]
fn the_table_has_every_error() {
    let (_, variants) = PROBLEM.split_once("enum Problem<'l> {\n").unwrap();
    let (variants, _) = variants.split_once("\n}\n").unwrap();
    let name = |line: &'static str| {
        let line = line.strip_prefix("    ")?;
        let end = line.find(|it: char| !it.is_alphanumeric())?;
        Some(&line[..end]).filter(|name| !name.is_empty())
    };
    let variants: BTreeSet<&str> = variants.lines().filter_map(name).collect();
    let rows = scenes().into_iter().flat_map(|scene| scene.rows);
    let known: BTreeSet<&str> = rows.map(|row| row[0]).filter(|it| *it != "-").collect();
    assert_eq!(known, variants);
}
