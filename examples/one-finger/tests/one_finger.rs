//! A finger of three joints is a robot: it is enabled, moves, is asked for motions, and is simulated without processors.

use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

const PACKAGE: &str = env!("CARGO_MANIFEST_DIR");
/// The time that a system may take to come up, on a machine that has much else to do.
const PATIENCE: Duration = Duration::from_secs(120);

/// The program, with a directory of its own for what runs.
fn condor(place: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_one-finger"));
    command
        .args(arguments)
        .env("XDG_RUNTIME_DIR", place)
        .stdin(Stdio::null());
    command
}

fn text(output: &Output) -> String {
    let both = [&output.stdout[..], &output.stderr[..]].concat();
    String::from_utf8_lossy(&both).into_owned()
}

/// A copy of the package's description, with files of its own.
fn package(place: &Path) {
    for file in ["finger.toml", "system.toml", "motions/beckon.toml"] {
        let to = place.join(file);
        std::fs::create_dir_all(to.parent().unwrap()).unwrap();
        std::fs::copy(Path::new(PACKAGE).join(file), to).unwrap();
    }
}

/// A system that is up, and does not outlive its test.
struct Up(Child);

impl Up {
    /// Brings up the copied package in a directory of its own, which it returns, too.
    fn start() -> (tempfile::TempDir, Self) {
        let place = tempfile::tempdir().unwrap();
        package(place.path());
        let system = place.path().join("system.toml").display().to_string();
        let up = ["up", &system, "--headless", "--for", "10m"];
        let up = condor(place.path(), &up).stdout(Stdio::null()).spawn();
        (place, Self(up.unwrap()))
    }
}

impl Drop for Up {
    fn drop(&mut self) {
        // One that has ended is not there any more.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn it_moves_alike_in_each_run() {
    let run = || {
        let place = tempfile::tempdir().unwrap();
        package(place.path());
        let system = place.path().join("system.toml").display().to_string();
        let up = ["up", &system, "--headless", "--for", "5s", "--speed", "max"];
        let output = condor(place.path(), &up).output().unwrap();
        let text = text(&output);
        assert!(output.status.success(), "{text}");
        assert!(text.contains("beckon is done"), "{text}");
        assert!(
            !text.contains("has a fault") && !text.contains("no joint"),
            "{text}"
        );
        let hash = text.lines().find(|line| line.contains(": hash "));
        hash.unwrap_or_else(|| panic!("no hash: {text}")).to_owned()
    };
    assert_eq!(run(), run());
}

#[test]
fn its_variables_are_recorded_and_its_queue_takes_motions() {
    let (place, up) = Up::start();
    let file = place.path().join("run.mcap").display().to_string();
    let begun = Instant::now();
    loop {
        let record = ["record", &file, "--for", "1s"];
        let recorded = condor(place.path(), &record).output().unwrap();
        if recorded.status.success() {
            break;
        }
        assert!(begun.elapsed() < PATIENCE, "{}", text(&recorded));
    }
    // Until the finger is enabled, the master refuses it.
    loop {
        let motion = condor(place.path(), &["motion", "beckon"])
            .output()
            .unwrap();
        if motion.status.success() {
            assert!(text(&motion).contains("beckon: done"), "{}", text(&motion));
            break;
        }
        assert!(begun.elapsed() < PATIENCE, "{}", text(&motion));
    }
    let down = condor(place.path(), &["down"]).output().unwrap();
    assert!(down.status.success(), "{}", text(&down));
    let csv = place.path().join("run.csv");
    let export = ["export", &file, "--csv", &csv.display().to_string()];
    let exported = condor(place.path(), &export).output().unwrap();
    assert!(exported.status.success(), "{}", text(&exported));
    let table = std::fs::read_to_string(csv).unwrap();
    assert!(
        table
            .lines()
            .next()
            .unwrap()
            .contains("finger.curl.position")
    );
    drop(up);
}

#[test]
fn a_threshold_that_is_lowered_makes_its_fault_and_is_found_in_the_description() {
    let (place, up) = Up::start();
    let begun = Instant::now();
    let until = |arguments: &[&str], is_there: &dyn Fn(&Output) -> bool| loop {
        let output = condor(place.path(), arguments).output().unwrap();
        if is_there(&output) {
            return text(&output);
        }
        assert!(
            begun.elapsed() < PATIENCE,
            "{arguments:?}: {}",
            text(&output)
        );
    };
    let ends_with = |code| move |output: &Output| output.status.code() == Some(code);
    // Until the finger is enabled, the master refuses it.
    until(&["motion", "beckon"], &ends_with(0));
    until(&["vars", "diff"], &ends_with(0));
    let saved = place.path().join("saved.toml").display().to_string();
    until(&["vars", "save", &saved], &ends_with(0));

    for (name, value) in [
        ("faults.tracking_samples", "1"),
        ("faults.tracking_rad", "0.001"),
        ("finger.bend.servo.velocity_cutoff_hz", "120"),
        ("finger.bend.limits.velocity", "3"),
    ] {
        until(&["vars", "set", name, value], &ends_with(0));
    }
    // The check of the description is that of the parameter, too.
    let refused = until(
        &["vars", "set", "finger.bend.limits.low", "-0.4"],
        &ends_with(1),
    );
    assert!(refused.contains("must be from -0.3 to "), "{refused}");
    let table = until(&["vars", "diff"], &ends_with(1));
    for (name, key, line) in [
        ("faults.tracking_rad", "faults.tracking_rad", "tracking_rad"),
        (
            "finger.bend.servo.velocity_cutoff_hz",
            "fingers[0].joints[1].servo.velocity_cutoff_hz",
            "servo = ",
        ),
        (
            "finger.bend.limits.velocity",
            "fingers[0].joints[1].limits.velocity",
            "limits = ",
        ),
    ] {
        let row = table.lines().find(|row| row.contains(name));
        let row = row.unwrap_or_else(|| panic!("no {name}: {table}"));
        assert!(row.ends_with(key), "{row}");
        let file = row.split_whitespace().nth_back(1).unwrap();
        let (file, number) = file.rsplit_once(':').unwrap();
        let text = std::fs::read_to_string(file).unwrap();
        let number: usize = number.parse().unwrap();
        assert!(
            text.lines().nth(number - 1).unwrap().starts_with(line),
            "{row}"
        );
    }

    let fault = |output: &Output| text(output).contains("tracking");
    condor(place.path(), &["motion", "beckon"])
        .output()
        .unwrap();
    until(&["vars", "get", "finger.fault"], &fault);
    let loaded = until(&["vars", "load", &saved], &ends_with(0));
    assert!(
        loaded.contains("faults.tracking_rad: 0.001 -> 0.35 rad"),
        "{loaded}"
    );
    until(&["vars", "diff"], &ends_with(0));
    until(&["vars", "diff", &saved], &ends_with(0));
    drop(up);
}

#[test]
fn its_motion_is_checked_without_processors() {
    let place = tempfile::tempdir().unwrap();
    let file = |name: &str| Path::new(PACKAGE).join(name).display().to_string();
    let (finger, motion) = (file("finger.toml"), file("motions/beckon.toml"));
    let output = condor(place.path(), &["sim", &finger, "--check", &motion]).output();
    let output = output.unwrap();
    assert!(output.status.success(), "{}", text(&output));
}

#[test]
fn a_robot_with_more_than_its_programs_have_room_for_is_refused_with_the_number() {
    let place = tempfile::tempdir().unwrap();
    package(place.path());
    let finger = place.path().join("finger.toml");
    let description = std::fs::read_to_string(&finger).unwrap();
    let (head, curl) = description
        .split_once("[[fingers.joints]]\nname = \"curl\"")
        .unwrap();
    let joint = |name: &str| format!("[[fingers.joints]]\nname = \"{name}\"{curl}\n");
    let joints = ["a", "b", "c"].map(joint).concat();
    std::fs::write(&finger, format!("{head}{joints}")).unwrap();
    let system = place.path().join("system.toml").display().to_string();
    let output = condor(place.path(), &["check", &system]).output().unwrap();
    assert!(!output.status.success());
    let text = text(&output);
    assert!(text.contains("room for 4"), "{text}");
}
