//! Lines and arcs of tips in the texts of motions.

use std::fmt::Write as _;

use condor_hand::config::{Finger, Hand};
use condor_hand::kinematics::Kinematics;
use condor_hand::math::{clamp, max};
use condor_hand::trajectory::{
    CartesianPath, Generator, Guards, Observations, Primitive, Profile, Target,
};
use condor_hand::{Pose, rotation_about, rotation_vector};
use nalgebra::{SVector, Vector3};
use proptest::prelude::*;

type UtahMit = Hand<4, 4, 8>;
/// An arm of seven joints.
type Arm = Hand<1, 7, 7>;

/// The index finger is bent.
const BENT: &str = r#"
[[motion]]
profile = "minimum-jerk"
duration = 0.5
to = { "index.abduction" = 0.0, "index.proximal" = 0.5, "index.middle" = 0.7, "index.distal" = 0.5 }
"#;
const LINE: &str = r#"
[[motion]]
speed = 0.2
line = { finger = "index", by = [0.0, 0.01, 0.015] }
"#;

fn utah_mit() -> UtahMit {
    UtahMit::from_toml(
        include_str!("../../../hands/utah-mit.toml"),
        "utah-mit.toml",
    )
    .unwrap()
}

/// An arm whose joints roll and pitch in turn.
fn arm() -> Arm {
    let mut text = String::from(
        r#"
name = "arm"
servo_hz = 500
trajectory_hz = 100
gravity = [0.0, 0.0, -9.81]
faults = { safe_s = 0.5, stale_s = 0.06, effort_samples = 20, sensor_samples = 40, lost_samples = 5, frozen_rad = 0.02, tracking_rad = 0.1, tracking_samples = 50, overtravel_rad = 0.05, missed_deadlines = 6 }
processors = [
    { number = 0, kind = "master", loop_us = 4000.0, budget = 0.8 },
    { number = 1, kind = "servo", loop_us = 150.0, joint_us = 100.0, budget = 0.8 },
]
[joint_defaults]
processor = 1
limits = { low = -2.5, high = 2.5, velocity = 2.0, acceleration = 8.0 }
servo = { law = "decoupled", bandwidth_hz = 4.0, zeta = 1.0, velocity_cutoff_hz = 60.0 }
stop = { zone = 0.05, bandwidth_hz = 4.0, damping_ratio = 1.0 }
friction = { armature = 0.1 }
[actuator_defaults]
limits = { low = -200.0, high = 200.0 }
pole_hz = 150.0
[[fingers]]
name = "arm"
base = {}
form = { chain = { tip = [0.0, 0.0, 0.1] } }
"#,
    );
    for joint in 0..7 {
        writeln!(
            text,
            "[[fingers.actuators]]\nname = \"m{joint}\"\narms = {{ j{joint} = 1.0 }}\n\
             dac = {{ board = 0, channel = {joint}, bits = 16, gain = 100.0, offset = 32768.0 }}"
        )
        .unwrap();
    }
    for (joint, height) in [0.3, 0.0, 0.2, 0.2, 0.2, 0.2, 0.1].into_iter().enumerate() {
        let axis = if joint % 2 == 0 {
            "[0.0, 0.0, 1.0]"
        } else {
            "[0.0, 1.0, 0.0]"
        };
        writeln!(
            text,
            "[[fingers.joints]]\nname = \"j{joint}\"\n\
             mount = {{ position = [0.0, 0.0, {height:?}], motion = {{ revolute = {axis} }} }}\n\
             adc = {{ board = 1, channel = {joint}, bits = 16, gain = 1e-4, offset = -3.2768 }}"
        )
        .unwrap();
    }
    Arm::from_toml(&text, "arm.toml").unwrap()
}

/// The arm is bent.
const ARM_BENT: &str = r#"
[[motion]]
profile = "minimum-jerk"
duration = 2.0
to = { "arm.j0" = 0.0, "arm.j1" = 0.3, "arm.j2" = 0.0, "arm.j3" = 1.2, "arm.j4" = 0.0, "arm.j5" = 0.8, "arm.j6" = 0.0 }
"#;

fn index(text: &str) -> Result<Vec<Primitive<16>>, String> {
    let read = utah_mit().motions(text, "draw.toml");
    read.map_err(|error| error.to_string())
}

/// Makes the set-points of a hand for a sequence of motions that begins with its joints at 0, and calls `see` with the
/// tip of its first finger in each tick.
fn run<const F: usize, const N: usize, const A: usize, const J: usize>(
    hand: &Hand<F, N, A>,
    motions: Vec<Primitive<J>>,
    mut see: impl FnMut(usize, &Pose),
) {
    let chain = hand.fingers[0].chain();
    let limits: Vec<_> = hand.trajectory_limits().collect();
    let tick = 1.0 / f64::from(hand.trajectory_hz);
    let mut generator = Generator::<J, 8>::new(limits.try_into().unwrap(), [0.0; J], tick).unwrap();
    for (step, motion) in motions.into_iter().enumerate() {
        generator.enqueue(motion).unwrap();
        while !generator.is_idle() {
            let points = generator.tick(&Observations::none());
            let q = SVector::from_fn(|joint, _| points[joint].position);
            see(step, &chain.tip(&q));
        }
    }
}

/// The posture at which a motion ends.
fn end<const N: usize, const A: usize, const J: usize>(
    finger: &Finger<N, A>,
    motion: &Primitive<J>,
) -> Pose {
    let position = |joint: usize| match motion.targets[joint] {
        Target::Absolute(position) => position,
        Target::Relative(_) => panic!("joint {joint} has no position"),
    };
    finger
        .chain()
        .tip(&SVector::from_fn(|joint, _| position(joint)))
}

fn off(path: &CartesianPath, tip: &Pose) -> f64 {
    let all = (0..=2000).map(|part| path.at(f64::from(part) / 2000.0).position);
    let distances = all.map(|point| (point - tip.position).norm());
    distances.fold(f64::INFINITY, f64::min)
}

#[test]
fn a_tip_goes_along_a_line_and_an_arc() {
    let hand = utah_mit();
    let finger = &hand.fingers[0];
    let bent = index(BENT).unwrap();
    let start = end(finger, &bent[0]);
    let to = start.position + Vector3::new(0.0, 0.01, 0.015);
    let back = start.position;
    let through = start.position + Vector3::new(0.0, -0.005, 0.01);
    let text = format!(
        "{BENT}{LINE}[[motion]]\nduration = 0.8\nstop = {{ contact = true }}\narc = {{ finger = \"index\", through = {:?}, to = \
         {:?} }}\n",
        through.as_slice(),
        back.as_slice()
    );
    let motions = index(&text).unwrap();
    for motion in &motions[1..] {
        assert_eq!((motion.mask, motion.profile), (0b1111, Profile::Cubic));
        assert_eq!(motion.vias.len(), 16);
    }
    assert_eq!(
        motions[2].stop,
        Guards {
            contact: true,
            ..Guards::none()
        }
    );
    let line = CartesianPath::line(
        &start,
        &Pose {
            position: to,
            ..start
        },
    )
    .unwrap();
    let there = Pose {
        position: to,
        ..start
    };
    let arc = CartesianPath::arc(&there, &through, &start).unwrap();
    let (mut most, mut ends, mut by_via) = (0.0, [start; 3], f64::INFINITY);
    run(&hand, motions, |step, tip| {
        match step {
            1 => most = max(most, off(&line, tip)),
            2 => {
                most = max(most, off(&arc, tip));
                by_via = by_via.min((tip.position - through).norm());
            }
            _ => {}
        }
        ends[step] = *tip;
    });
    // The points to which a tip is compared are up to 0.01 mm apart.
    assert!(most <= 1e-4, "{most}");
    assert!(by_via <= 1e-3, "{by_via}");
    assert!((ends[1].position - to).norm() <= 1e-8);
    assert!((ends[2].position - back).norm() <= 1e-8);
}

#[test]
fn an_arm_of_seven_joints_keeps_its_orientation_unless_the_text_says_otherwise() {
    let hand = arm();
    let read = |line: &str| {
        let text = format!(
            "{ARM_BENT}[[motion]]\nduration = 3.0\nline = {{ finger = \"arm\", {line} }}\n"
        );
        let motions = hand.motions::<7>(&text, "draw.toml");
        motions.map_err(|error| error.to_string())
    };
    let by = "by = [0.05, 0.2, 0.0]";
    let kept = read(by).unwrap();
    let start = end(&hand.fingers[0], &kept[0]);
    let turned = |tip: &Pose| rotation_vector(&(tip.rotation * start.rotation.transpose())).norm();
    run(&hand, kept.clone(), |step, tip| {
        assert!(step == 0 || turned(tip) <= 1e-2, "{}", turned(tip));
    });
    assert_eq!(
        read(&format!("{by}, orientation = \"keep\"")).unwrap(),
        kept
    );
    let free = read(&format!("{by}, orientation = \"free\"")).unwrap();
    assert!(turned(&end(&hand.fingers[0], &free[1])) > 0.05);
    // The end may have another orientation, here in the axes of the palm.
    let rotation = rotation_about(&Vector3::y(), 2.0);
    let other = read(&format!("{by}, rotation = {{ rpy = [0.0, 2.0, 0.0] }}")).unwrap();
    let tip = end(&hand.fingers[0], &other[1]);
    assert!((tip.rotation - rotation).amax() <= 1e-8, "{tip:?}");
    let both = read(&format!(
        "{by}, orientation = \"free\", rotation = \"none\""
    ))
    .unwrap_err();
    assert!(
        both.contains("a free orientation has no `rotation`"),
        "{both}"
    );
    let skew = read(&format!(
        "{by}, rotation = {{ rows = [[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 1.0]] }}"
    ));
    assert!(skew.is_err());
}

#[test]
fn a_path_begins_where_the_steps_before_it_end() {
    let by = "[[motion]]\nprofile = \"cubic\"\nduration = 0.5\nby = { \"index.proximal\" = 0.1 }\n";
    let end_of = |motions: &[Primitive<16>]| match motions.last().unwrap().targets[1] {
        Target::Absolute(position) => position,
        Target::Relative(by) => panic!("{by}"),
    };
    let still = LINE.replace("[0.0, 0.01, 0.015]", "[0.0, 0.0, 0.0]");
    let plain = index(&format!("{BENT}{still}")).unwrap();
    assert!((end_of(&plain) - 0.5).abs() < 1e-12);
    let moved = index(&format!("{BENT}{by}{still}")).unwrap();
    assert!((end_of(&moved) - 0.6).abs() < 1e-12);
    // The master keeps joints out of the zones of their soft stops, here of three degrees.
    let high = utah_mit().fingers[0].joints[1].limits.high;
    let far = BENT.replace(
        "\"index.proximal\" = 0.5",
        &format!("\"index.proximal\" = {high}"),
    );
    let rested = index(&format!("{far}{still}")).unwrap();
    assert!((end_of(&rested) - (high - 3_f64.to_radians())).abs() < 1e-6);

    // Each of these leaves the joint at a place that the text does not tell.
    let named = "the path begins wherever step 2 leaves \"index.proximal\"";
    for open in [
        by.replace("by =", "begin = \"now\"\nby ="),
        by.replace("by =", "blend = 0.1\nby ="),
        by.replace("by =", "stop = { contact = true }\nto ="),
        by.replace("by =", "stop = { time = 0.1 }\nby ="),
    ] {
        let error = index(&format!("{BENT}{open}{LINE}")).unwrap_err();
        assert!(error.starts_with("draw.toml:14:8: "), "{error}");
        assert!(error.contains(named), "{error}");
        assert!(
            error.contains("name the joint in `to` of a step between"),
            "{error}"
        );
        // Then it is known again.
        let between = by.replace("by =", "to =").replace("0.1", "0.5");
        index(&format!("{BENT}{open}{between}{LINE}")).unwrap();
    }
    // The stop of a path is one, too.
    let stopped = LINE.replace("speed", "stop.torque = 0.1\nspeed");
    assert!(
        index(&format!("{BENT}{stopped}{LINE}"))
            .unwrap_err()
            .contains("wherever step 2")
    );
}

/// Checks that a text in which `from` is replaced is refused at the line of the path, or of the step, with these words.
fn refused(at_path: bool, cases: &[(&str, &str, &str)]) {
    let text = format!("{BENT}{LINE}");
    for (from, to, says) in cases {
        let wrong = text.replacen(from, to, 1);
        assert_ne!(wrong, text, "{from}");
        let error = index(&wrong).unwrap_err();
        let line = if at_path {
            9 + to.matches('\n').count()
        } else {
            7
        };
        assert!(
            error.starts_with(&format!("draw.toml:{line}:")),
            "{to}: {error}"
        );
        assert!(error.contains(says), "{to}: {error}");
    }
}

#[test]
fn a_mistake_in_a_path_has_its_place_and_a_remedy() {
    let by = "by = [0.0, 0.01, 0.015]";
    let refused = |cases: &[(&str, &str)]| {
        let cases: Vec<_> = cases.iter().map(|&(to, says)| (by, to, says)).collect();
        refused(true, &cases);
    };
    refused(&[
        ("", "no end: give `to` or `by`, in m"),
        (
            "by = [0.0, 0.0, 0.0], to = [0.1, 0.0, 0.0]",
            "give either `to` or `by`",
        ),
        ("by = [0.0, 0.01]", "the list must have 3 entries, not 2"),
        ("by = [0.0, nan, 0.0]", "is NaN; it must be finite"),
        ("to = [0.0, inf, 0.0]", "is inf; it must be finite"),
        ("by = [0.5, 0.0, 0.0]", "index: at 0."),
        (
            "by = [0.5, 0.0, 0.0]",
            "index.middle is at its lower limit, which keeps the tip",
        ),
        (
            "by = [0.0, 0.3, 0.0]",
            "index.abduction is at its upper limit",
        ),
        (
            "by = [0.0, 0.3, 0.0]",
            "start from another posture, or move the path",
        ),
    ]);
    let with = |more: &str| format!("{by}, {more}");
    refused(&[
        (
            &with("deviation = 1e-12"),
            "divide the path, or permit more by `deviation`",
        ),
        (
            &with("deviation = -1.0"),
            "index: the distance that is permitted, m, is -1",
        ),
        (&with("orientation = \"kept\""), "did you mean `keep`?"),
        (
            &with("orientation = \"keep\""),
            "or let it turn by `orientation = \"free\"`",
        ),
        (&with("via = [0.0, 0.0, 0.0]"), "there is no key `via` here"),
    ]);
}

#[test]
fn a_mistake_in_the_step_of_a_path_has_its_place_and_a_remedy() {
    let (finger, speed) = ("finger = \"index\", ", "speed = 0.2");
    refused(
        true,
        &[
            (
                "\"index\"",
                "\"indx\"",
                "no finger is called `indx`; did you mean `index`?",
            ),
            (finger, "", "the key `finger` is missing here"),
            (
                speed,
                "duration = 0.01",
                "give a longer `duration`, or a `speed`",
            ),
            (
                "\"index.middle\" = 0.7, ",
                "",
                "no step before says where \"index.middle\" is: name it in `to` of one",
            ),
        ],
    );
    let arc = "speed = 0.2\narc = { finger = \"index\", through = [0, 0, 0], to = [0, 0, 0] }";
    refused(
        false,
        &[
            (speed, "speed = 1.5", "must be at most 1"),
            (speed, "", "no pace"),
            (
                speed,
                "speed = 0.2\nprofile = \"trapezoid\"",
                "leave out `profile`",
            ),
            (speed, "speed = 0.2\nblend = 0.1", "leave out `blend`"),
            (
                speed,
                "speed = 0.2\nbegin = \"now\"",
                "begin `after` or `beside`",
            ),
            (
                speed,
                "speed = 0.2\nto = { \"thumb.distal\" = 0.1 }",
                "a step of its own",
            ),
            (speed, arc, "either `line` or `arc`"),
        ],
    );
    // Joints alone have no tip.
    let names = ["index.abduction"];
    let error = condor_hand::trajectory::motion::load::<1>(LINE, "draw.toml", &names).unwrap_err();
    assert!(error.problem.contains("no finger is known here"), "{error}");
}

#[test]
fn an_arc_needs_three_points_of_a_circle() {
    let hand = utah_mit();
    let start = end(&hand.fingers[0], &index(BENT).unwrap()[0]).position;
    let arc = |through: Vector3<f64>, to: Vector3<f64>| {
        let (through, to) = (through.as_slice(), to.as_slice());
        let path = format!("finger = \"index\", through = {through:?}, to = {to:?}");
        let path = path.replace("NaN", "nan");
        index(&format!(
            "{BENT}[[motion]]\nspeed = 0.2\narc = {{ {path} }}\n"
        ))
    };
    let (aside, to) = (
        Vector3::new(0.0, 0.003, 0.005),
        Vector3::new(0.0, 0.0, 0.01),
    );
    arc(start + aside, start + to).unwrap();
    for (through, to) in [
        (start + to * 0.5, start + to),
        (start + aside, start),
        (start, start + to),
        (start, start),
    ] {
        let error = arc(through, to).unwrap_err();
        assert!(error.starts_with("draw.toml:8:7: index: "), "{error}");
        assert!(
            error.contains("are on a line, or two of them are the same"),
            "{error}"
        );
        assert!(
            error.contains("move `through` aside, or give a `line`"),
            "{error}"
        );
    }
    let error = arc(Vector3::repeat(f64::NAN), start + to).unwrap_err();
    assert!(error.contains("is NaN; it must be finite"), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn tips_keep_to_their_lines(
        posture in (-0.2..0.2, 0.2..1.0, 0.2..1.2, 0.2..1.0),
        by in (-0.03..0.03, -0.02..0.02, -0.03..0.03),
    ) {
        let hand = utah_mit();
        let finger = &hand.fingers[0];
        let (a, b, c, d) = posture;
        let text = format!(
            "[[motion]]\nprofile = \"cubic\"\nduration = 1.0\nto = {{ \"index.abduction\" = {a}, \"index.proximal\" = {b}, \
             \"index.middle\" = {c}, \"index.distal\" = {d} }}\n\
             [[motion]]\nspeed = 0.3\nline = {{ finger = \"index\", by = [{}, {}, {}], deviation = 2e-4 }}\n",
            by.0, by.1, by.2
        );
        match index(&text) {
            Err(error) => {
                prop_assert!(error.starts_with("draw.toml:7:8: index: at "), "{}", error);
                prop_assert!(!error.contains("joint 0"), "{}", error);
            }
            Ok(motions) => {
                let start = end(finger, &motions[0]).position;
                let way = Vector3::new(by.0, by.1, by.2);
                let mut most = 0.0;
                run(&hand, motions, |step, tip| {
                    if step == 1 {
                        let gone = tip.position - start;
                        let share = clamp(gone.dot(&way) / way.norm_squared(), 0.0, 1.0);
                        most = max(most, (gone - way * share).norm());
                    }
                });
                // Between the points at which a path is compared there may be a little more.
                prop_assert!(most <= 2.1e-4, "{}", most);
            }
        }
    }
}
