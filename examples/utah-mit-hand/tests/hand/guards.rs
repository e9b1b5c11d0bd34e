//! Motions with guards, typed at the master's terminal, in virtual time.
//!
//! The set-points of the servos are read from their variables, in every tick of them; which fingers touch
//! the ball, from what the simulated robot says.

use std::time::Duration;

use condor_hand::config::Hand;
use condor_mbox::linux::LinuxWindow;
use condor_mbox::{MemoryWindow, Places, Processor};
use condor_rt::numbers;
use condor_rt::objects::{self, Kind};
use condor_vars::{Client, Table, VARS, Watcher};
use utah_mit_hand::{FINGERS, JOINTS, servo};

use crate::typist::{FIRST, MASTER, SECOND, Typist, hand, run, run_with};

const SOON: Duration = Duration::from_secs(2);
const SERVO_S: f64 = 1.0 / 400.0;
const MASTER_S: f64 = 1.0 / 50.0;
/// The limit of the velocity of all joints, rad/s.
const VELOCITY: f64 = 15.0;

type Postures = Vec<[[f64; JOINTS]; FINGERS]>;

/// What was seen of a motion.
struct Seen {
    /// The set-points of the servos in each of their ticks, rad.
    targets: Postures,
    /// Which tick of the servos was the first after the robot said that a finger touches.
    touched: [Option<usize>; FINGERS],
    /// The set-points of the master in each of its ticks, rad.
    wanted: Postures,
    shown: String,
}

/// The set-points of both servo processors, in each tick.
struct Targets {
    watchers: [Watcher<LinuxWindow>; 2],
    rows: [Vec<[[f64; JOINTS]; 2]>; 2],
}

impl Targets {
    fn new(typist: &Typist<'_>) -> Self {
        let hand = hand();
        let watcher = |number: Processor, served: [usize; 2]| {
            let region = typist.region(number);
            let object = objects::find(&region, servo::LOOP, Kind::Variables);
            let table = Table::open(&region, object.unwrap().unwrap().offset).unwrap();
            let joints = served.map(|finger| &hand.fingers[finger]);
            let names = joints.into_iter().flat_map(|finger| {
                let joints = finger.joints.iter();
                joints.map(|joint| format!("{}.{}.target", finger.name, joint.name))
            });
            let entries: Vec<u32> = names
                .map(|name| table.find(&name).unwrap().expect(&name).number)
                .collect();
            assert!(entries.is_sorted());
            let own = typist.region(numbers::TERMINALS);
            let mut places = Places::new(own.size());
            let mut client =
                Client::new(typist.mailbox(), own, &mut places, number, VARS).unwrap();
            let mut watcher = client.claim(&table, SOON).unwrap();
            client.select(&mut watcher, &entries, 1, SOON).unwrap();
            watcher
        };
        Self {
            watchers: [watcher(FIRST, [0, 1]), watcher(SECOND, [2, 3])],
            rows: [Vec::new(), Vec::new()],
        }
    }

    fn read(&mut self) {
        for (watcher, rows) in self.watchers.iter_mut().zip(&mut self.rows) {
            let mut words = [0; 2 * JOINTS];
            while watcher.read(&mut words).unwrap().is_some() {
                let value = |at: usize| f64::from(f32::from_bits(words[at]));
                rows.push([0, 1].map(|finger: usize| {
                    std::array::from_fn(|joint| value(finger * JOINTS + joint))
                }));
            }
            assert_eq!(watcher.lost(), 0);
        }
    }

    fn len(&self) -> usize {
        self.rows[0].len().min(self.rows[1].len())
    }

    fn postures(&self) -> Postures {
        let both = self.rows[0].iter().zip(&self.rows[1]);
        both.map(|(&[a, b], &[c, d])| [a, b, c, d]).collect()
    }
}

/// All fingers follow, and are around a ball that is held, with their tips away from it.
fn around_the_ball(typist: &mut Typist<'_>) {
    typist.begin();
    typist.types("enable");
    typist.wait(2.0);
    typist.runs("open");
    typist.runs("grasp");
    assert_eq!(typist.says("ball"), "");
    typist.writes("apart", &motion("0.1", "", "by", -0.35));
    typist.runs("apart");
    assert_eq!(typist.truth().touching, 0);
}

/// A motion of the middle joints of all fingers.
fn motion(speed: &str, guard: &str, key: &str, to: f64) -> String {
    let joints = ["index", "middle", "ring", "thumb"];
    let joints = joints.map(|finger| format!("\"{finger}.middle\" = {to:?}\n"));
    let joints = joints.concat();
    format!(
        "[[motion]]\nprofile = \"trapezoid\"\nspeed = {speed}\n{guard}\n[motion.{key}]\n{joints}\n"
    )
}

/// Runs a motion to its end, and a little longer.
fn watched(typist: &mut Typist<'_>, name: &str) -> Seen {
    let mut targets = Targets::new(typist);
    let mut touched = [None; FINGERS];
    typist.shown.clear();
    typist.wanted.clear();
    typist.types(&format!("run {name}"));
    let (mut steps, mut left) = (0, 400);
    while left > 0 {
        typist.wait(0.0005);
        targets.read();
        let touching = typist.truth().touching;
        for (finger, place) in touched.iter_mut().enumerate() {
            if touching >> finger & 1 == 1 {
                place.get_or_insert(targets.len());
            }
        }
        steps += 1;
        assert!(steps < 20_000, "{}", typist.shown);
        if typist.shown.contains(" is done") {
            left -= 1;
        }
    }
    Seen {
        targets: targets.postures(),
        touched,
        wanted: typist.wanted.clone(),
        shown: typist.shown.clone(),
    }
}

/// The largest change of a joint from one to the next, rad.
fn largest_step(postures: &Postures) -> f64 {
    let steps = postures.windows(2).flat_map(|pair| {
        let (before, after) = (pair[0].as_flattened(), pair[1].as_flattened());
        let steps = before.iter().zip(after).map(|(a, b)| (a - b).abs());
        steps.collect::<Vec<_>>()
    });
    steps.fold(0.0, f64::max)
}

/// In which ticks of the servos a joint was sent elsewhere than in the one before.
fn moving(seen: &Seen, finger: usize, joint: usize) -> Vec<usize> {
    let ticks = seen.targets.windows(2).enumerate();
    let moves = ticks.filter(|(_, pair)| pair[0][finger][joint] != pair[1][finger][joint]);
    moves.map(|(tick, _)| tick + 1).collect()
}

/// How many of a finger's set-points from a tick on differ from those before, until they have been the same
/// for eight ticks; and the set-point then.
fn stops_after(seen: &Seen, finger: usize, from: usize) -> (usize, f64) {
    let moving = moving(seen, finger, 2);
    let mut last = from.saturating_sub(1);
    let mut count = 0;
    for tick in moving.into_iter().filter(|&tick| tick >= from) {
        if tick > last + 8 {
            break;
        }
        last = tick;
        count += 1;
    }
    (count, seen.targets[last][finger][2])
}

#[test]
fn a_contact_stops_the_set_points_of_its_finger_within_three_ticks_at_any_speed() {
    for speed in ["0.1", "0.3", "1.0"] {
        run(|typist| {
            around_the_ball(typist);
            let close = motion(speed, "stop = { contact = true }", "by", 0.65);
            typist.writes("close", &[close, motion(speed, "", "by", -0.2)].concat());
            let seen = watched(typist, "close");
            let v = VELOCITY * speed.parse::<f64>().unwrap();
            let mut stopped = 0;
            for (finger, entry) in hand().fingers.iter().enumerate() {
                let name = &entry.name;
                let said = format!(" N at {name} has stopped a motion");
                if !seen.shown.contains(&said) {
                    continue;
                }
                stopped += 1;
                let touched = seen.touched[finger].expect("it touches what stops it");
                let (ticks, rest) = stops_after(&seen, finger, touched);
                println!("{speed} {name}: {ticks} ticks after the contact, at {rest} rad");
                assert!(ticks <= 3, "{speed} {name}: {ticks} ticks");
                // It was moving until then, and the next motion begins there.
                let before = moving(&seen, finger, 2);
                assert!(before.iter().any(|&tick| tick + 3 >= touched && tick <= touched));
                let end = seen.targets.last().unwrap()[finger][2];
                assert!((end - (rest - 0.2)).abs() < 1e-6, "{end} from {rest}");
                let wanted = seen.wanted.last().unwrap()[finger][2];
                assert!((end - wanted).abs() < 1e-6, "{end} is not {wanted}");
            }
            assert!(stopped >= 1, "{}", seen.shown);
            let step = largest_step(&seen.targets);
            println!("{speed}: {step} rad in a tick of the servos");
            assert!(step > 0.9 * v * SERVO_S && step < 1.05 * VELOCITY * SERVO_S);
            assert!(largest_step(&seen.wanted) < 1.01 * VELOCITY * MASTER_S);
            assert!(!typist.says("status").contains("fault"));
        });
    }
}

/// Closes the fingers slowly on the ball until a guard holds; gives what was said.
fn closes(guard: &str) -> String {
    run(|typist| {
        around_the_ball(typist);
        let close = motion("0.02", guard, "by", 0.65);
        typist.writes("close", &[close, motion("0.02", "", "by", -0.2)].concat());
        let seen = watched(typist, "close");
        let held = seen.targets.windows(2).flat_map(|pair| {
            (0..FINGERS).filter(move |&finger| pair[0][finger][2] == pair[1][finger][2])
        });
        assert!(held.count() > 100);
        println!("{guard}: {}", seen.shown);
        for finger in 0..FINGERS {
            // Each presses on the ball first; the ball is where they would have to be at the end.
            let greatest = seen.targets.iter().map(|posture| posture[finger][2]);
            let greatest = greatest.fold(f64::MIN, f64::max);
            let (begin, end) = (seen.targets[0][finger][2], seen.targets.last().unwrap()[finger][2]);
            assert!(greatest - begin < 0.64, "{begin} to {greatest}");
            assert!(end < greatest - 0.19, "{greatest} to {end}");
        }
        assert!(largest_step(&seen.targets) < 1.05 * VELOCITY * SERVO_S);
        assert!(largest_step(&seen.wanted) < 1.01 * VELOCITY * MASTER_S);
        assert!(!typist.says("status").contains("fault"));
        seen.shown
    })
}

#[test]
fn a_torque_stops_a_motion() {
    let shown = closes("stop = { torque = 0.04 }");
    let line = shown.lines().find(|line| line.contains("has stopped"));
    let line = line.expect(&shown);
    let value = line.strip_prefix("a torque of ").expect(line);
    let (value, at) = value.split_once(" N m at ").unwrap();
    assert!(at.contains(".middle has stopped a motion"), "{line}");
    let value: f64 = value.parse().unwrap();
    assert!((0.04..0.06).contains(&value), "{line}");
}

#[test]
fn a_tension_stops_a_motion() {
    let shown = closes("stop = { tension = 10.0 }");
    let line = shown.lines().find(|line| line.contains("has stopped"));
    let line = line.expect(&shown);
    let value = line.strip_prefix("a tension of ").expect(line);
    let (value, at) = value.split_once(" N at ").unwrap();
    assert!(at.contains(".middle has stopped a motion"), "{line}");
    let value: f64 = value.parse().unwrap();
    assert!((10.0..12.0).contains(&value), "{line}");
}

#[test]
fn a_contact_begins_a_motion() {
    run(|typist| {
        around_the_ball(typist);
        let close = motion("0.05", "", "by", 0.5);
        let back = "begin = \"now\"\nstart = { contact = true }";
        typist.writes("touch", &[close, motion("0.05", back, "by", -0.2)].concat());
        let seen = watched(typist, "touch");
        let first = seen.touched.iter().flatten().min().copied().unwrap();
        for finger in 0..FINGERS {
            let at = |tick: usize| seen.targets[tick][finger][2];
            // Forwards until the first of them touches, and back from there.
            let turn = (0..seen.targets.len()).max_by(|&a, &b| at(a).total_cmp(&at(b)));
            let turn = turn.unwrap();
            assert!(turn > first && turn < first + 40, "{turn} after {first}");
            let end = at(seen.targets.len() - 1);
            assert!(end < at(first) - 0.15, "{} to {end}", at(first));
        }
        println!("{} {}", largest_step(&seen.targets), largest_step(&seen.wanted));
        assert!(largest_step(&seen.targets) < 1.05 * VELOCITY * SERVO_S);
        assert!(largest_step(&seen.wanted) < 1.01 * VELOCITY * MASTER_S);
    });
}

#[test]
fn a_guard_of_contact_needs_a_sensor() {
    let mut hand: Hand<4, 4> = hand();
    hand.fingers[2].touch = None;
    run_with(&hand, |typist| {
        typist.begin();
        typist.types("enable");
        typist.wait(2.0);
        typist.writes("close", &motion("0.1", "stop = { contact = true }", "by", 0.1));
        assert_eq!(
            typist.says("run close"),
            "motion 1 has a guard of contact, and ring has no tactile sensor\n"
        );
        typist.writes("close", &motion("0.1", "stop = { torque = 5.0 }", "by", 0.1));
        typist.runs("close");
    });
}

#[test]
fn a_new_life_of_the_master_is_not_held_by_the_stops_of_the_last() {
    run(|typist| {
        around_the_ball(typist);
        let close = motion("0.1", "stop = { contact = true }", "by", 0.65);
        typist.writes("close", &close);
        watched(typist, "close");
        assert_eq!(typist.says("ball none"), "");
        typist.restart(MASTER);
        typist.begin();
        typist.types("enable");
        typist.wait(4.0);
        typist.shown.clear();
        // The first motions of this life, with the numbers of those of the last.
        for _ in 0..3 {
            typist.runs("open");
            assert!(!typist.shown.contains("stopped"), "{}", typist.shown);
        }
    });
}
