//! The motions that ship, typed at the master's terminal, in virtual time.

use crate::typist::{FIRST, MASTER, REFUSED, Typist, hand, run, run_with};

/// What a run of all motions shows.
#[derive(Debug, PartialEq)]
struct Seen {
    peaks: Vec<(&'static str, f64)>,
    wanted: Vec<[[u64; 4]; 4]>,
    is: Vec<[[u64; 4]; 4]>,
    counts: Vec<(u8, u64, u64)>,
    shown: String,
}

pub(crate) const SHIPPED: [&str; 7] = [
    "open", "fist", "pinch", "tripod", "counting", "wave", "grasp",
];

fn bits(all: &[[[f64; 4]; 4]]) -> Vec<[[u64; 4]; 4]> {
    let one = |posture: &[[f64; 4]; 4]| posture.map(|finger| finger.map(f64::to_bits));
    all.iter().map(one).collect()
}

fn all_motions(typist: &mut Typist<'_>) -> Seen {
    typist.begin();
    typist.types("enable");
    typist.wait(1.5);
    let peaks = SHIPPED.map(|name| (name, typist.runs(name))).to_vec();
    Seen {
        peaks,
        wanted: bits(&typist.wanted),
        is: bits(&typist.is),
        counts: typist.counts(),
        shown: typist.says("status"),
    }
}

#[test]
fn every_motion_that_ships_is_tracked_and_two_runs_are_the_same() {
    let first = run(all_motions);
    println!("{:?}\n{:?}\n{}", first.peaks, first.counts, first.shown);
    for (name, peak_deg) in &first.peaks {
        assert!((0.02..2.5).contains(peak_deg), "{name}: {peak_deg} deg");
    }
    for (number, runs, skips) in &first.counts {
        assert!(*runs > 500, "{number} ran {runs} times");
        assert_eq!(*skips, 0, "{number}");
    }
    assert!(first.wanted.len() > 500);
    assert!(
        first
            .shown
            .contains("its fingers can pass through each other")
    );
    assert!(first == run(all_motions), "two runs differ");
}

#[test]
fn the_first_lines_wait_until_the_fingers_are_there() {
    run(|typist| {
        typist.begin();
        typist.restart(MASTER);
        typist.types("enable");
        typist.types("run open");
        typist.expect("open is done\n", 20.0);
        assert!(
            !typist.shown.contains("its processor does not run"),
            "{}",
            typist.shown
        );
    });
}

/// "A master that is back before sends them none until they have."
#[test]
fn fingers_that_followed_a_master_give_up_though_the_next_one_is_back_before() {
    let mut hand = hand();
    hand.faults.stale_s = 1.0;
    run_with(&hand, |typist| {
        enabled(typist);
        typist.runs("pinch");
        typist.restart(MASTER);
        for finger in ["index", "middle", "ring", "thumb"] {
            let text = format!("{finger} has a fault: {finger}: no new set-point");
            typist.expect(&text, 2.0);
        }
        let refused = typist.says("run open");
        assert!(refused.contains("enable"), "{refused}");
        typist.does("enable");
        typist.wait(1.0);
        typist.runs("open");
        // Whoever enables them before they have given up has them, too.
        typist.restart(MASTER);
        typist.begin();
        typist.does("enable");
        typist.wait(1.0);
        typist.runs("pinch");
    });
}

fn enabled(typist: &mut Typist<'_>) {
    typist.begin();
    typist.does("enable");
    typist.wait(1.0);
}

/// What is left of a run in which the services are killed, or not.
#[derive(Debug, PartialEq)]
struct Left {
    /// How often each line of an end was said.
    said: Vec<usize>,
    saved: Vec<u8>,
    skips: Vec<(u8, u64)>,
}

fn worked(typist: &mut Typist<'_>, kills: bool) -> Left {
    let names = ["open", "wave", "counting"];
    enabled(typist);
    let incarnation = typist.incarnation_of_files();
    assert!(incarnation.is_some());
    let mut shown = String::new();
    for name in names {
        if kills {
            // The motion is loaded by the next incarnation.
            typist.kill_files();
            typist.wait(0.05);
        }
        typist.types(&format!("run {name}"));
        typist.wait(0.3);
        if kills {
            typist.kill_terminals();
            typist.kill_files();
        }
        typist.expect(&format!("{name} is done\n"), 20.0);
        shown += &std::mem::take(&mut typist.shown);
    }
    typist.types("record kept");
    typist.types("to thumb.middle 0.9 0.4");
    typist.wait(0.7);
    if kills {
        typist.kill_files();
        typist.wait(0.05);
    }
    typist.types("save");
    if kills {
        typist.kill_terminals();
    }
    typist.expect("kept: 1 motion saved\n", 5.0);
    shown += &typist.shown;
    let mut ends: Vec<_> = names.iter().map(|name| format!("{name} is done")).collect();
    ends.push("kept: 1 motion saved".into());
    // So that the last counts are published.
    typist.wait(0.2);
    let killed = typist.incarnation_of_files() != incarnation;
    assert_eq!(killed, kills);
    let counts = typist.counts();
    for (number, runs, _) in &counts {
        assert!(*runs > 200, "{number} ran {runs} times");
    }
    Left {
        said: ends.iter().map(|end| shown.matches(end).count()).collect(),
        saved: typist.file("motions/kept.motion"),
        skips: counts
            .iter()
            .map(|(number, _, skips)| (*number, *skips))
            .collect(),
    }
}

#[test]
fn services_that_are_killed_cost_no_release_no_motion_and_no_line() {
    let quiet = run(|typist| worked(typist, false));
    assert_eq!(quiet.said, [1; 4]);
    assert!(
        quiet.skips.iter().all(|(_, skips)| *skips == 0),
        "{quiet:?}"
    );
    assert_eq!(run(|typist| worked(typist, true)), quiet);
}

/// The set-points of the sequence in memory, from where its first motion ends, 0.9 s.
fn replayed(typist: &mut Typist<'_>) -> Vec<[[f64; 4]; 4]> {
    typist.wanted.clear();
    typist.shown.clear();
    typist.types("run");
    typist.expect("mine is done", 10.0);
    let still = typist.wanted[0];
    let begin = typist.wanted.iter().position(|it| *it != still).unwrap();
    typist.wanted.split_off(begin + 45)
}

#[test]
fn a_motion_is_saved_and_replayed_by_the_next_incarnation_of_the_master() {
    run(|typist| {
        enabled(typist);
        typist.does("record mine");
        typist.runs("open");
        typist.runs("pinch");
        typist.does("to ring.middle 0.9 0.5");
        typist.wait(0.5);
        // A name that is not there costs nothing of it.
        assert!(typist.says("open their").starts_with(REFUSED));
        assert_eq!(typist.says("save"), "mine: 3 motions saved\n");
        let before = replayed(typist);
        typist.restart(MASTER);
        typist.begin();
        // The fingers had a fault when set-points stayed away.
        assert!(typist.says("status").contains("fault"));
        assert_eq!(
            typist.says("open mine"),
            "mine: 3 motions; `run` runs what is in memory\n"
        );
        assert_eq!(
            typist.says("run"),
            "error: index, middle, ring, thumb are not enabled: `enable` makes them hold their positions\n"
        );
        typist.types("enable");
        typist.wait(4.0);
        let after = replayed(typist);
        assert!(before.len() > 60, "{}", before.len());
        assert_eq!(bits(&before), bits(&after));
        let moved = before[0][2][2] - before[before.len() - 1][2][2];
        assert!(moved.abs() > 0.5, "{moved}");
    });
}

#[test]
fn a_ball_is_held_with_the_stiffness_that_was_typed() {
    run(|typist| {
        enabled(typist);
        typist.runs("open");
        typist.runs("grasp");
        typist.does("ball");
        typist.does("grasp 150");
        typist.wait(2.0);
        typist.does("letgo 1");
        typist.wait(3.0);
        assert!(typist.says("status").contains("holds"));
        let held = typist.truth();
        assert_eq!(held.touching, 0b1111);
        for (axis, push) in ["push 0.2 0 0", "push 0 0.2 0", "push 0 0 0.2"]
            .iter()
            .enumerate()
        {
            let before = typist.truth().ball;
            typist.does(push);
            typist.wait(5.0);
            let after = typist.truth();
            let moved: [f64; 3] = std::array::from_fn(|axis| after.ball[axis] - before[axis]);
            let stiffness = 0.2 / moved[axis];
            println!(
                "{push}: {stiffness:.2} N/m, {moved:?}, sliding {}",
                after.sliding
            );
            assert!(
                (stiffness / 150.0 - 1.0).abs() < 0.05,
                "{stiffness} N/m along {axis}"
            );
            assert_eq!(after.touching, 0b1111);
            typist.says("push 0 0 0");
            typist.wait(4.0);
        }
        typist.does("release");
        typist.wait(0.5);
        typist.says("ball none");
        typist.wait(0.5);
        let status = typist.says("status");
        assert!(status.contains("index  follows"), "{status}");
        for (number, _, skips) in typist.counts() {
            assert_eq!(skips, 0, "{number}");
        }
    });
}

#[test]
fn a_processor_that_restarts_and_a_finger_that_fails_are_said_and_taken_up_again() {
    run(|typist| {
        enabled(typist);
        typist.runs("open");
        typist.shown.clear();
        typist.types("run counting");
        typist.wait(0.5);
        typist.restart(FIRST);
        typist.wait(1.0);
        for said in [
            "processor 1 is gone: nothing controls index and middle",
            "all motion stops",
            "processor 1 was restarted: `enable` makes index and middle hold again",
        ] {
            assert!(typist.shown.contains(said), "{said}: {}", typist.shown);
        }
        let status = typist.says("status");
        assert!(status.contains("index  off"), "{status}");
        assert!(status.contains("thumb  follows"), "{status}");
        assert!(status.contains("no motion"), "{status}");
        assert_eq!(
            typist.says("run fist"),
            "error: index, middle are not enabled: `enable` makes them hold their positions\n"
        );
        typist.does("enable");
        let peak = typist.runs("open");
        assert!(peak < 2.5, "{peak} deg");

        typist.shown.clear();
        typist.types("fault index.proximal-flexor drive");
        typist.expect("index has a fault: ", 5.0);
        assert!(typist.says("status").contains("index  fault"));
        typist.does("clear");
        typist.types("enable index");
        typist.wait(4.0);
        assert!(typist.says("status").contains("index  follows"));
        assert!(typist.runs("fist") < 2.5);
    });
}

#[test]
fn every_example_of_the_help_can_be_typed_and_nonsense_is_refused() {
    run(|typist| {
        enabled(typist);
        let list = typist.says("help");
        let rows: Vec<&str> = list.lines().collect();
        assert!(
            rows.len() < 23 && rows.iter().all(|row| row.len() < 80),
            "{list}"
        );
        let (end, groups) = rows.split_last().unwrap();
        assert!(end.starts_with("`help GROUP`"), "{list}");
        let mut names = Vec::new();
        for row in groups {
            let mut words = row.split_whitespace();
            let group = words.next().unwrap();
            let help = typist.says(&format!("help {group}"));
            for name in words {
                assert!(help.contains(&format!("\n{name} ")), "{help}");
                names.push(name);
            }
        }
        assert!(names.len() > 20 && names.contains(&"enable"), "{list}");
        for name in names {
            let help = typist.says(&format!("help {name}"));
            let (about, example) = help.split_once("\nexample: ").unwrap_or_default();
            assert!(about.starts_with(name), "{help}");
            let said = typist.says(example.trim_end());
            assert!(!said.starts_with("error: word "), "{example}: {said}");
            let wrong = typist.says(&format!("{name}{}", " ~".repeat(12)));
            assert!(wrong.starts_with(REFUSED), "{name}: {wrong}");
        }
    });
}

#[test]
fn names_are_completed_and_former_lines_come_back() {
    run(|typist| {
        enabled(typist);
        for (keys, line) in [
            ("stat\t", "status "),
            ("enable th\t", "enable thumb "),
            ("to ring.mi\t0.9 1", "to ring.middle 0.9 1"),
            ("run cou\t", "run counting "),
            (
                "gains ring.middle servo.z\t1",
                "gains ring.middle servo.zeta 1",
            ),
            (
                "gains ring.middle servo.zeta 1 servo.law de\t",
                "gains ring.middle servo.zeta 1 servo.law decoupled ",
            ),
            (
                "fault ring.middle-ex\tdr\t",
                "fault ring.middle-extensor drive ",
            ),
            ("help gai\t", "help gains "),
            ("table ho\t", "table home "),
            ("dance\t", "dance"),
        ] {
            typist.shown.clear();
            typist.presses(keys);
            typist.wait(0.2);
            assert_eq!(typist.shown.replace('\x07', ""), line);
            typist.presses("\x15");
            typist.wait(0.1);
        }
        typist.shown.clear();
        typist.presses("restart \t");
        typist.wait(0.2);
        let listed = typist.shown.lines().nth(1).unwrap_or_default();
        assert_eq!(listed, "0  1  2  5", "{}", typist.shown);
        typist.presses("\x15");
        typist.wait(0.1);
        typist.shown.clear();
        typist.presses("watch index.\t");
        typist.wait(0.2);
        let listed = typist.shown.lines().nth(1).unwrap_or_default();
        let all = "index.abduction  index.proximal  index.middle  index.distal";
        assert_eq!(listed, all, "{}", typist.shown);
        // ^C drops what was begun, and lets the next line be whole.
        typist.presses("\x03");
        typist.wait(0.2);
        assert!(
            typist.shown.ends_with("^C\nno motion runs\n"),
            "{}",
            typist.shown
        );

        let said = typist.says("to index.middle 0.6 0.2");
        assert_eq!(said, "index.middle goes to 0.6 rad\nindex.middle is done\n");
        typist.wait(0.5);
        typist.says("motions");
        // Two lines up, and another number in it: 0.8 for 0.6.
        typist.presses("\x1b[A\x1b[A");
        typist.presses(&"\x1b[D".repeat(4));
        typist.presses("\x7f8\r");
        typist.wait(1.0);
        let middle = typist.truth().position[0][2];
        assert!((middle - 0.8).abs() < 0.02, "{middle}: {}", typist.shown);
        // A key ends the table, and begins the next line.
        typist.types("watch index");
        typist.wait(0.8);
        typist.presses("s");
        typist.wait(0.1);
        typist.shown.clear();
        typist.wait(1.0);
        assert_eq!(typist.shown, "");
        typist.presses("tatus\n");
        typist.expect("index  follows", 1.0);
    });
}

#[test]
fn every_motion_that_ships_is_listed() {
    run(|typist| {
        typist.begin();
        let names = typist.says("motions");
        for name in SHIPPED {
            assert!(names.lines().any(|line| line == name), "{names}");
        }
    });
}

#[test]
fn one_joint_moves_stops_and_is_tuned_and_the_table_goes_home() {
    run(|typist| {
        typist.begin();
        typist.does("enable thumb");
        typist.does("to thumb.middle 1 0.4");
        typist.wait(0.5);
        let middle = typist.truth().position[3][2];
        assert!((middle - 1.0).abs() < 0.01, "{middle}");
        let gains = typist.says("gains thumb.middle");
        for gain in ["servo.law decoupled  servo.kp 1", "servo.bandwidth_hz 10"] {
            assert!(gains.contains(gain), "{gains}");
        }
        assert!(gains.lines().all(|line| line.len() < 80), "{gains}");
        typist.does("gains thumb.middle servo.bandwidth_hz 12.5 servo.k_tau 0.5");
        let gains = typist.says("gains thumb.middle");
        assert!(gains.contains("servo.bandwidth_hz 12.5"), "{gains}");
        assert!(gains.contains("servo.k_tau 0.5"), "{gains}");
        typist.does("gains thumb.middle-flexor gains.kp 0.5");
        let gains = typist.says("gains thumb.middle-flexor");
        assert!(gains.contains("gains.kp 0.5"), "{gains}");
        // A stop on the way, and on.
        typist.types("to thumb.middle 0.3 1.0");
        typist.wait(0.3);
        typist.types("pause");
        typist.wait(0.4);
        let paused = typist.truth().position[3][2];
        typist.wait(0.5);
        assert!((typist.truth().position[3][2] - paused).abs() < 0.01);
        assert!((0.35..0.99).contains(&paused), "{paused}");
        typist.types("resume");
        typist.wait(1.2);
        assert!((typist.truth().position[3][2] - 0.3).abs() < 0.01);
        typist.does("disable");
        assert!(typist.says("status").contains("thumb  off"));
        assert!(typist.says("table home").starts_with("table: "));
        typist.wait(8.0);
        assert!(
            typist
                .says("table 0.05 0.0 -0.02 0.5")
                .starts_with("table: ready")
        );
        typist.wait(3.0);
        let table = typist.truth().table;
        assert!(
            (table[0] - 0.05).abs() < 1e-3 && (table[2] + 0.02).abs() < 1e-3,
            "{table:?}"
        );
    });
}
