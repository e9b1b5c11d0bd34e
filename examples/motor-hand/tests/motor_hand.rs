//! A hand with a motor at each joint moves, is recorded, names what is broken, and has no tendons.

use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

const PACKAGE: &str = env!("CARGO_MANIFEST_DIR");
const MOTIONS: [&str; 5] = ["wave", "pinch", "fist", "count", "open"];
/// The time that a system may take to come up, on a machine that has much else to do.
const PATIENCE: Duration = Duration::from_secs(120);

/// The program, with a directory of its own for what runs.
fn condor(place: &Path, arguments: &[&str]) -> Output {
    command(place, arguments).output().unwrap()
}

fn command(place: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_motor-hand"));
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

/// A copy of the package's description, with files of its own, of which the master is typed these lines.
fn package(place: &Path, typed: &[&str]) -> String {
    let motions = MOTIONS.map(|motion| format!("motions/{motion}.toml"));
    for file in ["hand.toml", "system.toml"]
        .into_iter()
        .chain(motions.iter().map(String::as_str))
    {
        let to = place.join(file);
        std::fs::create_dir_all(to.parent().unwrap()).unwrap();
        std::fs::copy(Path::new(PACKAGE).join(file), to).unwrap();
    }
    let system = place.join("system.toml");
    let description = std::fs::read_to_string(&system).unwrap();
    let (head, _) = description.split_once("headless = ").unwrap();
    std::fs::write(&system, format!("{head}headless = {typed:?}\n")).unwrap();
    system.display().to_string()
}

/// Runs the hand for some simulated time, and returns what it has shown.
fn run(typed: &[&str], time: &str) -> String {
    let place = tempfile::tempdir().unwrap();
    let system = package(place.path(), typed);
    let up = ["up", &system, "--headless", "--for", time, "--speed", "max"];
    let output = condor(place.path(), &up);
    let text = text(&output);
    assert!(output.status.success(), "{text}");
    for word in ["tendon", "tension", "flexor", "slack"] {
        assert!(!text.contains(word), "{word}: {text}");
    }
    text
}

#[test]
fn it_makes_all_motions_without_faults_and_alike_in_each_run() {
    let typed = ["enable", "run pinch", "run fist"];
    let hash = |time| {
        let text = run(&typed, time);
        let hash = text.lines().find(|line| line.contains(": hash "));
        hash.unwrap_or_else(|| panic!("no hash: {text}")).to_owned()
    };
    assert_eq!(hash("4s"), hash("4s"));

    let motions = MOTIONS.map(|motion| format!("run {motion}"));
    let mut typed = vec!["enable"];
    typed.extend(motions.iter().map(String::as_str));
    let text = run(&typed, "20s");
    for motion in MOTIONS {
        assert!(text.contains(&format!("{motion} is done")), "{text}");
    }
    assert!(!text.contains("has a fault"), "{text}");
}

#[test]
fn what_is_broken_is_named_and_the_other_fingers_go_on_holding() {
    for (broken, named) in [
        (
            "fault index.middle position",
            "index has a fault: index.middle is stuck",
        ),
        (
            "fault thumb.proximal-motor drive",
            "thumb has a fault: thumb.proximal is ",
        ),
        (
            "fault ring.spread-motor drive",
            "ring has a fault: ring.spread is ",
        ),
    ] {
        let text = run(&["enable", "run wave", broken], "4s");
        assert!(text.contains(named), "{text}");
        assert_eq!(text.matches("has a fault").count(), 1, "{text}");
        assert!(text.contains("all motion stops"), "{text}");
    }
    let text = run(&["enable", "fault index.middle-motor effort"], "1s");
    assert!(
        text.contains("index.middle-motor has no sensor of its effort"),
        "{text}"
    );
}

/// A system that is up, and does not outlive its test.
struct Up(Child);

impl Drop for Up {
    fn drop(&mut self) {
        // One that has ended is not there any more.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn its_queue_takes_motions_and_a_recording_has_its_motors_by_name() {
    let place = tempfile::tempdir().unwrap();
    let system = package(place.path(), &["enable"]);
    let up = ["up", &system, "--headless", "--for", "10m"];
    let up = command(place.path(), &up).stdout(Stdio::null()).spawn();
    let up = Up(up.unwrap());
    let begun = Instant::now();
    let until = |arguments: &[&str]| loop {
        let output = condor(place.path(), arguments);
        if output.status.success() {
            return text(&output);
        }
        assert!(begun.elapsed() < PATIENCE, "{}", text(&output));
    };
    // Until the fingers are enabled, the master refuses it.
    assert!(until(&["motion", "pinch"]).contains("pinch: done"));
    let file = place.path().join("run.mcap").display().to_string();
    until(&["record", &file, "--for", "1s"]);
    let down = condor(place.path(), &["down"]);
    assert!(down.status.success(), "{}", text(&down));
    let csv = place.path().join("run.csv");
    let csv_name = csv.display().to_string();
    let exported = condor(place.path(), &["export", &file, "--csv", &csv_name]);
    assert!(exported.status.success(), "{}", text(&exported));
    let table = std::fs::read_to_string(csv).unwrap();
    let names = table.lines().next().unwrap();
    for name in [
        "index.spread.position [rad]",
        "thumb.oppose.target [rad]",
        "ring.distal-motor.command [N m]",
        "thumb.turn-motor.effort [N m]",
    ] {
        assert!(names.contains(name), "{name}: {names}");
    }
    drop(up);
}

#[test]
fn its_motions_are_checked_without_processors() {
    let place = tempfile::tempdir().unwrap();
    let file = |name: &str| Path::new(PACKAGE).join(name).display().to_string();
    let hand = file("hand.toml");
    for motion in MOTIONS {
        let motion = file(&format!("motions/{motion}.toml"));
        let output = condor(place.path(), &["sim", &hand, "--check", &motion]);
        assert!(output.status.success(), "{}", text(&output));
    }
}
