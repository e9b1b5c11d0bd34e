//! What tensions for torques promise: the torques, the limits, and the least squares.

#![allow(
    clippy::float_cmp,
    reason = "the tests say where a number is exactly another"
)]

use condor_hand::math::{clamp, max, sqrt};
use condor_hand::tendon::{AllocatedTensions, MomentArms, Pair, TendonPairs};
use condor_hand::transmission::EffortLimits;
use nalgebra::{SMatrix, SVector, Vector4};
use proptest::prelude::*;
use serde::Deserialize;

const LIMITS: EffortLimits = EffortLimits {
    low: 4.0,
    high: 130.0,
    bias: 7.0,
};

type Rows = [TendonPairs<f64, 4>; 4];

fn pair(flexor: f64, extensor: f64) -> Pair<f64> {
    Pair { flexor, extensor }
}

fn opposite(arm: f64) -> Pair<f64> {
    pair(arm, -arm)
}

/// Antagonists cross each joint on opposite sides with the same arm.
fn symmetric() -> Rows {
    let none = pair(0.0, 0.0);
    let [first, second, third, last] = [0.0127, 0.0127, 0.0095, 0.008].map(opposite);
    [
        [first, none, none, none],
        [none, second, third, last],
        [none, none, third, last],
        [none, none, none, last],
    ]
}

/// Co-contraction of the last joint loads the two before it.
fn asymmetric() -> Rows {
    let mut rows = symmetric();
    rows[1][3] = pair(0.006, -0.0085);
    rows[2][3] = pair(0.008, 0.003);
    rows
}

fn finger(rows: Rows, limits: EffortLimits) -> MomentArms<4> {
    MomentArms::new(rows, [Pair::both(limits); 4]).unwrap()
}

fn one_joint(arms: Pair<f64>, bias: f64) -> MomentArms<1> {
    MomentArms::new([[arms]], [Pair::both(EffortLimits { bias, ..LIMITS })]).unwrap()
}

fn all(tensions: &TendonPairs<f64, 4>) -> [f64; 8] {
    core::array::from_fn(|tendon| {
        let pair = tensions[tendon / 2];
        [pair.flexor, pair.extensor][tendon % 2]
    })
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

/// The torques that are possible are those of a linear program. The least squares beyond the least tensions are also the
/// least sum if antagonists have opposite arms.
#[test]
fn what_a_linear_program_can_have_is_had() {
    let text = include_str!("../reference/tendons.json");
    let reference: LinearPrograms = serde_json::from_str(text).unwrap();
    let least = EffortLimits {
        bias: LIMITS.low,
        ..LIMITS
    };
    let mut exact = 0;
    for case in &reference.cases {
        let is_symmetric = case.arms == "sym";
        let rows = if is_symmetric {
            symmetric()
        } else {
            asymmetric()
        };
        let arms = finger(rows, least);
        let torque = Vector4::from(case.tau);
        let allocated = arms.allocate(&torque);
        let made = arms.torque(&allocated.tensions);
        assert!((made - allocated.torque).amax() < 1e-11);
        let Some(optimum) = case.total else {
            assert_ne!(allocated.saturated, 0, "{:?}", case.tau);
            continue;
        };
        assert_eq!(allocated.saturated, 0, "{:?}", case.tau);
        let ratio = all(&allocated.tensions).iter().sum::<f64>() / optimum;
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
        let rows = if case.arms == "sym" {
            symmetric()
        } else {
            asymmetric()
        };
        let limits = |tendon: usize| EffortLimits {
            low: case.low[tendon],
            high: case.high[tendon],
            bias: case.bias[tendon],
        };
        let limits = core::array::from_fn(|k| Pair {
            flexor: limits(2 * k),
            extensor: limits(2 * k + 1),
        });
        let arms = MomentArms::new(rows, limits).unwrap();
        let allocated = arms.allocate(&Vector4::from(case.torque));
        assert_eq!(allocated.saturated, 0, "{:?}", case.torque);
        let error = (arms.torque(&allocated.tensions) - Vector4::from(case.torque)).amax();
        assert!(error <= 1e-9, "{error} N m");
        let tensions = all(&allocated.tensions);
        let objective = tensions
            .iter()
            .zip(&case.bias)
            .map(|(f, bias)| (f - bias) * (f - bias));
        let ratio = (objective.sum::<f64>() + 1e-9) / (case.objective + 1e-9);
        assert!(ratio <= 1.0 + 1e-9, "{ratio}");
        most = most.max(allocated.steps);
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

/// Of random tensions, of those at limits, and small ones.
#[test]
fn no_torque_of_a_finger_is_refused() {
    let mut random = Random(977);
    for rows in [symmetric(), asymmetric()] {
        let arms = finger(rows, LIMITS);
        for case in 0..3000 {
            let mut tension = || match case % 3 {
                0 => LIMITS.low + random.next() * (LIMITS.high - LIMITS.low),
                1 if random.next() < 0.5 => LIMITS.low,
                1 => LIMITS.high,
                _ => LIMITS.low + 5.0 * random.next(),
            };
            let tensions = core::array::from_fn(|_| pair(tension(), tension()));
            let torque = arms.torque(&tensions);
            let allocated = arms.allocate(&torque);
            assert_eq!(allocated.saturated, 0, "{torque:?}");
            let error = (arms.torque(&allocated.tensions) - torque).amax();
            assert!(error <= 1e-9, "{error} N m");
            assert!(allocated.steps <= 12, "{} steps", allocated.steps);
        }
    }
}

#[test]
fn a_torque_shifts_tensions_about_the_preferred_one() {
    let arms = finger(symmetric(), LIMITS);
    let idle = arms.allocate(&Vector4::zeros());
    assert_eq!((idle.tensions, idle.steps), ([Pair::both(7.0); 4], 0));
    // 0.0127 m times 2 N more, and as much less at the other.
    let turned = arms.allocate(&Vector4::new(0.0508, 0.0, 0.0, 0.0));
    assert!((turned.tensions[0].flexor - 9.0).abs() < 1e-12);
    assert!((turned.tensions[0].extensor - 5.0).abs() < 1e-12);
    // A tendon at its least tension leaves the rest to the others.
    let far = arms.allocate(&Vector4::new(0.0127 * 26.0, 0.0, 0.0, 0.0));
    assert!((far.tensions[0].flexor - 30.0).abs() < 1e-10);
    assert_eq!(far.tensions[0].extensor, 4.0);
    assert_eq!((far.torque[0], far.saturated), (0.0127 * 26.0, 0));
}

#[test]
fn co_contraction_gives_way_to_torque_and_what_is_left_is_said() {
    let stiff = one_joint(opposite(0.01), 100.0);
    // 100 +- 40 would need 140 N.
    let allocated = stiff.allocate(&SVector::from([0.8]));
    assert_eq!(allocated.saturated, 0);
    assert!((allocated.tensions[0].flexor - 130.0).abs() < 1e-9);
    assert!((allocated.tensions[0].extensor - 50.0).abs() < 1e-9);

    for bias in [4.0, 7.0, 60.0] {
        let arms = one_joint(opposite(0.01), bias);
        let allocated = arms.allocate(&SVector::from([-2.0]));
        let [tensions] = allocated.tensions;
        assert!((tensions.flexor - 4.0).abs() < 1e-9 && (tensions.extensor - 130.0).abs() < 1e-9);
        assert_eq!(allocated.saturated, 1);
        assert!((allocated.torque[0] + 1.26).abs() < 1e-11);
        let (low, high) = arms.torque_range(0);
        assert!((low + 1.26).abs() < 1e-12 && (high - 1.26).abs() < 1e-12);
    }
}

/// The distal tendons can help the middle joint beyond what its own ones give it.
#[test]
fn tendons_that_cross_a_joint_add_to_its_torque() {
    let arms = finger(symmetric(), LIMITS);
    let own = 0.0127 * 126.0;
    let torque = Vector4::new(0.0, own + 0.5, 0.5, 0.0);
    let allocated = arms.allocate(&torque);
    assert_eq!(allocated.saturated, 0);
    assert!((arms.torque(&allocated.tensions) - torque).amax() < 1e-9);
    let (_, high) = arms.torque_range(1);
    assert!((high - (0.0127 + 0.0095 + 0.008) * 126.0).abs() < 1e-12);
}

#[test]
fn joints_that_no_tendon_shares_with_a_saturated_one_still_get_their_torque() {
    let arms = finger(symmetric(), LIMITS);
    let torque = Vector4::new(0.1, 2.0, -1.5, -0.9);
    let allocated = arms.allocate(&torque);
    assert_eq!(allocated.saturated, 0b0110);
    assert!((allocated.torque[0] - torque[0]).abs() < 1e-5);
    assert!((arms.torque(&allocated.tensions) - allocated.torque).amax() < 1e-9);
}

#[test]
fn each_tendon_has_limits_of_its_own() {
    let mut limits = [Pair::both(LIMITS); 4];
    limits[2].flexor.bias = 30.0;
    limits[3].extensor.high = 6.0;
    limits[3].extensor.bias = 5.0;
    let arms = MomentArms::new(symmetric(), limits).unwrap();
    assert_eq!(arms.limits(), limits);
    let allocated = arms.allocate(&Vector4::new(0.0, 0.0, 0.0, -1.0));
    assert_eq!(allocated.tensions[3], pair(4.0, 6.0));
    let idle = arms.allocate(&Vector4::zeros()).tensions;
    assert!(idle[2].flexor > 15.0 && idle[3].extensor <= 6.0);
}

#[test]
fn given_tensions_stay_and_others_make_up_for_them() {
    let arms = finger(symmetric(), LIMITS);
    let torque = Vector4::new(0.1, 0.2, 0.1, 0.0);
    let given = [None, None, None, Some(pair(20.0, f64::NAN))];
    let allocated = arms.allocate_around(&torque, &given);
    assert_eq!(allocated.tensions[3], pair(20.0, 4.0));
    assert_eq!(
        allocated.torque.fixed_rows::<3>(0),
        torque.fixed_rows::<3>(0)
    );
    assert!((allocated.torque[3] - 0.008 * 16.0).abs() < 1e-12);
    assert!((arms.torque(&allocated.tensions) - allocated.torque).amax() < 1e-9);
}

#[test]
fn a_torque_that_is_not_finite_leaves_all_at_their_minimum() {
    for (broken, saturating) in [
        (f64::NAN, 0.0),
        (f64::INFINITY, 1e9),
        (f64::NEG_INFINITY, -1e9),
    ] {
        let torque = Vector4::new(0.1, saturating, broken, 0.1);
        let allocated = finger(symmetric(), LIMITS).allocate(&torque);
        assert_eq!(allocated.not_finite, 0b100);
        assert_eq!(allocated.saturated, 0);
        assert_eq!(allocated.tensions, [Pair::both(4.0); 4]);
        assert!(allocated.torque.amax() < 1e-12);
    }
}

#[test]
fn tendons_that_no_finger_can_have_are_refused() {
    let wrong = |rows: Rows, limits: EffortLimits| {
        MomentArms::new(rows, [Pair::both(limits); 4])
            .unwrap_err()
            .to_string()
    };
    let with = |change: fn(&mut EffortLimits)| {
        let mut limits = LIMITS;
        change(&mut limits);
        limits
    };
    assert_eq!(
        wrong(symmetric(), with(|limits| limits.high = 3.0)),
        "the flexor of joint 0: the greatest effort is 3; it must be at least 4"
    );
    assert_eq!(
        wrong(symmetric(), with(|limits| limits.bias = 200.0)),
        "the flexor of joint 0: the preferred effort is 200; it must be from 4 to 130"
    );
    assert!(wrong(symmetric(), with(|limits| limits.low = f64::NAN)).contains("the least effort"));
    let mut rows = symmetric();
    rows[1][2].extensor = f64::INFINITY;
    assert_eq!(
        wrong(rows, LIMITS),
        "a tendon of joint 2 where it crosses joint 1: the arm, m, is inf; it must be finite"
    );
    // A row without arms, and one that depends on another.
    let mut rows = symmetric();
    rows[0] = [pair(0.0, 0.0); 4];
    let alone = "the number of tendons that turn it by itself is 0; it must be at least 1";
    assert_eq!(wrong(rows, LIMITS), format!("joint 0: {alone}"));
    let mut rows = symmetric();
    rows[3] = rows[2].map(|arms| arms.map(|arm| 2.0 * arm));
    assert_eq!(wrong(rows, LIMITS), format!("joint 2: {alone}"));
}

/// Any arms that reach all joints, and limits for each tendon.
fn fingers() -> impl Strategy<Value = MomentArms<4>> {
    let own = || (0.003..0.02_f64, 0.003..0.02_f64);
    let crossing = prop::collection::vec(-0.015..0.015_f64, 12);
    let limits = || {
        (0.0..10.0, 50.0..200.0, 0.0..1.0).prop_map(|(low, high, part)| EffortLimits {
            low,
            high,
            bias: low + part * part * (high - low),
        })
    };
    (
        [own(), own(), own(), own()],
        crossing,
        [(); 8].map(|()| limits()),
    )
        .prop_map(|(own, crossing, limits)| {
            let mut crossing = crossing.chunks(2);
            let mut rows = [[Pair::both(0.0); 4]; 4];
            for (joint, row) in rows.iter_mut().enumerate() {
                row[joint] = pair(own[joint].0, -own[joint].1);
                for arm in row.iter_mut().skip(joint + 1) {
                    let both = crossing.next().unwrap();
                    *arm = pair(both[0], both[1]);
                }
            }
            let limits = core::array::from_fn(|joint| Pair {
                flexor: limits[2 * joint],
                extensor: limits[2 * joint + 1],
            });
            MomentArms::new(rows, limits).unwrap()
        })
}

fn torques(largest: f64) -> impl Strategy<Value = Vector4<f64>> {
    [(); 4].map(|()| -largest..largest).prop_map(Vector4::from)
}

fn within(arms: &MomentArms<4>, allocated: &AllocatedTensions<4>) -> bool {
    (allocated.tensions.iter().zip(&arms.limits())).all(|(tension, limits)| {
        let is_within =
            |limits: &EffortLimits, tension| tension >= limits.low && tension <= limits.high;
        is_within(&limits.flexor, tension.flexor) && is_within(&limits.extensor, tension.extensor)
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    /// The torque is made, by the least squares, or it is said which is made.
    #[test]
    fn tensions_make_the_torque(
        arms in fingers(),
        torque in prop_oneof![torques(0.2), torques(3.0), torques(1e15)],
    ) {
        let allocated = arms.allocate(&torque);
        prop_assert!(within(&arms, &allocated), "{:?}", allocated);
        prop_assert_eq!(allocated.not_finite, 0);
        let made = arms.torque(&allocated.tensions);
        prop_assert!((made - allocated.torque).amax() < 1e-9, "{:?}", allocated);
        for joint in 0..4 {
            let is_saturated = allocated.saturated & 1 << joint != 0;
            let missing = (allocated.torque[joint] - torque[joint]).abs();
            prop_assert!(missing < 1e-4 || is_saturated);
            prop_assert!(missing == 0.0 || allocated.saturated != 0);
            prop_assert!(missing > 1e-12 || !is_saturated, "{} {}", joint, missing);
        }
        prop_assert!(allocated.steps < 60);
    }

    /// No tensions produce torques that are nearer to those that were asked for.
    #[test]
    fn torques_that_do_not_exist_become_the_nearest(
        arms in fingers(),
        torque in torques(3.0),
        others in [(); 8].map(|()| 0.0..1.0_f64),
    ) {
        let allocated = arms.allocate(&torque);
        let limits = arms.limits();
        let mut wanted = torque;
        let length = |joint: usize| {
            let squares = arms.rows()[joint].iter().map(|arm| arm.flexor * arm.flexor + arm.extensor * arm.extensor);
            sqrt(squares.sum::<f64>())
        };
        for joint in 0..4 {
            let (low, high) = arms.torque_range(joint);
            wanted[joint] = clamp(wanted[joint], low, high);
        }
        let missing = |tensions: &TendonPairs<f64, 4>| -> Vector4<f64> {
            let made = arms.torque(tensions);
            SVector::from_fn(|joint, _| (wanted[joint] - made[joint]) / length(joint))
        };
        let rest = missing(&allocated.tensions);
        // Towards any other tensions what is missing becomes more, or stays the same.
        let part = |limits: &EffortLimits, part| limits.low + part * (limits.high - limits.low);
        let other = core::array::from_fn(|k| Pair {
            flexor: part(&limits[k].flexor, others[2 * k]),
            extensor: part(&limits[k].extensor, others[2 * k + 1]),
        });
        let change = missing(&other) - rest;
        prop_assert!(rest.dot(&change) > -1e-2 * (1.0 + rest.norm()), "{} {}", rest, change);
    }

    /// No step of the torque makes a larger step of tensions than its own size allows.
    #[test]
    fn tensions_have_no_step(arms in fingers(), from in torques(0.5), direction in torques(1.0)) {
        let step = direction * 1e-6;
        let (before, after) = (arms.allocate(&from), arms.allocate(&(from + step)));
        if before.saturated | after.saturated != 0 {
            return Ok(());
        }
        let rows = SMatrix::<f64, 4, 8>::from_fn(|joint, tendon| {
            let pair = arms.rows()[joint][tendon / 2];
            [pair.flexor, pair.extensor][tendon % 2]
        });
        let stiffest = rows.singular_values().min();
        for (before, after) in all(&before.tensions).iter().zip(all(&after.tensions)) {
            // Fewer free tendons have a smaller least singular value; arms of 3 mm, crossed three times by 15 mm.
            prop_assert!((before - after).abs() < 1e-6 / stiffest * 1e4 + 1e-6);
        }
    }

    /// Whatever comes in, what goes out is a tension.
    #[test]
    fn nothing_but_tensions_comes_out(
        arms in fingers(),
        torque in [(); 4].map(|()| prop_oneof![9 => proptest::num::f64::ANY, 1 => -1.0..1.0]),
        given in [(); 4].map(|()| proptest::option::of((proptest::num::f64::ANY, proptest::num::f64::ANY))),
    ) {
        let given = given.map(|given| given.map(|(flexor, extensor)| pair(flexor, extensor)));
        let allocated = arms.allocate_around(&Vector4::from(torque), &given);
        prop_assert!(within(&arms, &allocated), "{:?}", allocated);
        prop_assert!(allocated.torque.iter().all(|torque| torque.is_finite()));
        let broken = torque.iter().any(|torque| !torque.is_finite());
        prop_assert_eq!(allocated.not_finite != 0, broken);
        for (joint, given) in given.iter().enumerate() {
            let missing = (allocated.torque[joint] - torque[joint]).abs();
            let is_said = broken || given.is_some() || allocated.saturated & 1 << joint != 0;
            prop_assert!(missing < 1e-4 || is_said, "{} {}", joint, missing);
        }
    }
}
