//! Postures, reach, collisions and plans, against condor-hand and against sums by hand.

#![allow(
    clippy::float_cmp,
    reason = "limits, and what stays, are met to the last bit"
)]

use condor_hand::config::{Hand, LinkBody, Shape};
use condor_hand::dynamics::Dynamics;
use condor_hand::kinematics::Kinematics;
use condor_host::robot::{Robot, Simulator, What};
use condor_scene::HandView;
use nalgebra::{SVector, Vector3, Vector4};
use proptest::prelude::*;

use crate::{UtahMit, gripper, utah_mit, with_motors};

/// The tip of a finger, as the kinematics say.
fn tip(hand: &UtahMit, finger: usize, positions: &[f64]) -> Vector3<f64> {
    let own = SVector::<f64, 4>::from_column_slice(&positions[4 * finger..4 * finger + 4]);
    hand.fingers[finger].chain().tip(&own).position
}

/// Positions from shares of the ranges of all joints.
fn within(view: &impl Robot, shares: &[f64]) -> Vec<f64> {
    let joints = view.joints().iter().zip(shares);
    joints
        .map(|(joint, share)| joint.limits[0] + share * (joint.limits[1] - joint.limits[0]))
        .collect()
}

fn shares() -> impl Strategy<Value = Vec<f64>> {
    proptest::collection::vec(0.0..=1.0_f64, 16)
}

#[test]
fn a_joint_stops_at_its_limit_which_is_named() {
    let view = HandView::new(&utah_mit());
    let mut positions = within(&view, &[0.5; 16]);
    assert_eq!(view.moved(&positions).positions, positions);
    assert_eq!(view.moved(&positions).held, []);
    positions[6] = 9.0;
    positions[12] = -9.0;
    let moved = view.moved(&positions);
    let limits = |joint: usize| view.joints()[joint].limits;
    let held: Vec<_> = moved
        .held
        .iter()
        .map(|it| (it.joint.as_str(), it.limit))
        .collect();
    let expected = [
        ("middle.middle", limits(6)[1]),
        ("thumb.abduction", limits(12)[0]),
    ];
    assert_eq!(held, expected);
    assert_eq!(moved.positions[6], limits(6)[1]);
    assert_eq!(moved.positions[5], positions[5]);
    // What is missing or no number is 0, or the limit next to it.
    let open = view.moved(&[f64::NAN]);
    assert_eq!((open.positions[0], open.positions[2]), (0.0, limits(2)[0]));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn every_point_that_a_planar_finger_reaches_is_reached(to in shares(), from in shares()) {
        let hand = utah_mit();
        let view = HandView::new(&hand);
        let (to, from) = (within(&view, &to), within(&view, &from));
        for (finger, entry) in hand.fingers.iter().enumerate() {
            let target = tip(&hand, finger, &to);
            let dragged = view.dragged(&from, &format!("{}.tip", entry.name), target.into()).unwrap();
            prop_assert!(dragged.is_reached, "{}: {dragged:?}", entry.name);
            prop_assert!((tip(&hand, finger, &dragged.positions) - target).norm() < 1e-6);
            prop_assert_eq!(&view.moved(&dragged.positions).positions, &dragged.positions);
            prop_assert_eq!(&dragged.held, &[]);
            // The other fingers stay.
            let others = (0..16).filter(|joint| joint / 4 != finger);
            for joint in others {
                prop_assert_eq!(dragged.positions[joint], from[joint]);
            }
        }
    }

    #[test]
    fn what_a_drag_says_of_any_mechanism_is_true(
        shares in shares(),
        step in proptest::array::uniform3(-0.3..0.3_f64),
        link in 0_usize..5,
    ) {
        for make in [utah_mit, gripper] {
            let hand = make();
            let view = HandView::new(&hand);
            let from = within(&view, &shares);
            let frames = view.frames(&from);
            let name = &frames[link].name;
            let at = |positions: &[f64]| {
                let own = SVector::<f64, 4>::from_column_slice(&positions[..4]);
                let chain = hand.fingers[0].chain();
                if link == 4 { chain.tip(&own).position } else { chain.up_to(link).tip(&own).position }
            };
            let target = at(&from) + Vector3::from(step);
            let dragged = view.dragged(&from, name, target.into()).unwrap();
            let distance = (at(&dragged.positions) - target).norm();
            prop_assert!((distance - dragged.distance_m).abs() < 1e-12);
            prop_assert!(distance <= step.iter().map(|it| it * it).sum::<f64>().sqrt() + 1e-12);
            prop_assert_eq!(dragged.is_reached, distance <= 1e-6);
            prop_assert_eq!(&view.moved(&dragged.positions).positions, &dragged.positions);
            for held in &dragged.held {
                let joint = view.joints().iter().position(|it| it.name == held.joint).unwrap();
                prop_assert_eq!(dragged.positions[joint], held.limit);
            }
        }
    }
}

#[test]
fn a_finger_points_to_what_it_cannot_reach_and_limits_hold_it() {
    let hand = utah_mit();
    let view = HandView::new(&hand);
    let open = view.moved(&[]).positions;
    // Far ahead and a little up, where the least flexions hold the finger.
    let base = Vector3::from(hand.fingers[0].base.position);
    let far = base + Vector3::new(0.3, 0.0, 0.0);
    let dragged = view.dragged(&open, "index.tip", far.into()).unwrap();
    assert!(!dragged.is_reached);
    let names: Vec<_> = dragged.held.iter().map(|it| it.joint.as_str()).collect();
    assert_eq!(names, ["index.middle", "index.distal"]);
    // No posture of a fine grid is nearer.
    let limits = hand.fingers[0].limits();
    let mut best = f64::INFINITY;
    for number in 0..21_u32.pow(3) {
        let share = |digit: u32| f64::from(number / 21_u32.pow(digit) % 21) / 20.0;
        let q = Vector4::new(0.0, share(0), share(1), share(2));
        let range = limits.high - limits.low;
        let mut q = limits.low + range.component_mul(&q);
        q.x = 0.0;
        best = best.min((hand.fingers[0].chain().tip(&q).position - far).norm());
    }
    assert!(
        dragged.distance_m <= best + 1e-9,
        "{} {best}",
        dragged.distance_m
    );
    assert!(dragged.distance_m > best - 1e-3);
}

#[test]
fn what_cannot_be_dragged_is_named() {
    let view = HandView::new(&utah_mit());
    let error = |frame: &str, to| view.dragged(&[], frame, to).unwrap_err().to_string();
    assert!(error("index.tp", [0.0; 3]).contains("index.tp"));
    assert!(error("index.tip", [0.0, f64::NAN, 0.0]).contains("NaN"));
    assert!(error("index.tip", [0.0, 0.0, 1e200]).contains("up to 1000 m"));
}

/// The hand with straight fingers as capsules of the radius r: those beside each other are 27 mm apart.
#[test]
fn fingers_side_by_side_are_as_near_as_their_bases_less_their_thickness() {
    let mut hand = utah_mit();
    let gap = |hand: &UtahMit, positions: &[f64]| {
        let all = HandView::new(hand).clearances(positions);
        let found = all
            .iter()
            .find(|it| it.parts[0].starts_with("index") && it.parts[1].starts_with("middle"));
        found.unwrap().clone()
    };
    // Cuboids of 18 by 20 mm across.
    let clearance = gap(&hand, &[0.0; 16]);
    assert!(
        (clearance.distance_m - (0.027 - 0.020)).abs() < 1e-12,
        "{clearance:?}"
    );
    let [[x1, y1, _], [x2, y2, _]] = clearance.points;
    assert!((x1 - x2).abs() < 1e-12 && (y1 - y2 - 0.027).abs() < 1e-12);
    // Turned towards each other by equal angles: their tips meet first.
    let (turn, mut positions) = (0.1_f64, [0.0; 16]);
    (positions[0], positions[4]) = (-turn, turn);
    let clearance = gap(&hand, &positions);
    let length = 0.0095 + 0.0432 + 0.0330 + 0.0241;
    let expected = 0.027 - 2.0 * (length - 0.010) * turn.sin() - 0.020;
    assert!(
        (clearance.distance_m - expected).abs() < 1e-12,
        "{clearance:?} {expected}"
    );
    assert_eq!(clearance.parts, ["index.distal", "middle.distal"]);
    // Without a cuboid, a link is 8 mm thick to each side.
    for joint in hand
        .fingers
        .iter_mut()
        .flat_map(|finger| &mut finger.joints)
    {
        let body = joint.body.as_mut().unwrap();
        let moments = [1e-6; 3];
        let products = [0.0; 3];
        *body = LinkBody {
            shape: Shape::Inertia { moments, products },
            ..*body
        };
    }
    let clearance = gap(&hand, &[0.0; 16]);
    assert!(
        (clearance.distance_m - (0.027 - 0.016)).abs() < 1e-12,
        "{clearance:?}"
    );
}

#[test]
fn a_thumb_meets_the_palm_between_the_fingers() {
    let view = HandView::new(&utah_mit());
    let all = view.clearances(&[0.0; 16]);
    let palm: Vec<_> = all.iter().filter(|it| it.parts[0] == "palm").collect();
    // Index and middle, middle and ring, each with the two other fingers.
    let others: Vec<_> = palm
        .iter()
        .map(|it| it.parts[1].split('.').next().unwrap())
        .collect();
    assert_eq!(others, ["ring", "thumb", "index", "thumb"]);
    // The straight thumb is 125 mm below, at x from 45 mm on, and between index and middle.
    let thumb = palm[1];
    assert!(
        (thumb.distance_m - (0.125 - 0.008 - 0.010)).abs() < 1e-9,
        "{thumb:?}"
    );
}

const OPEN: &str = r#"
[[motion]]
profile = "minimum-jerk"
duration = 0.5
[motion.to]
"index.proximal" = 0.5
"#;

#[test]
fn a_plan_has_what_the_dynamics_say() {
    let hand = utah_mit();
    let view = HandView::new(&hand);
    let from = view.moved(&[]).positions;
    let plan = view.plan(&from, OPEN, "open").unwrap();
    assert_eq!(plan.period_s, 0.02);
    let index = &plan.joints[1];
    // The start, and the ticks of 0.5 s.
    assert_eq!(index.position.len(), 1 + 25);
    assert_eq!((index.position[0], index.position[25]), (0.0, 0.5));
    // 1.875 dx / T half-way, of which the ticks are 10 ms off.
    let peak = index
        .velocity
        .iter()
        .fold(0.0_f64, |peak, rate| peak.max(rate.abs()));
    assert!((peak - 1.875).abs() < 0.02, "{peak}");
    let at = |values: fn(&condor_host::robot::JointPlan) -> &Vec<f64>, tick: usize| {
        Vector4::from_fn(|joint, _| values(&plan.joints[joint])[tick])
    };
    let finger = &hand.fingers[0];
    let (planar, arms) = (finger.planar().unwrap(), finger.transmission().unwrap());
    for tick in [0, 7, 13, 25] {
        let (q, rate) = (at(|it| &it.position, tick), at(|it| &it.velocity, tick));
        let acceleration = at(|it| &it.acceleration, tick);
        let gravity = Vector3::from(hand.gravity);
        let links = planar.inverse_dynamics(&q, &rate, &acceleration, &gravity);
        let armature = finger.each(|joint| joint.friction.armature);
        let viscous = finger.each(|joint| joint.friction.viscous);
        let expected = links + armature.component_mul(&acceleration) + viscous.component_mul(&rate);
        let torque = at(|it| &it.torque, tick);
        assert!((torque - expected).amax() < 1e-12, "{torque} {expected}");
        // The tensions give that torque, within their limits.
        let tension = |number: usize| {
            let actuator = &plan.joints[number / 2].actuators[number % 2];
            let tension = actuator.effort[tick];
            assert!((4.0..=130.0).contains(&tension), "{tension}");
            tension
        };
        let given = arms.torque(&std::array::from_fn(tension));
        assert!((given - torque).amax() < 1e-12, "{given}");
    }
    assert_eq!((plan.overloads.len(), plan.events.len()), (0, 2));
    assert_eq!(plan.events[1].what, What::Reached);
    assert_eq!((plan.events[1].at_s, plan.events[1].step), (0.5, 1));
}

#[test]
fn weak_tendons_are_overloaded_where_and_when_the_motion_is_too_much() {
    let mut hand = utah_mit();
    for tendon in &mut hand.fingers[0].actuators {
        (tendon.limits.high, tendon.limits.bias) = (6.5, None);
    }
    let view = HandView::new(&hand);
    let from = view.moved(&[]).positions;
    let plan = view
        .plan(
            &from,
            &OPEN.replace("duration = 0.5", "duration = 0.2"),
            "open",
        )
        .unwrap();
    let proximal = plan
        .overloads
        .iter()
        .find(|it| it.joint == "index.proximal")
        .unwrap();
    let joint = &plan.joints[1];
    let most = joint.torque_limits[1];
    // The tendons of the two distal joints help.
    assert!((most - (0.0127 + 0.0095 + 0.008) * (6.5 - 4.0)).abs() < 1e-12);
    assert!(
        proximal.torque.abs() > proximal.possible.abs(),
        "{proximal:?}"
    );
    let tick = |at_s: f64| {
        let found = (0..joint.torque.len()).zip(0_u32..);
        let mut found = found.filter(|(_, number)| f64::from(*number) * plan.period_s == at_s);
        found.next().unwrap().0
    };
    for at_s in [proximal.from_s, proximal.to_s] {
        let tick = tick(at_s);
        let is_full = joint.actuators.iter().any(|it| it.effort[tick] == 6.5);
        assert!(is_full, "{at_s}");
    }
    assert!(
        plan.overloads
            .iter()
            .all(|it| it.joint.starts_with("index."))
    );
}

/// Each actuator is listed once, at the last joint that it moves.
#[test]
fn motors_have_the_efforts_of_their_torques_and_the_parts_of_their_limits() {
    let hand = with_motors();
    let view = HandView::new(&hand);
    let from = view.moved(&[]).positions;
    let plan = view.plan(&from, OPEN, "open").unwrap();
    let names = |joint: usize| {
        let actuators = plan.joints[joint].actuators.iter();
        actuators.map(|it| it.name.as_str()).collect::<Vec<_>>()
    };
    assert_eq!(names(0), ["index.spread"]);
    assert_eq!(names(1), ["index.bend"]);
    assert_eq!(names(2), ["index.curl"]);
    assert_eq!(names(3), ["index.assist", "index.nip"]);
    let [proximal, distal] = [1, 3].map(|joint| &plan.joints[joint]);
    let bend = &proximal.actuators[0];
    assert_eq!(bend.limits, [-0.125, 0.0625]);
    // An arm below 0 turns the limits.
    assert_eq!(proximal.torque_limits, [-30.0 * 0.0625, 30.0 * 0.125]);
    for (effort, torque) in bend.effort.iter().zip(&proximal.torque) {
        assert!((-30.0 * effort - torque).abs() < 1e-12);
    }
    // The two of the distal joint share its torque.
    let [assist, nip] = [0, 1].map(|it| &distal.actuators[it].effort);
    for ((assist, nip), torque) in assist.iter().zip(nip).zip(&distal.torque) {
        assert!((10.0 * assist + 15.0 * nip - torque).abs() < 1e-12);
        assert!((assist / 10.0 - nip / 15.0).abs() < 1e-12);
    }
    // Both hold their links up, the one of them with efforts above 0 and the other with those below it.
    for (joint, limit, sign) in [(1, 0.0625, 1.0), (2, -0.125, -1.0)] {
        let joint = &plan.joints[joint];
        let efforts = &joint.actuators[0].effort;
        assert!(efforts.iter().all(|it| it * sign > 0.0));
        let peaks = joint.peaks();
        let parts = efforts.iter().map(|it| it / limit);
        assert_eq!(peaks.effort, parts.reduce(f64::max));
        assert!((peaks.effort.unwrap() - peaks.torque).abs() < 1e-9);
    }
    assert!(plan.overloads.is_empty());
}

/// A joint that nothing moves is overloaded by any torque, to either side.
#[test]
fn a_joint_without_actuators_has_no_torque() {
    let mut hand = with_motors();
    hand.fingers[0].actuators.remove(0);
    let view = HandView::new(&hand);
    let from = view.moved(&[]).positions;
    let to = |position: f64| {
        let motion = OPEN.replace("proximal\" = 0.5", &format!("abduction\" = {position}"));
        view.plan(&from, &motion, "spread").unwrap()
    };
    for position in [0.2, -0.2] {
        let plan = to(position);
        let joint = &plan.joints[0];
        assert_eq!(joint.torque_limits, [0.0, 0.0]);
        assert!(joint.actuators.is_empty());
        let peaks = joint.peaks();
        assert_eq!((peaks.torque, peaks.effort), (f64::INFINITY, None));
        let overload = &plan.overloads[0];
        assert_eq!(
            (overload.joint.as_str(), overload.possible),
            ("index.abduction", 0.0)
        );
    }
}

#[test]
fn the_contents_of_a_text_become_the_same_text_again() {
    let view = HandView::new(&utah_mit());
    let text = include_str!("../../../../examples/utah-mit-hand/motions/wave.toml");
    let steps = view.steps(text, "wave").unwrap();
    assert_eq!(steps["motion"][1]["via"][0]["at"], 0.3);
    let written = view.text(&steps).unwrap();
    assert_eq!(view.steps(&written, "wave").unwrap(), steps);
    let from = view.moved(&[]).positions;
    let [first, second] = [text, &written].map(|text| view.plan(&from, text, "wave").unwrap());
    assert_eq!(first, second);
}

#[test]
fn the_tip_of_a_plan_follows_its_line() {
    let hand = utah_mit();
    let view = HandView::new(&hand);
    let from = view.moved(&[]).positions;
    let bent = OPEN.replace(
        "\"index.proximal\" = 0.5",
        "\"index.abduction\" = 0.0\n\"index.proximal\" = 0.5\n\"index.middle\" = 0.7\n\"index.distal\" = 0.5",
    );
    let by = Vector3::new(0.0, 0.01, 0.015);
    let line = "[[motion]]\nspeed = 0.2\nline = { finger = \"index\", by = [0.0, 0.01, 0.015] }\n";
    let text = format!("{bent}{line}");
    let plan = view.plan(&from, &text, "line").unwrap();
    let ticks = plan.joints[0].position.len();
    let tips: Vec<_> = (25..ticks)
        .map(|tick| {
            let joints = plan.joints.iter();
            let positions: Vec<_> = joints.map(|joint| joint.position[tick]).collect();
            tip(&hand, 0, &positions)
        })
        .collect();
    let (start, end) = (tips[0], tips[tips.len() - 1]);
    assert!((end - start - by).norm() < 1e-8);
    for tip in &tips {
        let gone = tip - start;
        let off = gone - by * (gone.dot(&by) / by.norm_squared());
        assert!(off.norm() < 1e-4, "{} m", off.norm());
    }
    // The steps of a page become the same text, and a path that cannot be is an error with its place.
    let steps = view.steps(&text, "line").unwrap();
    assert_eq!(steps["motion"][1]["line"]["finger"], "index");
    let written = view.text(&steps).unwrap();
    assert_eq!(view.plan(&from, &written, "line").unwrap(), plan);
    let far = text.replace("0.015]", "0.9]");
    let error = view.plan(&from, &far, "line.toml").unwrap_err().to_string();
    assert!(error.starts_with("line.toml:12:8: index: at "), "{error}");
}

#[test]
fn a_step_that_cannot_be_is_refused_with_its_joint_and_all_ends() {
    let view = HandView::new(&utah_mit());
    let from = view.moved(&[]).positions;
    let far = OPEN.replace("proximal\" = 0.5", "proximal\" = 7.5");
    let text = format!("{OPEN}{far}");
    let plan = view.plan(&from, &text, "far").unwrap();
    let refused = plan.events.iter().find_map(|it| match &it.what {
        What::Refused { reason } => Some((it.step, reason.as_str())),
        _ => None,
    });
    let (step, reason) = refused.unwrap();
    assert_eq!(step, 2);
    assert!(
        reason.contains("index.proximal") && reason.contains("7.5"),
        "{reason}"
    );
    assert_eq!(plan.joints[1].velocity.last(), Some(&0.0));
}

#[test]
fn a_step_that_waits_for_a_sensor_ends_the_plan() {
    let view = HandView::new(&utah_mit());
    let from = view.moved(&[]).positions;
    let text = format!(
        "{OPEN}{}",
        OPEN.replace("duration", "start = { contact = true }\nduration")
    );
    let plan = view.plan(&from, &text, "touch").unwrap();
    let last = plan.events.last().unwrap();
    assert_eq!((last.step, &last.what), (2, &What::Waits));
    // Its time lets it begin.
    let text = text.replace("contact = true", "contact = true, time = 0.2");
    let plan = view.plan(&from, &text, "touch").unwrap();
    assert_eq!(plan.events.last().unwrap().what, What::Reached);
    assert_eq!(plan.joints[1].position.len(), 1 + 25 + 10 + 25);
    // Somebody lets a motion go on that holds.
    let text = format!(
        "{}{OPEN}",
        OPEN.replace("duration", "on-end = \"hold\"\nduration")
    );
    let plan = view.plan(&from, &text, "hold").unwrap();
    assert!(
        plan.events
            .iter()
            .any(|it| it.what == What::Holds && it.step == 1)
    );
    assert_eq!(plan.events.last().unwrap().step, 2);
}

#[test]
fn mistakes_are_named_and_nothing_is_too_long() {
    let view = HandView::new(&utah_mit());
    let from = view.moved(&[]).positions;
    let error =
        |from: &[f64], text: &str| view.plan(from, text, "it.toml").unwrap_err().to_string();
    assert!(error(&from[..3], OPEN).contains("3 positions"));
    let mut nowhere = from.clone();
    nowhere[5] = f64::NAN;
    assert!(error(&nowhere, OPEN).contains("middle.proximal"));
    let typo = error(&from, &OPEN.replace("index.", "indx."));
    assert!(
        typo.contains("it.toml:6") && typo.contains("indx.proximal"),
        "{typo}"
    );
    let long = error(&from, &OPEN.replace("0.5\n[", "1e9\n["));
    assert!(long.contains("longer than 400 s"), "{long}");
    let nothing = view.plan(&from, "", "empty").unwrap();
    assert_eq!(nothing.joints[0].position, [from[0]]);
    for wrong in [
        "3",
        "{\"motion\": 3}",
        "{\"motion\": [{\"profile\": \"cubic\"}]}",
        "null",
    ] {
        assert!(
            view.text(&serde_json::from_str(wrong).unwrap()).is_err(),
            "{wrong}"
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn no_text_is_a_panic(text in ".{0,80}", lines in proptest::collection::vec(0_usize..12, 0..12)) {
        const LINES: [&str; 12] = [
            "[[motion]]", "[motion.to]", "[motion.by]", "profile = \"cubic\"", "duration = 1e-300",
            "duration = 0.1", "speed = 1e-9", "\"index.proximal\" = 1e308", "\"thumb.distal\" = 0.5",
            "[[motion.via]]", "at = 0.5", "joints = { \"thumb.distal\" = -1e300 }",
        ];
        let view = HandView::new(&utah_mit());
        let from = view.moved(&[]).positions;
        let lines: Vec<_> = lines.into_iter().map(|line| LINES[line]).collect();
        for text in [text, lines.join("\n")] {
            let _ = view.plan(&from, &text, "any");
            if let Ok(steps) = view.steps(&text, "any") {
                prop_assert!(view.text(&steps).is_ok());
            }
        }
    }
}

/// A hand of three fingers of three joints, in room for more, at another rate.
#[test]
fn a_hand_with_fewer_fingers_and_joints_is_simulated_alike() {
    let text = include_str!("../../../../condor-hand/tests/hands/tripod.toml");
    let [first, second] = {
        let small = HandView::new(&Hand::<3, 3, 6>::from_toml(text, "tripod.toml").unwrap());
        let large = HandView::new(&Hand::<4, 4, 8>::from_toml(text, "tripod.toml").unwrap());
        [Box::new(small) as Box<dyn Robot>, Box::new(large)]
    };
    let [first, second] = [&first, &second].map(|robot| robot.simulator().unwrap());
    let open = first.moved(&[]).positions;
    assert_eq!(open.len(), 9);
    assert_eq!(first.moved(&[]), second.moved(&[]));
    assert_eq!(first.clearances(&open), second.clearances(&open));
    let motion = "[[motion]]\nprofile = \"jerk-limited\"\nspeed = 0.3\nby = { \"a.bend\" = 0.2, \"c.nail\" = 0.005 }\n";
    let [plan, other] = [first, second].map(|it| it.plan(&open, motion, "by").unwrap());
    assert_eq!(plan, other);
    assert_eq!(plan.events[1].what, What::Reached);
    assert_eq!((plan.period_s, plan.joints.len()), (0.01, 9));
    assert_eq!(plan.joints[1].name, "a.bend");
    let moved: Vec<f64> = plan
        .joints
        .iter()
        .map(|it| *it.position.last().unwrap())
        .collect();
    let by: Vec<f64> = moved
        .iter()
        .zip(&open)
        .map(|(to, from)| to - from)
        .collect();
    assert!(
        (by[1] - 0.2).abs() < 1e-12 && (by[8] - 0.005).abs() < 1e-12,
        "{by:?}"
    );
    // Nothing reaches so far, and all say how far.
    let [here, there] = [first, second].map(|it| {
        let tip = it.dragged(&moved, "a.tip", [9.0, 0.0, 0.0]).unwrap();
        (tip.is_reached, tip.distance_m)
    });
    assert!((here.1 - there.1).abs() < 1e-9 && !here.0 && !there.0);
}
