//! Each robot of this folder makes its motions, is recorded, is checked without processors, and names what is broken.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use condor_hand::config::Hand;
use condor_hand::kinematics::Kinematics;

/// The time that a system may take to come up, on a machine that has much else to do.
const PATIENCE: Duration = Duration::from_secs(120);

/// A robot: its folder, its description, and its motions in the order in which they can run.
struct Robot {
    folder: &'static str,
    description: &'static str,
    motions: &'static [&'static str],
    /// The simulated time that all motions take, and more.
    time: &'static str,
    /// Lines that break something while the first motion runs, each with the fault that is said then.
    faults: &'static [(&'static str, &'static str)],
    /// Some of the variables that a recording has.
    variables: &'static [&'static str],
}

const MOTOR_HAND: Robot = Robot {
    folder: "motor-hand",
    description: "hand.toml",
    motions: &["wave", "pinch", "fist", "count", "open"],
    time: "20s",
    faults: &[
        (
            "fault index.middle position",
            "index has a fault: index.middle: position is stuck, it should have changed by ",
        ),
        (
            "fault thumb.proximal-motor drive",
            "thumb has a fault: thumb.proximal: tracking error of ",
        ),
        (
            "fault ring.spread-motor drive",
            "ring has a fault: ring.spread: tracking error of ",
        ),
    ],
    variables: &[
        "index.spread.position [rad]",
        "thumb.oppose.target [rad]",
        "ring.distal-motor.command [N m]",
        "thumb.turn-motor.effort [N m]",
    ],
};

const COUPLED_HAND: Robot = Robot {
    folder: "coupled-hand",
    description: "hand.toml",
    motions: &["wave", "fist", "open"],
    time: "10s",
    faults: &[
        (
            "fault index.middle position",
            "index has a fault: index.middle: position is stuck, it should have changed by ",
        ),
        (
            "fault ring.tip-flexor drive",
            "ring has a fault: ring.tip-flexor: effort of ",
        ),
    ],
    variables: &["thumb.middle.position [rad]", "index.tip-flexor.effort [N]"],
};

const WAM_ARM: Robot = Robot {
    folder: "wam-arm",
    description: "arm.toml",
    motions: &["ready", "reach", "draw"],
    time: "20s",
    faults: &[
        (
            "fault arm.m4 drive",
            "arm has a fault: arm.elbow: tracking error of ",
        ),
        (
            "fault arm.m2 position",
            "arm has a fault: arm.m2: position is stuck, it should have changed by ",
        ),
        (
            "fault arm.m4 position",
            "arm has a fault: arm.m4: position is stuck, it should have changed by ",
        ),
    ],
    variables: &["arm.twist.position [rad]", "arm.m3.command [N m]"],
};

/// The program, with a directory of its own for what runs.
fn condor(place: &Path, arguments: &[&str]) -> Output {
    command(place, arguments).output().unwrap()
}

fn command(place: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_robots"));
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

/// Executes a command until it succeeds, and returns what it has shown.
fn until(place: &Path, arguments: &[&str]) -> String {
    let begun = Instant::now();
    loop {
        let output = condor(place, arguments);
        if output.status.success() {
            return text(&output);
        }
        assert!(begun.elapsed() < PATIENCE, "{}", text(&output));
    }
}

/// Ends the system.
fn down(place: &Path) {
    let down = condor(place, &["down"]);
    assert!(down.status.success(), "{}", text(&down));
}

/// Returns the table of a recording.
fn exported(place: &Path, file: &str) -> String {
    let csv = place.join("run.csv");
    let name = csv.display().to_string();
    let exported = condor(place, &["export", file, "--csv", &name]);
    assert!(exported.status.success(), "{}", text(&exported));
    std::fs::read_to_string(csv).unwrap()
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

impl Robot {
    fn file(&self, name: &str) -> PathBuf {
        let package = Path::new(env!("CARGO_MANIFEST_DIR"));
        package.join(self.folder).join(name)
    }

    /// A copy of the robot with files of its own, of which the master is typed these lines; its system.
    fn copy(&self, place: &Path, typed: &[&str]) -> String {
        let motions = self.motions.iter();
        let motions = motions.map(|motion| format!("motions/{motion}.toml"));
        let files = [self.description.to_owned(), "system.toml".to_owned()];
        for file in files.into_iter().chain(motions) {
            let to = place.join(&file);
            std::fs::create_dir_all(to.parent().unwrap()).unwrap();
            std::fs::copy(self.file(&file), to).unwrap();
        }
        let system = place.join("system.toml");
        let description = std::fs::read_to_string(&system).unwrap();
        let (head, _) = description.split_once("headless = ").unwrap();
        std::fs::write(&system, format!("{head}headless = {typed:?}\n")).unwrap();
        system.display().to_string()
    }

    /// Runs the robot for some simulated time, and returns what it has shown.
    fn run(&self, typed: &[&str], time: &str) -> String {
        let place = tempfile::tempdir().unwrap();
        let system = self.copy(place.path(), typed);
        let up = ["up", &system, "--headless", "--for", time, "--speed", "max"];
        let output = condor(place.path(), &up);
        let text = text(&output);
        assert!(output.status.success(), "{text}");
        text
    }

    fn moves_alike_in_each_run(&self) {
        let motions = self.motions.iter().map(|motion| format!("run {motion}"));
        let motions: Vec<String> = motions.collect();
        let mut typed = vec!["enable"];
        typed.extend(motions.iter().map(String::as_str));
        let run = || {
            let text = self.run(&typed, self.time);
            for motion in self.motions {
                assert!(text.contains(&format!("{motion} is done")), "{text}");
            }
            assert!(!text.contains("has a fault"), "{text}");
            assert!(!text.contains("no joint"), "{text}");
            let hash = text.lines().find(|line| line.contains(": hash "));
            hash.unwrap_or_else(|| panic!("no hash: {text}")).to_owned()
        };
        assert_eq!(run(), run());
    }

    fn names_what_is_broken(&self) {
        let first = format!("run {}", self.motions[0]);
        for (broken, named) in self.faults {
            let text = self.run(&["enable", &first, broken], "4s");
            assert!(text.contains(named), "{text}");
            assert_eq!(text.matches("has a fault").count(), 1, "{text}");
            assert!(text.contains("all motion stops"), "{text}");
        }
    }

    /// Starts the robot, and has it run its first motion.
    fn up(&self, place: &Path) -> Up {
        let system = self.copy(place, &["enable"]);
        let up = ["up", &system, "--headless", "--for", "10m"];
        let up = command(place, &up).stdout(Stdio::null()).spawn();
        let up = Up(up.unwrap());
        // Until the robot is enabled, the master refuses it.
        let motion = self.motions[0];
        assert!(until(place, &["motion", motion]).contains(&format!("{motion}: done")));
        up
    }

    fn is_recorded_while_a_client_asks_for_a_motion(&self) {
        let place = tempfile::tempdir().unwrap();
        let up = self.up(place.path());
        let file = place.path().join("run.mcap").display().to_string();
        until(place.path(), &["record", &file, "--for", "1s"]);
        down(place.path());
        let table = exported(place.path(), &file);
        let names = table.lines().next().unwrap();
        for name in self.variables {
            assert!(names.contains(name), "{name}: {names}");
        }
        drop(up);
    }

    fn has_motions_that_can_be_made(&self) {
        let place = tempfile::tempdir().unwrap();
        let description = self.file(self.description).display().to_string();
        let motions = self.motions.iter();
        let files = motions.map(|motion| self.file(&format!("motions/{motion}.toml")));
        let files: Vec<String> = files.map(|file| file.display().to_string()).collect();
        for motion in &files {
            let output = condor(place.path(), &["sim", &description, "--check", motion]);
            assert!(output.status.success(), "{}", text(&output));
        }
    }
}

macro_rules! robots {
    ($($name:ident: $robot:expr;)*) => {
        $(mod $name {
            use super::*;

            #[test]
            fn moves_alike_in_each_run() {
                $robot.moves_alike_in_each_run();
            }

            #[test]
            fn names_what_is_broken() {
                $robot.names_what_is_broken();
            }

            #[test]
            fn is_recorded_while_a_client_asks_for_a_motion() {
                $robot.is_recorded_while_a_client_asks_for_a_motion();
            }

            #[test]
            fn has_motions_that_can_be_made() {
                $robot.has_motions_that_can_be_made();
            }
        })*
    };
}

robots! {
    motor_hand: MOTOR_HAND;
    coupled_hand: COUPLED_HAND;
    wam_arm: WAM_ARM;
}

#[test]
fn a_hand_of_motors_says_nothing_of_tendons() {
    let text = MOTOR_HAND.run(&["enable", "fault index.middle-motor effort"], "1s");
    for word in ["tendon", "tension", "flexor", "slack"] {
        assert!(!text.contains(word), "{word}: {text}");
    }
    assert!(
        text.contains("index.middle-motor has no sensor of its effort"),
        "{text}"
    );
}

/// A point in the axes of the palm, m.
type Point = [f64; 3];

fn minus(a: Point, b: Point) -> Point {
    std::array::from_fn(|axis| a[axis] - b[axis])
}

fn dot(a: Point, b: Point) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn distance(a: Point, b: Point) -> f64 {
    dot(minus(a, b), minus(a, b)).sqrt()
}

/// The distance of a point from the line between two others, m.
fn off_line(point: Point, from: Point, to: Point) -> f64 {
    let (way, gone) = (minus(to, from), minus(point, from));
    let share = (dot(gone, way) / dot(way, way)).clamp(0.0, 1.0);
    distance(gone, way.map(|it| it * share))
}

/// The positions of the arm's joints in each row of a table that has them, rad.
fn postures(table: &str) -> Vec<[f64; 4]> {
    let mut lines = table.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let columns = ["yaw", "pitch", "twist", "elbow"].map(|joint| {
        let name = format!("arm.{joint}.position [rad]");
        names.iter().position(|it| *it == name).unwrap()
    });
    let posture = |line: &str| {
        let row: Vec<&str> = line.split(',').collect();
        let all = columns.map(|column| row[column].parse::<f64>().ok());
        all.iter()
            .all(Option::is_some)
            .then(|| all.map(Option::unwrap))
    };
    lines.filter_map(posture).collect()
}

#[test]
fn the_tip_of_the_arm_follows_two_lines_and_an_arc() {
    let place = tempfile::tempdir().unwrap();
    let up = WAM_ARM.up(place.path());
    let file = place.path().join("run.mcap");
    let name = file.display().to_string();
    let record = command(place.path(), &["record", &name])
        .stdout(Stdio::null())
        .spawn();
    let mut record = Up(record.unwrap());
    let begun = Instant::now();
    while std::fs::metadata(&file).map_or(0, |file| file.len()) == 0 {
        assert!(begun.elapsed() < PATIENCE, "nothing is recorded");
        std::thread::yield_now();
    }
    assert!(until(place.path(), &["motion", "draw"]).contains("draw: done"));
    down(place.path());
    assert!(record.0.wait().unwrap().success());
    drop(up);

    let description = std::fs::read_to_string(WAM_ARM.file("arm.toml")).unwrap();
    let arm = Hand::<1, 4, 4>::from_toml(&description, "arm.toml").unwrap();
    let chain = arm.fingers[0].chain();
    let tip = |posture: [f64; 4]| -> Point { chain.tip(&posture.into()).position.into() };
    // As `draw.toml` has them.
    let ready = tip([0.0, 0.5, 0.0, 1.6]);
    let (right, left) = ([0.62, -0.2, 0.55], [0.62, 0.2, 0.55]);
    let off_arc = |[x, y, z]: Point| {
        let above = if z < 0.55 { f64::INFINITY } else { 0.0 };
        (x - 0.62).hypot(y.hypot(z - 0.55) - 0.2) + above
    };
    let places = [right, left, [0.62, 0.0, 0.75], right];
    let (mut most, mut passed) = (0.0_f64, 0);
    for posture in postures(&exported(place.path(), &name)) {
        let at = tip(posture);
        let off = off_line(at, ready, right).min(off_line(at, right, left));
        most = most.max(off.min(off_arc(at)));
        if places
            .get(passed)
            .is_some_and(|&it| distance(at, it) < 2e-3)
        {
            passed += 1;
        }
    }
    // 0.6 mm, of which the servos' errors are the greatest part.
    assert!(most <= 1e-3, "the tip is {most} m off");
    assert_eq!(
        passed,
        places.len(),
        "the tip does not come to all of the places"
    );
}
