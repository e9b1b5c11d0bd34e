//! The motions that ship, as text and as bytes.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::mpsc;
use std::time::Duration;

use condor_hand::trajectory::Target;
use condor_hand::trajectory::image::MotionSequence;
use condor_robot::compile::{compile_motions, joint_names};
use condor_robot::{FINGERS, JOINTS, RobotDescription, grasp};

const HAND: &str = include_str!("../../../../condor-hand/hands/utah-mit.toml");
const ALL: usize = FINGERS * JOINTS;

fn hand() -> RobotDescription {
    RobotDescription::from_toml(HAND, "utah-mit.toml").unwrap()
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    let squares: f64 = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum();
    squares.sqrt()
}

#[test]
fn motions_that_ship_stay_out_of_the_stops_and_fingertips_meet() {
    let hand = hand();
    let out = tempfile::tempdir().unwrap();
    let motions = Path::new(env!("CARGO_MANIFEST_DIR")).join("motions");
    let names = compile_motions(&motions, out.path(), &hand).unwrap();
    assert_eq!(
        names,
        [
            "counting", "fist", "grasp", "open", "pinch", "touch", "tripod", "wave"
        ]
    );
    for name in names {
        let bytes = fs::read(out.path().join(format!("{name}.motion"))).unwrap();
        let motions = MotionSequence::<ALL>::new(ALL, &bytes).unwrap();
        assert!(!motions.is_empty());
        let mut last = [[0.0; JOINTS]; FINGERS];
        for motion in motions.iter() {
            for number in (0..ALL).filter(|number| motion.mask >> number & 1 == 1) {
                let (finger, joint) = (number / JOINTS, number % JOINTS);
                let entry = hand.joint(finger, joint).unwrap();
                let (low, high) = entry.rest_range();
                let at = &mut last[finger][joint];
                match motion.targets[number] {
                    Target::Absolute(to) => *at = to,
                    Target::Relative(by) => *at += by,
                }
                let vias = motion.vias.iter().map(|via| via.positions[number]);
                for position in vias.chain([*at]) {
                    assert!(
                        low <= position && position <= high,
                        "{name}: {position} of {finger}.{joint} is not in {low}..={high}"
                    );
                }
            }
        }
        let [index, middle, _, thumb] = grasp::tips(&hand, &last);
        match name.as_str() {
            "pinch" => assert!(distance(index, thumb) < 0.015),
            "tripod" => {
                assert!(distance(index, thumb) < 0.015);
                assert!(distance(middle, thumb) < 0.015);
                assert!(distance(index, middle) < 0.025);
            }
            _ => assert!(distance(index, thumb) > 0.02, "{name}"),
        }
    }
}

#[test]
fn what_is_wrong_is_said_with_its_file_and_line() {
    let hand = hand();
    let names = joint_names(&hand);
    assert_eq!((names.len(), names[0].as_str()), (ALL, "index.abduction"));
    let directory = tempfile::tempdir().unwrap();
    let out = directory.path().join("out");
    let text = "# A motion.\n[[motion]]\nprofile = \"cubic\"\nduration = 1.0\nto = { \"index.elbow\" = 1.0 }\n";
    let path = directory.path().join("bad.toml");
    fs::write(&path, text).unwrap();
    fs::write(directory.path().join("notes.txt"), "no motion").unwrap();
    let error = compile_motions(directory.path(), &out, &hand).unwrap_err();
    let expected = format!(
        "{}:5:8: no joint is called \"index.elbow\"; there are",
        path.display()
    );
    assert!(error.to_string().starts_with(&expected), "{error}");
    let good = text.replace("elbow", "middle");
    fs::write(&path, &good).unwrap();
    assert_eq!(
        compile_motions(directory.path(), &out, &hand).unwrap(),
        ["bad"]
    );
    // More than the master has room for.
    fs::write(&path, good.repeat(400)).unwrap();
    let error = compile_motions(directory.path(), &out, &hand).unwrap_err();
    let expected = format!(
        "{}: the compiled file (the image) does not fit into 8192 bytes; shorten its source file, or lengthen the buffer",
        path.display()
    );
    assert_eq!(error.to_string(), expected);
    let nowhere = directory.path().join("nowhere");
    let error = compile_motions(&nowhere, &out, &hand).unwrap_err();
    assert!(
        error
            .to_string()
            .starts_with(&format!("{}: ", nowhere.display())),
        "{error}"
    );
}

#[test]
fn a_fifo_among_the_motions_is_named_at_once() {
    let place = tempfile::tempdir().unwrap();
    let fifo = place.path().join("x.toml");
    let made = Command::new("mkfifo").arg(&fifo).status().unwrap();
    assert!(made.success());
    let (sender, receiver) = mpsc::channel();
    let motions = place.path().to_path_buf();
    // A read that waits for ever must not take the test with it.
    std::thread::spawn(move || {
        let out = motions.join("out");
        let error = compile_motions(&motions, &out, &hand()).unwrap_err();
        sender.send(error.to_string()).unwrap();
    });
    let told = receiver.recv_timeout(Duration::from_secs(60)).unwrap();
    let expected = format!("{}: it is a FIFO, not a regular file", fifo.display());
    assert_eq!(told, expected);
}
