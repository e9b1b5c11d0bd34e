//! Motions with guards, typed at the master's terminal, in virtual time.
//!
//! The set-points of the servos are read from their variables, in every tick of them; which fingers touch
//! the ball, from what the simulated robot says.

#![allow(
    clippy::float_cmp,
    reason = "a set-point that rests does not change at all"
)]

use std::fmt::Write;
use std::time::Duration;

use condor_mbox::linux::LinuxWindow;
use condor_mbox::{Allocator, MemoryWindow, Processor};
use condor_robot::{FINGERS, JOINTS, servo};
use condor_rt::numbers;
use condor_rt::objects::{self, ObjectKind};
use condor_vars::{VARS, VariableClient, VariableTable, Watcher};

use crate::rig::Posture;
use crate::typist::{FIRST, MASTER, SECOND, Typist, hand, run, run_with};
use crate::virtual_time::{BALL, apart};

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
            let object = objects::find(&region, servo::LOOP, ObjectKind::Variables);
            let table = VariableTable::open(&region, object.unwrap().unwrap().offset).unwrap();
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
            let mut allocator = Allocator::new(own.size());
            let mut client =
                VariableClient::new(typist.mailbox(), own, &mut allocator, number, VARS).unwrap();
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

/// The radius of the ball; how far the tips are from its middle before motions close them, and how far they
/// would be after that, m.
const RADIUS_M: f64 = 0.018;
const APART_M: [f64; FINGERS] = [0.022; FINGERS];
/// The limits of abduction do not let index and ring come closer.
const CLOSED_M: [f64; FINGERS] = [0.0165, 0.008, 0.0165, 0.008];

/// All fingers follow, and are around a ball that is held, with their tips away from it.
fn around_the_ball(typist: &mut Typist<'_>) {
    typist.begin();
    typist.types("enable");
    typist.wait(2.0);
    typist.runs("open");
    typist.writes("apart", &motion("0.03", "", "to", apart(APART_M)));
    typist.runs("apart");
    let [x, y, z] = BALL;
    let ball = format!("ball {RADIUS_M} 0.05 {x} {y} {z}");
    typist.does(&ball);
    assert_eq!(typist.truth().touching, 0);
}

/// A motion of all joints.
fn motion(speed: &str, guard: &str, key: &str, joints: Posture) -> String {
    let hand = hand();
    let mut text =
        format!("[[motion]]\nprofile = \"trapezoid\"\nspeed = {speed}\n{guard}\n[motion.{key}]\n");
    for (finger, joints) in hand.fingers.iter().zip(joints) {
        for (joint, at) in finger.joints.iter().zip(joints) {
            writeln!(text, "\"{}.{}\" = {at:?}", finger.name, joint.name).unwrap();
        }
    }
    text
}

/// The same as motions of each finger, beside one another.
fn motions(speed: &str, guard: &str, key: &str, joints: Posture) -> String {
    let whole = motion(speed, &format!("begin = \"beside\"\n{guard}"), key, joints);
    let (head, joints) = whole.split_once(&format!("[motion.{key}]\n")).unwrap();
    let joints: Vec<&str> = joints.lines().collect();
    let of_finger = joints.chunks(JOINTS).map(|joints| {
        let joints = joints.join("\n");
        format!("{head}[motion.{key}]\n{joints}\n")
    });
    of_finger.collect()
}

/// Back by a tenth of a radian of each middle joint.
const BACK: Posture = [[0.0, 0.0, -0.1, 0.0]; FINGERS];

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

/// How many of a finger's set-points from a tick on differ from those before, until they have been the same
/// for eight ticks; and the set-points then.
fn stops_after(seen: &Seen, finger: usize, from: usize) -> (usize, [f64; JOINTS]) {
    let mut last = from - 1;
    let mut count = 0;
    for tick in from..seen.targets.len() {
        if tick > last + 8 {
            break;
        }
        if seen.targets[tick][finger] != seen.targets[tick - 1][finger] {
            last = tick;
            count += 1;
        }
    }
    (count, seen.targets[last][finger])
}

/// Checks that no set-point jumps: that none changes by more than its limit of velocity allows.
fn is_continuous(seen: &Seen) {
    let servo = largest_step(&seen.targets);
    let master = largest_step(&seen.wanted);
    println!("at most {servo} rad in a tick of the servos, {master} in one of the master");
    // The variables of a loop have 24 bits.
    assert!(servo < 1.001 * VELOCITY * SERVO_S, "{servo} rad");
    assert!(master < 1.001 * VELOCITY * MASTER_S, "{master} rad");
}

#[test]
fn in_the_shipped_motion_each_finger_stops_when_it_feels_the_ball() {
    run(|typist| {
        typist.reaches_for_a_ball();
        typist.does("ball");
        assert_eq!(typist.truth().touching, 0);
        typist.runs("touch");
        for finger in ["index", "middle", "ring", "thumb"] {
            let said = format!(" N at {finger} has stopped a motion\n");
            assert!(typist.shown.contains(&said), "{finger}: {}", typist.shown);
        }
    });
}

#[test]
fn a_contact_stops_the_set_points_of_its_finger_within_three_ticks_at_any_speed() {
    for speed in ["0.1", "0.3", "1.0"] {
        run(|typist| {
            around_the_ball(typist);
            let guard = "stop = { contact = true }";
            let close = motions(speed, guard, "to", apart(CLOSED_M));
            typist.writes("close", &[close, motion(speed, "", "by", BACK)].concat());
            let seen = watched(typist, "close");
            for (finger, entry) in hand().fingers.iter().enumerate() {
                let name = &entry.name;
                let said = format!(" N at {name} has stopped a motion");
                if !seen.shown.contains(&said) {
                    // The shorter ways of index and ring may be over before they touch.
                    assert!(matches!(finger, 0 | 2), "{}", seen.shown);
                    continue;
                }
                let touched = seen.touched[finger].expect("it touches what stops it");
                let [before, at] =
                    [touched - 2, touched - 1].map(|tick| seen.targets[tick][finger]);
                assert_ne!(before, at, "{name} did not move when it touched");
                let (ticks, rest) = stops_after(&seen, finger, touched);
                println!("{speed} {name}: {ticks} ticks after the contact, at {rest:?} rad");
                assert!(ticks <= 3, "{speed} {name}: {ticks} ticks");
                // The next motion begins there.
                let end = seen.targets.last().unwrap()[finger];
                let wanted = seen.wanted.last().unwrap()[finger];
                for (joint, by) in BACK[finger].iter().enumerate() {
                    let (end, begin) = (end[joint], rest[joint]);
                    assert!((end - (begin + by)).abs() < 1e-6, "{end} from {begin}");
                    assert!((end - wanted[joint]).abs() < 1e-6, "{end}, {wanted:?}");
                }
            }
            is_continuous(&seen);
            assert!(!typist.says("status").contains("fault"));
        });
    }
}

/// Closes the fingers slowly on the ball until a guard holds; gives the line that says so.
fn closes(guard: &str) -> String {
    run(|typist| {
        around_the_ball(typist);
        let close = motion("0.02", guard, "to", apart(CLOSED_M));
        typist.writes("close", &[close, motion("0.02", "", "by", BACK)].concat());
        let seen = watched(typist, "close");
        let closed = apart(CLOSED_M);
        for finger in [1, 3] {
            // Opposed, they press on the ball, and do not come to their targets in it.
            let proximal = seen.targets.iter().map(|posture| posture[finger][1]);
            let farthest = proximal.fold(f64::MIN, f64::max);
            let target = closed[finger][1];
            assert!(farthest < target - 1e-3, "{farthest} of {target}");
        }
        is_continuous(&seen);
        assert!(!typist.says("status").contains("fault"));
        let line = seen.shown.lines().find(|line| line.contains("has stopped"));
        line.unwrap_or_else(|| panic!("{}", seen.shown)).to_owned()
    })
}

/// What a line says to have been measured, and where.
fn measured<'l>(line: &'l str, what: &str, unit: &str) -> (f64, &'l str) {
    println!("{line}");
    let value = line.strip_prefix(what).expect(line);
    let (value, at) = value.split_once(unit).expect(line);
    (
        value.parse().unwrap(),
        at.strip_suffix(" has stopped a motion").unwrap(),
    )
}

#[test]
fn a_torque_stops_a_motion() {
    let line = closes("stop = { torque = 0.075 }");
    let (value, at) = measured(&line, "a torque of ", " N m at ");
    assert!((0.075..0.09).contains(&value), "{line}");
    assert!(at.contains('.'), "{line}");
}

#[test]
fn an_effort_stops_a_motion() {
    let line = closes("stop = { effort = 9.8 }");
    let (value, at) = measured(&line, "an effort of ", " at ");
    assert!((9.8..11.0).contains(&value), "{line}");
    assert!(at.contains('.'), "{line}");
}

#[test]
fn a_contact_begins_a_motion() {
    run(|typist| {
        around_the_ball(typist);
        let close = motion("0.05", "", "to", apart(CLOSED_M));
        let back = "begin = \"now\"\nstart = { contact = true }";
        typist.writes("touch", &[close, motion("0.05", back, "by", BACK)].concat());
        let seen = watched(typist, "touch");
        let first = seen.touched.iter().flatten().min().copied().unwrap();
        for finger in 0..FINGERS {
            let at = |tick: usize| seen.targets[tick][finger][2];
            // Until two ticks of the master after the first of them touches, and back from there.
            let end = at(seen.targets.len() - 1);
            let turns = (first..first + 24).map(|tick| at(tick) - 0.1 - end);
            let nearest = turns.map(f64::abs).fold(f64::MAX, f64::min);
            assert!(nearest < 5e-3, "{} to {end}", at(first));
        }
        is_continuous(&seen);
    });
}

#[test]
fn a_guard_of_contact_needs_a_sensor() {
    let mut hand = hand();
    hand.fingers[2].touch = None;
    run_with(&hand, |typist| {
        typist.begin();
        typist.types("enable");
        typist.wait(2.0);
        typist.writes(
            "close",
            &motion("0.1", "stop = { contact = true }", "to", apart(APART_M)),
        );
        assert!(typist.says("run close").contains("no tactile sensor"));
        typist.writes(
            "close",
            &motion("0.1", "stop = { torque = 5.0 }", "to", apart(APART_M)),
        );
        typist.runs("close");
    });
}

#[test]
fn a_new_incarnation_of_the_master_is_not_held_by_the_stops_of_the_last() {
    run(|typist| {
        around_the_ball(typist);
        let guard = "stop = { contact = true }";
        typist.writes("close", &motion("0.1", guard, "to", apart(CLOSED_M)));
        let seen = watched(typist, "close");
        assert!(seen.shown.contains("has stopped"), "{}", seen.shown);
        typist.does("ball none");
        typist.restart(MASTER);
        typist.begin();
        typist.types("enable");
        typist.wait(4.0);
        typist.shown.clear();
        // The first motions of this incarnation have the numbers of those of the last.
        for _ in 0..3 {
            typist.runs("open");
            assert!(!typist.shown.contains("stopped"), "{}", typist.shown);
        }
    });
}
