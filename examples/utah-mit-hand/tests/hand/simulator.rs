//! What the simulator plans is what the master makes, to the last bit.

use std::process::Command;

use condor_host::robot::{Plan, Simulator, What};
use condor_scene::HandView;

use crate::motions::SHIPPED;
use crate::typist::{Typist, hand, motions, run};

/// Every profile and pace, blends, joints taken from others, waits, displacements, and a target in the zone
/// of a stop.
const MIXED: &str = r#"
[[motion]]
profile = "trapezoid"
speed = 0.2
[motion.to]
"index.proximal" = 0.8
"ring.distal" = 1.55

[[motion]]
profile = "jerk-limited"
duration = 0.7
begin = "beside"
start = { time = 0.13 }
[motion.by]
"middle.middle" = 0.3
"middle.distal" = 0.2

[[motion]]
profile = "cubic"
duration = 0.9
blend = 0.11
[motion.to]
"index.proximal" = 0.2
[motion.by]
"thumb.abduction" = 0.2
[[motion.via]]
at = 0.4
joints = { "index.proximal" = 1.0, "thumb.abduction" = -0.1 }

[[motion]]
profile = "minimum-jerk"
duration = 0.6
begin = "now"
stop = { time = 0.3 }
[motion.to]
"thumb.abduction" = 0.0
"ring.middle" = 0.5
"#;

type Row = [[u64; 16]; 2];

/// Returns positions and rates of the ticks from the first on that differs from the one before all of them.
fn moving(rows: impl IntoIterator<Item = Row>) -> Vec<Row> {
    let rows: Vec<Row> = rows.into_iter().collect();
    let first = rows[0];
    let still = rows.iter().take_while(|row| **row == first).count();
    rows[still..].to_vec()
}

fn planned(plan: &Plan) -> Vec<Row> {
    let ticks = plan.joints[0].position.len();
    let row = |tick: usize| {
        let joint = |joint: usize| &plan.joints[joint];
        let position = std::array::from_fn(|it| joint(it).position[tick].to_bits());
        let velocity = std::array::from_fn(|it| joint(it).velocity[tick].to_bits());
        [position, velocity]
    };
    moving((0..ticks).map(row))
}

fn bits(posture: &[[f64; 4]; 4]) -> [u64; 16] {
    std::array::from_fn(|joint| posture.as_flattened()[joint].to_bits())
}

/// Plans a motion from where the hand is to be, runs it, and compares all set-points.
fn compare(typist: &mut Typist<'_>, simulator: &dyn Simulator, name: &str, text: &str) {
    typist.wait(0.1);
    let from = *typist.wanted.last().unwrap();
    let plan = simulator.plan(from.as_flattened(), text, name).unwrap();
    assert!(
        !plan
            .events
            .iter()
            .any(|it| matches!(it.what, What::Refused { .. } | What::Waits))
    );
    typist.wanted.clear();
    typist.rates.clear();
    typist.wait(0.05);
    typist.runs(name);
    typist.wait(0.1);
    let planned = planned(&plan);
    let rows = typist.wanted.iter().zip(&typist.rates);
    let made = moving(rows.map(|(position, rate)| [bits(position), bits(rate)]));
    assert!(planned.len() > 30, "{name}: {} ticks", planned.len());
    for (tick, (planned, made)) in planned.iter().zip(&made).enumerate() {
        assert_eq!(planned, made, "{name}: tick {tick} of the motion");
    }
    // Then it rests where the plan ends.
    assert!(made.len() > planned.len());
    for rest in &made[planned.len()..] {
        assert_eq!(rest[0], planned[planned.len() - 1][0], "{name}");
        assert!(rest[1].iter().all(|rate| f64::from_bits(*rate) == 0.0));
    }
}

#[test]
fn the_hand_makes_what_was_planned_to_the_last_bit() {
    run(|typist| {
        typist.begin();
        typist.types("enable");
        typist.wait(1.5);
        let view = HandView::new(&hand());
        for name in SHIPPED {
            let text = std::fs::read_to_string(motions().join(format!("{name}.toml"))).unwrap();
            compare(typist, &view, name, &text);
        }
        typist.runs("open");
        // As the simulator writes it.
        let mixed = view.text(&view.steps(MIXED, "mixed").unwrap()).unwrap();
        typist.writes("mixed", &mixed);
        compare(typist, &view, "mixed", MIXED);
    });
}

#[test]
fn no_parts_meet_in_a_motion_that_ships() {
    let view = HandView::new(&hand());
    let plan = |from: &[f64], name: &str| {
        let text = std::fs::read_to_string(motions().join(name)).unwrap();
        view.plan(from, &text, name).unwrap()
    };
    let zero = view.moved(&[]).positions;
    let open = plan(&zero, "open.toml");
    let open: Vec<f64> = open
        .joints
        .iter()
        .map(|joint| *joint.position.last().unwrap())
        .collect();
    let mut count = 0;
    for entry in std::fs::read_dir(motions()).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        for from in [&zero, &open] {
            let plan = plan(from, &name);
            assert_eq!(plan.collisions, [], "{name}");
            assert_eq!(plan.overloads, [], "{name}");
        }
        count += 1;
    }
    assert!(count >= SHIPPED.len());
}

/// Runs the command `sim` with a motion, and returns its exit code, and what it prints and says.
fn sim(text: &str, more: &[&str]) -> (Option<i32>, String, String) {
    let place = tempfile::tempdir().unwrap();
    let file = place.path().join("it.toml");
    std::fs::write(&file, text).unwrap();
    let robot = motions().join("../../../condor-hand/hands/utah-mit.toml");
    let output = Command::new(env!("CARGO_BIN_EXE_utah-mit-hand"))
        .arg("sim")
        .arg(robot)
        .arg("--check")
        .arg(&file)
        .args(more)
        .output()
        .unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (
        output.status.code(),
        text(output.stdout),
        text(output.stderr),
    )
}

#[test]
fn the_command_says_whether_a_motion_can_be_and_writes_its_ticks() {
    let place = tempfile::tempdir().unwrap();
    let csv = place.path().join("it.csv");
    let spread = "[[motion]]\nprofile = \"minimum-jerk\"\nduration = 0.5\nto = { \"index.abduction\" = 0.2 }\n";
    let from = [
        "--from",
        "index.abduction=0.1",
        "--csv",
        csv.to_str().unwrap(),
    ];
    let (code, said, _) = sim(spread, &from);
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("index.abduction   0.100  0.200"), "{said}");
    assert!(
        said.contains("0.50     1  has reached its targets"),
        "{said}"
    );
    assert!(
        said.ends_with(
            "\nChecked 26 ticks of 0.02 s: all steps can be made, the actuators give every torque, and no \
             parts meet.\n"
        ),
        "{said}"
    );
    let table = std::fs::read_to_string(&csv).unwrap();
    let rows: Vec<&str> = table.lines().collect();
    assert_eq!(rows.len(), 1 + 1 + 25);
    assert!(rows[0].starts_with("time,index.abduction.position,index.abduction.velocity,"));
    assert!(
        rows[1].starts_with("0,0.1,0,") && rows[26].starts_with("0.5,0.2,0,"),
        "{table}"
    );
    assert!(rows.iter().all(|row| row.split(',').count() == 1 + 16 * 6));

    // Both fingers turn towards each other.
    let meet = spread.replace("0.2", "-0.3, \"middle.abduction\" = 0.3");
    let (code, said, _) = sim(&meet, &[]);
    assert_eq!(code, Some(1));
    assert!(
        said.contains("index.middle and middle.middle meet") && !said.contains("Checked"),
        "{said}"
    );
    let (code, said, _) = sim(&spread.replace("0.2", "2.5"), &[]);
    assert_eq!(code, Some(1));
    assert!(said.contains("is refused: index.abduction"), "{said}");
    let (code, _, said) = sim(&spread.replace("index", "indx"), &[]);
    assert_eq!(code, Some(1));
    assert!(
        said.contains("it.toml:4") && said.contains("indx.abduction"),
        "{said}"
    );
    let (code, _, said) = sim(spread, &["--from", "indx.abduction=0.1"]);
    assert_eq!(code, Some(1));
    assert!(said.contains("did you mean `index.abduction`?"), "{said}");
    let (code, _, said) = sim(spread, &["--from", "index.abduction=x"]);
    assert_eq!(code, Some(2));
    assert!(said.contains("\"x\" is not a number"), "{said}");
    let (code, said, _) = sim(spread, &["--json"]);
    assert_eq!(code, Some(0));
    assert!(
        said.starts_with("{\"period_s\":0.02,\"joints\":[{\"name\":\"index.abduction\","),
        "{said}"
    );
    assert!(
        said.contains("{\"at_s\":0.5,\"step\":1,\"what\":\"reached\"}"),
        "{said}"
    );
}

#[test]
fn the_program_speaks_of_itself_and_prints_help_that_is_asked_for() {
    let hand = |arguments: &[&str]| {
        let hand = Command::new(env!("CARGO_BIN_EXE_utah-mit-hand"))
            .args(arguments)
            .output()
            .unwrap();
        let text = |bytes| String::from_utf8(bytes).unwrap();
        (hand.status.code(), text(hand.stdout), text(hand.stderr))
    };
    let usage = "Usage: utah-mit-hand motion";
    for help in ["--help", "-h"] {
        let (code, printed, said) = hand(&["motion", help]);
        assert_eq!((code, said.as_str()), (Some(0), ""));
        assert!(printed.starts_with(usage), "{printed}");
    }
    let (code, printed, said) = hand(&["motion", "--hlp"]);
    assert_eq!((code, printed.as_str()), (Some(2), ""));
    assert!(said.starts_with(usage), "{said}");
    let (code, printed, _) = hand(&["--help"]);
    assert_eq!(code, Some(0));
    for own in [
        "Usage: utah-mit-hand",
        "`utah-mit-hand --remote ROBOT COMMAND`",
    ] {
        assert!(printed.contains(own), "{printed}");
    }
    let (code, _, said) = hand(&["check", "/none/at/all.toml"]);
    assert_eq!(code, Some(1));
    assert!(said.starts_with("utah-mit-hand: "), "{said}");
}
