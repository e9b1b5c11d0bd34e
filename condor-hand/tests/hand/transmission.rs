//! Efforts for torques: the torques, the limits, and the least squares.

#![allow(
    clippy::float_cmp,
    reason = "the tests say where a number is exactly another"
)]

use condor_hand::math::{clamp, max, sqrt};
use condor_hand::transmission::{EffortLimits, Efforts, Linear};
use nalgebra::{SMatrix, SVector, Vector4};
use proptest::prelude::*;
use serde::Deserialize;

use crate::support::largest_step;

const LIMITS: EffortLimits = EffortLimits {
    low: 4.0,
    high: 130.0,
    bias: 7.0,
};

/// The arms of eight tendons, flexor and extensor of each of four joints in turn.
type Arms = [[f64; 4]; 8];

/// The arms of an actuator, each with the opposite sign.
fn opposite(arms: [f64; 4]) -> [f64; 4] {
    arms.map(|arm| -arm)
}

/// Antagonists cross each joint on opposite sides with the same arm.
fn symmetric() -> Arms {
    let flexors = [
        [0.0127, 0.0, 0.0, 0.0],
        [0.0, 0.0127, 0.0, 0.0],
        [0.0, 0.0095, 0.0095, 0.0],
        [0.0, 0.008, 0.008, 0.008],
    ];
    core::array::from_fn(|actuator| {
        let flexor = flexors[actuator / 2];
        if actuator % 2 == 0 {
            flexor
        } else {
            opposite(flexor)
        }
    })
}

/// Co-contraction of the last joint loads the two before it.
fn asymmetric() -> Arms {
    let mut arms = symmetric();
    arms[6] = [0.0, 0.006, 0.008, 0.008];
    arms[7] = [0.0, -0.0085, 0.003, -0.008];
    arms
}

fn finger(arms: Arms, limits: EffortLimits) -> Linear<4, 8> {
    Linear::new(arms, [limits; 8]).unwrap()
}

/// A joint with two antagonists.
fn one_joint(arm: f64, bias: f64) -> Linear<1, 2> {
    Linear::new([[arm], [-arm]], [EffortLimits { bias, ..LIMITS }; 2]).unwrap()
}

#[derive(Deserialize)]
struct LinearPrograms {
    cases: Vec<LinearProgram>,
}

#[derive(Deserialize)]
struct LinearProgram {
    #[serde(rename = "P")]
    arms: String,
    tau: [f64; 4],
    total: Option<f64>,
}

/// The torques that are possible are those of a linear program. The least squares beyond the least efforts are also the
/// least sum if antagonists have opposite arms.
#[test]
fn the_torques_of_a_linear_program_are_had() {
    let text = include_str!("../reference/tendons.json");
    let reference: LinearPrograms = serde_json::from_str(text).unwrap();
    let least = EffortLimits {
        bias: LIMITS.low,
        ..LIMITS
    };
    let mut exact = 0;
    for case in &reference.cases {
        let is_symmetric = case.arms == "sym";
        let arms = if is_symmetric {
            symmetric()
        } else {
            asymmetric()
        };
        let linear = finger(arms, least);
        let torque = Vector4::from(case.tau);
        let efforts = linear.efforts(&torque);
        let made = linear.torque(&efforts.effort);
        assert!((made - efforts.torque).amax() < 1e-11);
        let Some(optimum) = case.total else {
            assert_ne!(efforts.saturated, 0, "{:?}", case.tau);
            continue;
        };
        assert_eq!(efforts.saturated, 0, "{:?}", case.tau);
        let ratio = efforts.effort.iter().sum::<f64>() / optimum;
        assert!(ratio > 1.0 - 1e-9, "below the optimum: {ratio}");
        if is_symmetric {
            assert!(ratio < 1.0 + 1e-9, "{ratio}");
            exact += 1;
        }
    }
    assert!(exact > 50);
}

#[derive(Deserialize)]
struct QuadraticPrograms {
    cases: Vec<QuadraticProgram>,
}

#[derive(Deserialize)]
struct QuadraticProgram {
    arms: String,
    low: [f64; 8],
    high: [f64; 8],
    bias: [f64; 8],
    torque: [f64; 4],
    objective: f64,
}

/// A longer list of cases, from `tests/reference/efforts.py --cases 10000`, is read from the file that the variable
/// `CONDOR_EFFORTS` names.
#[test]
fn the_sum_of_squares_is_that_of_a_quadratic_program() {
    let text = std::env::var("CONDOR_EFFORTS").map_or_else(
        |_| include_str!("../reference/efforts.json").to_owned(),
        |file| std::fs::read_to_string(file).unwrap(),
    );
    let reference: QuadraticPrograms = serde_json::from_str(&text).unwrap();
    let (mut most, mut worst) = (0, 0.0_f64);
    for case in &reference.cases {
        let arms = if case.arms == "sym" {
            symmetric()
        } else {
            asymmetric()
        };
        let limits = core::array::from_fn(|actuator| EffortLimits {
            low: case.low[actuator],
            high: case.high[actuator],
            bias: case.bias[actuator],
        });
        let linear = Linear::new(arms, limits).unwrap();
        let efforts = linear.efforts(&Vector4::from(case.torque));
        assert_eq!(efforts.saturated, 0, "{:?}", case.torque);
        let error = (linear.torque(&efforts.effort) - Vector4::from(case.torque)).amax();
        assert!(error <= 1e-9, "{error} N m");
        let objective = efforts
            .effort
            .iter()
            .zip(&case.bias)
            .map(|(f, bias)| (f - bias) * (f - bias));
        let ratio = (objective.sum::<f64>() + 1e-9) / (case.objective + 1e-9);
        assert!(ratio <= 1.0 + 1e-9, "{ratio}");
        most = most.max(efforts.steps);
        worst = max(worst, error);
    }
    println!(
        "{} cases, at most {most} steps, {worst:e} N m",
        reference.cases.len()
    );
    assert!(reference.cases.len() >= 200);
}

/// Numbers from 0 to 1.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        f64::from((self.0 >> 32) as u32) / f64::from(u32::MAX)
    }
}

/// Of random efforts, of those at limits, and small ones.
#[test]
fn no_torque_of_a_finger_is_refused() {
    let mut random = Random(977);
    for arms in [symmetric(), asymmetric()] {
        let linear = finger(arms, LIMITS);
        for case in 0..3000 {
            let effort = core::array::from_fn(|_| match case % 3 {
                0 => LIMITS.low + random.next() * (LIMITS.high - LIMITS.low),
                1 if random.next() < 0.5 => LIMITS.low,
                1 => LIMITS.high,
                _ => LIMITS.low + 5.0 * random.next(),
            });
            let torque = linear.torque(&effort);
            let efforts = linear.efforts(&torque);
            assert_eq!(efforts.saturated, 0, "{torque:?}");
            let error = (linear.torque(&efforts.effort) - torque).amax();
            assert!(error <= 1e-9, "{error} N m");
            assert!(efforts.steps <= 12, "{} steps", efforts.steps);
        }
    }
}

#[test]
fn a_torque_shifts_efforts_about_the_preferred_one() {
    let linear = finger(symmetric(), LIMITS);
    let idle = linear.efforts(&Vector4::zeros());
    assert_eq!((idle.effort, idle.steps), ([7.0; 8], 0));
    // 0.0127 m times 2 N more, and as much less at the other.
    let turned = linear.efforts(&Vector4::new(0.0508, 0.0, 0.0, 0.0));
    assert!((turned.effort[0] - 9.0).abs() < 1e-12);
    assert!((turned.effort[1] - 5.0).abs() < 1e-12);
    // An actuator at its least effort leaves the rest to the others.
    let far = linear.efforts(&Vector4::new(0.0127 * 26.0, 0.0, 0.0, 0.0));
    assert!((far.effort[0] - 30.0).abs() < 1e-10);
    assert_eq!(far.effort[1], 4.0);
    assert_eq!((far.torque[0], far.saturated), (0.0127 * 26.0, 0));
}

#[test]
fn co_contraction_gives_way_to_torque_and_a_torque_that_is_missing_is_flagged() {
    let stiff = one_joint(0.01, 100.0);
    // 100 +- 40 would need 140 N.
    let efforts = stiff.efforts(&SVector::from([0.8]));
    assert_eq!(efforts.saturated, 0);
    assert!((efforts.effort[0] - 130.0).abs() < 1e-9);
    assert!((efforts.effort[1] - 50.0).abs() < 1e-9);

    for bias in [4.0, 7.0, 60.0] {
        let linear = one_joint(0.01, bias);
        let efforts = linear.efforts(&SVector::from([-2.0]));
        let [flexor, extensor] = efforts.effort;
        assert!((flexor - 4.0).abs() < 1e-9 && (extensor - 130.0).abs() < 1e-9);
        assert_eq!(efforts.saturated, 1);
        assert!((efforts.torque[0] + 1.26).abs() < 1e-11);
        let (low, high) = linear.torque_range(0);
        assert!((low + 1.26).abs() < 1e-12 && (high - 1.26).abs() < 1e-12);
    }
}

/// The distal tendons can help the middle joint beyond the torque that its own ones give it.
#[test]
fn actuators_that_cross_a_joint_add_to_its_torque() {
    let linear = finger(symmetric(), LIMITS);
    let own = 0.0127 * 126.0;
    let torque = Vector4::new(0.0, own + 0.5, 0.5, 0.0);
    let efforts = linear.efforts(&torque);
    assert_eq!(efforts.saturated, 0);
    assert!((linear.torque(&efforts.effort) - torque).amax() < 1e-9);
    let (_, high) = linear.torque_range(1);
    assert!((high - (0.0127 + 0.0095 + 0.008) * 126.0).abs() < 1e-12);
}

#[test]
fn joints_that_no_actuator_shares_with_a_saturated_one_still_get_their_torque() {
    let linear = finger(symmetric(), LIMITS);
    let torque = Vector4::new(0.1, 2.0, -1.5, -0.9);
    let efforts = linear.efforts(&torque);
    assert_eq!(efforts.saturated, 0b0110);
    assert!((efforts.torque[0] - torque[0]).abs() < 1e-5);
    assert!((linear.torque(&efforts.effort) - efforts.torque).amax() < 1e-9);
}

#[test]
fn each_actuator_has_limits_of_its_own() {
    let mut limits = [LIMITS; 8];
    limits[4].bias = 30.0;
    limits[7].high = 6.0;
    limits[7].bias = 5.0;
    let linear = Linear::new(symmetric(), limits).unwrap();
    assert_eq!(*linear.limits(), limits);
    let efforts = linear.efforts(&Vector4::new(0.0, 0.0, 0.0, -1.0));
    assert_eq!(efforts.effort[6..], [4.0, 6.0]);
    let idle = linear.efforts(&Vector4::zeros()).effort;
    assert!(idle[4] > 15.0 && idle[7] <= 6.0);
}

#[test]
fn fixed_efforts_stay_and_others_make_up_for_them() {
    let linear = finger(symmetric(), LIMITS);
    let torque = Vector4::new(0.1, 0.2, 0.1, 0.0);
    let mut limits = *linear.limits();
    (limits[6], limits[7]) = (EffortLimits::fixed(20.0), EffortLimits::fixed(4.0));
    let efforts = linear.efforts_within(&torque, 0b0111, &limits);
    assert_eq!(efforts.effort[6..], [20.0, 4.0]);
    assert_eq!(efforts.saturated, 0);
    let made = linear.torque(&efforts.effort);
    assert!((made - torque).fixed_rows::<3>(0).amax() < 1e-9);
    // The torque that the fixed efforts come to.
    assert!((efforts.torque[3] - 0.008 * 16.0).abs() < 1e-12);
    assert!((made - efforts.torque).amax() < 1e-9);
    // It is another one than a joint that is asked for.
    let efforts = linear.efforts_within(&torque, 0b1111, &limits);
    assert_ne!(efforts.saturated & 0b1000, 0);
}

#[test]
fn a_torque_that_is_not_finite_leaves_all_actuators_at_rest() {
    for (broken, saturating) in [
        (f64::NAN, 0.0),
        (f64::INFINITY, 1e9),
        (f64::NEG_INFINITY, -1e9),
    ] {
        let torque = Vector4::new(0.1, saturating, broken, 0.1);
        let linear = finger(symmetric(), LIMITS);
        let efforts = linear.efforts(&torque);
        assert_eq!(efforts.not_finite, 0b100);
        assert_eq!(efforts.saturated, 0);
        assert_eq!(efforts.effort, [4.0; 8]);
        assert!(efforts.torque.amax() < 1e-12);
        // The torque of a joint that is not asked for does not matter.
        let others = linear.efforts_within(&torque, 0b1001, linear.limits());
        assert_eq!(others.not_finite, 0);
        assert!((others.torque[0] - 0.1).abs() < 1e-9 && (others.torque[3] - 0.1).abs() < 1e-9);
    }
}

#[test]
fn a_joint_without_arms_has_no_torque() {
    // A motor at the first joint; nothing moves the second one.
    let motor = EffortLimits {
        low: -2.0,
        high: 2.0,
        bias: 0.0,
    };
    let linear = Linear::new([[3.0, 0.0]], [motor]).unwrap();
    assert_eq!(linear.torque_range(1), (0.0, 0.0));
    for (torque, effort, saturated) in [
        ([1.5, 0.0], 0.5, 0b00),
        ([1.5, 0.1], 0.5, 0b10),
        ([9.0, 0.0], 2.0, 0b01),
        ([9.0, -0.1], 2.0, 0b11),
    ] {
        let efforts = linear.efforts(&torque.into());
        assert!((efforts.effort[0] - effort).abs() < 1e-6, "{torque:?}");
        assert_eq!(efforts.saturated, saturated, "{torque:?}");
        assert_eq!(efforts.torque[1], 0.0, "{torque:?}");
    }
}

/// Two motors turn a joint together, and another one against each other.
#[test]
fn the_motors_of_a_differential_share_the_torques() {
    let motor = EffortLimits {
        low: -2.0,
        high: 2.0,
        bias: 0.0,
    };
    let wrist = Linear::new([[1.0, 1.0], [1.0, -1.0]], [motor; 2]).unwrap();
    let efforts = wrist.efforts(&[-1.5, 2.0].into());
    assert!((efforts.effort[0] - 0.25).abs() < 1e-12);
    assert!((efforts.effort[1] + 1.75).abs() < 1e-12);
    assert_eq!(efforts.saturated, 0);
    // Each joint alone can have 4 N m, both together cannot: they share the 2 N m that are missing.
    assert_eq!(wrist.torque_range(0), (-4.0, 4.0));
    let efforts = wrist.efforts(&[3.0, 3.0].into());
    assert_eq!(efforts.saturated, 0b11);
    assert!((efforts.torque - SVector::from([2.0, 2.0])).amax() < 1e-5);
    // Both joints turn by 1 rad/s: only the first motor moves.
    assert_eq!(wrist.actuators(&[1.0, 1.0].into()), [2.0, 0.0]);
    assert_eq!(
        [0, 1, 2].map(|motor| wrist.joint_of(motor)),
        [Some(1), Some(1), None]
    );
    assert_eq!(wrist.at_rest(), [0.0; 2]);
}

/// A force times its velocity is a torque times its rate.
#[test]
fn actuators_move_as_joints_do() {
    let linear = finger(asymmetric(), LIMITS);
    let rates = Vector4::new(0.3, -1.0, 2.0, 0.7);
    let effort = [5.0, 9.0, 20.0, 4.0, 31.0, 8.0, 6.0, 12.0];
    let at_actuators = linear.actuators(&rates);
    let powers = at_actuators.iter().zip(&effort);
    let power: f64 = powers.map(|(rate, effort)| rate * effort).sum();
    assert!((power - linear.torque(&effort).dot(&rates)).abs() < 1e-12);
    // A flexor is drawn in when its joint bends.
    assert_eq!(
        linear.actuators(&Vector4::new(1.0, 0.0, 0.0, 0.0))[0],
        0.0127
    );
}

#[test]
fn limits_of_an_effort_say_where_it_is_at_rest() {
    let limits = |low, high| EffortLimits {
        low,
        high,
        bias: low,
    };
    for (limits, at_rest, range) in [
        (limits(-2.0, 3.0), 0.0, (-2.0, 3.0)),
        (limits(4.0, 130.0), 4.0, (0.0, 130.0)),
        (limits(-9.0, -1.0), -1.0, (-9.0, 0.0)),
    ] {
        assert_eq!(limits.at_rest(), at_rest);
        assert_eq!(limits.command_range(), range);
        assert_eq!(limits.clamp(f64::NAN), limits.low);
    }
}

#[test]
fn transmissions_that_no_finger_can_have_are_refused() {
    let wrong =
        |arms: Arms, limits: EffortLimits| Linear::new(arms, [limits; 8]).unwrap_err().to_string();
    let with = |change: fn(&mut EffortLimits)| {
        let mut limits = LIMITS;
        change(&mut limits);
        limits
    };
    assert_eq!(
        wrong(symmetric(), with(|limits| limits.high = 3.0)),
        "actuator 0: the greatest effort is 3; it must be at least 4"
    );
    assert_eq!(
        wrong(symmetric(), with(|limits| limits.bias = 200.0)),
        "actuator 0: the preferred effort is 200; it must be from 4 to 130"
    );
    assert!(wrong(symmetric(), with(|limits| limits.low = f64::NAN)).contains("the least effort"));
    let mut arms = symmetric();
    arms[5][1] = f64::INFINITY;
    assert_eq!(
        wrong(arms, LIMITS),
        "actuator 5 at joint 1: the arm is inf; it must be finite"
    );
    // The two last joints always turn together.
    let arms = symmetric().map(|[first, second, third, _]| [first, second, third, 2.0 * third]);
    assert_eq!(
        wrong(arms, LIMITS),
        "joint 2: the number of actuators that move it without the joints after it is 0; it must be at least 1"
    );
}

/// Any arms that reach all joints, and limits for each actuator.
fn fingers() -> impl Strategy<Value = Linear<4, 8>> {
    let own = || [0.003..0.02_f64, 0.003..0.02_f64];
    let limits = || {
        (0.0..10.0, 50.0..200.0, 0.0..1.0).prop_map(|(low, high, part)| EffortLimits {
            low,
            high,
            bias: low + part * part * (high - low),
        })
    };
    (
        [own(), own(), own(), own()],
        [(); 8].map(|()| [(); 4].map(|()| -0.015..0.015_f64)),
        [(); 8].map(|()| limits()),
    )
        .prop_map(|(own, crossing, limits)| {
            let arms = core::array::from_fn(|actuator| {
                let joint = actuator / 2;
                let mut arms = [0.0; 4];
                arms[..joint].copy_from_slice(&crossing[actuator][..joint]);
                let [flexor, extensor] = own[joint];
                arms[joint] = [flexor, -extensor][actuator % 2];
                arms
            });
            Linear::new(arms, limits).unwrap()
        })
}

fn torques(largest: f64) -> impl Strategy<Value = Vector4<f64>> {
    [(); 4].map(|()| -largest..largest).prop_map(Vector4::from)
}

fn within(limits: &[EffortLimits; 8], efforts: &Efforts<4, 8>) -> bool {
    let mut all = efforts.effort.iter().zip(limits);
    all.all(|(effort, limits)| (limits.low..=limits.high).contains(effort))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    /// The torque is made, by the least squares, or it is said which is made.
    #[test]
    fn efforts_make_the_torque(
        linear in fingers(),
        torque in prop_oneof![torques(0.2), torques(3.0), torques(1e15)],
    ) {
        let efforts = linear.efforts(&torque);
        prop_assert!(within(linear.limits(), &efforts), "{:?}", efforts);
        prop_assert_eq!(efforts.not_finite, 0);
        let made = linear.torque(&efforts.effort);
        prop_assert!((made - efforts.torque).amax() < 1e-9, "{:?}", efforts);
        for joint in 0..4 {
            let is_saturated = efforts.saturated & 1 << joint != 0;
            let missing = (efforts.torque[joint] - torque[joint]).abs();
            prop_assert!(missing < 1e-4 || is_saturated);
            prop_assert!(missing == 0.0 || efforts.saturated != 0);
            prop_assert!(missing > 1e-12 || !is_saturated, "{} {}", joint, missing);
        }
        prop_assert!(efforts.steps < 60);
    }

    /// No efforts produce torques that are nearer to those that were asked for.
    #[test]
    fn torques_that_do_not_exist_become_the_nearest(
        linear in fingers(),
        torque in torques(3.0),
        others in [(); 8].map(|()| 0.0..1.0_f64),
    ) {
        let efforts = linear.efforts(&torque);
        let mut wanted = torque;
        let length = |joint: usize| {
            let squares = linear.arms().iter().map(|arms| arms[joint] * arms[joint]);
            sqrt(squares.sum::<f64>())
        };
        for joint in 0..4 {
            let (low, high) = linear.torque_range(joint);
            wanted[joint] = clamp(wanted[joint], low, high);
        }
        let missing = |effort: &[f64; 8]| -> Vector4<f64> {
            let made = linear.torque(effort);
            SVector::from_fn(|joint, _| (wanted[joint] - made[joint]) / length(joint))
        };
        let rest = missing(&efforts.effort);
        // Towards any other efforts what is missing becomes more, or stays the same.
        let other = core::array::from_fn(|actuator| {
            let limits = &linear.limits()[actuator];
            limits.low + others[actuator] * (limits.high - limits.low)
        });
        let change = missing(&other) - rest;
        prop_assert!(rest.dot(&change) > -1e-2 * (1.0 + rest.norm()), "{} {}", rest, change);
    }

    /// No step of the torque makes a larger step of efforts than its own size allows.
    #[test]
    fn efforts_have_no_step(linear in fingers(), from in torques(0.5), direction in torques(1.0)) {
        let step = direction * 1e-6;
        let (before, after) = (linear.efforts(&from), linear.efforts(&(from + step)));
        if before.saturated | after.saturated != 0 {
            return Ok(());
        }
        let arms = SMatrix::<f64, 4, 8>::from_fn(|joint, actuator| linear.arms()[actuator][joint]);
        let stiffest = arms.singular_values().min();
        // Fewer free tendons have a smaller least singular value; arms of 3 mm, crossed three times by 15 mm.
        let step = largest_step(&before.effort, &after.effort);
        prop_assert!(step < 1e-6 / stiffest * 1e4 + 1e-6, "{}", step);
    }

    /// Whatever torques come in, efforts within the limits come out.
    #[test]
    fn nothing_but_efforts_comes_out(
        linear in fingers(),
        torque in [(); 4].map(|()| prop_oneof![9 => proptest::num::f64::ANY, 1 => -1.0..1.0]),
        asked in 0..16_u32,
        fixed in [(); 8].map(|()| proptest::option::of(0.0..1.0_f64)),
    ) {
        let mut limits = *linear.limits();
        for (limits, part) in limits.iter_mut().zip(fixed) {
            if let Some(part) = part {
                *limits = EffortLimits::fixed(limits.low + part * (limits.high - limits.low));
            }
        }
        let efforts = linear.efforts_within(&Vector4::from(torque), asked, &limits);
        prop_assert!(within(&limits, &efforts), "{:?}", efforts);
        prop_assert!(efforts.torque.iter().all(|torque| torque.is_finite()));
        let broken = (0..4).filter(|joint| !torque[*joint].is_finite());
        let broken = broken.fold(0, |bits, joint| bits | 1 << joint);
        prop_assert_eq!(efforts.not_finite, broken & asked);
        for (joint, torque) in torque.iter().enumerate() {
            let missing = (efforts.torque[joint] - torque).abs();
            let bit = 1 << joint;
            let is_said = efforts.not_finite != 0 || asked & bit == 0 || efforts.saturated & bit != 0;
            prop_assert!(missing < 1e-4 || is_said, "{} {}", joint, missing);
        }
        prop_assert_eq!(efforts.saturated & !asked, 0);
    }
}

#[test]
fn a_joint_without_actuators_of_its_own_has_the_efforts_of_all_that_move_it() {
    let motor = EffortLimits {
        low: -2.0,
        high: 2.0,
        bias: 0.0,
    };
    let wrist = Linear::new([[1.0, 1.0], [1.0, -1.0]], [motor; 2]).unwrap();
    assert_eq!(wrist.greatest_efforts(&[0.5, -1.0]), [1.0, 1.0]);
    let one_each = Linear::new([[1.0, 0.0], [0.5, 1.0]], [motor; 2]).unwrap();
    assert_eq!(one_each.greatest_efforts(&[0.5, -1.0]), [0.5, 1.0]);
    let lost = one_each.greatest_efforts(&[f64::NAN, -1.0]);
    assert!(lost[0].is_nan() && lost[1] == 1.0, "{lost:?}");
}
