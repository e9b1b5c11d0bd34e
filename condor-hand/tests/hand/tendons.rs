//! What the allocation of tensions promises.

#![allow(
    clippy::float_cmp,
    reason = "the tests say where a number is exactly another"
)]

use condor_hand::tendon::{
    AllocatedTensions, MomentArms, Pair, Rectification, TendonPairs, TensionAllocation,
};
use nalgebra::{SVector, Vector4};
use proptest::prelude::*;
use serde::Deserialize;

const MIN_N: f64 = 4.0;
const MAX_N: f64 = 130.0;
const HARD: Rectification = Rectification::Hard;
const SMOOTH: Rectification = Rectification::Smooth { softness_n: 3.0 };

fn pair(flexor: f64, extensor: f64) -> Pair<f64> {
    Pair { flexor, extensor }
}

fn opposite(arm: f64) -> Pair<f64> {
    pair(arm, -arm)
}

/// Antagonists cross each joint on opposite sides with the same arm.
fn symmetric() -> MomentArms<4> {
    let none = pair(0.0, 0.0);
    let [first, second, third, last] = [0.0127, 0.0127, 0.0095, 0.008].map(opposite);
    MomentArms::new([
        [first, none, none, none],
        [none, second, third, last],
        [none, none, third, last],
        [none, none, none, last],
    ])
    .unwrap()
}

/// Co-contraction of the last joint loads the two before it.
fn asymmetric() -> MomentArms<4> {
    let mut rows = *symmetric().rows();
    rows[1][3] = pair(0.006, -0.0085);
    rows[2][3] = pair(0.008, 0.003);
    MomentArms::new(rows).unwrap()
}

fn everywhere<const N: usize>(rectification: Rectification) -> [TensionAllocation; N] {
    [TensionAllocation {
        rectification,
        min_n: MIN_N,
        max_n: MAX_N,
    }; N]
}

fn total(tensions: &TendonPairs<f64, 4>) -> f64 {
    tensions
        .iter()
        .map(|pair| pair.flexor + pair.extensor)
        .sum()
}

fn check_numbers(arms: &MomentArms<4>, expected: [f64; 8]) {
    let torque = Vector4::new(0.1, 0.5, -0.2, 0.05);
    let allocated = arms.allocate(&torque, &everywhere(SMOOTH));
    for (tension, expected) in allocated.tensions.iter().zip(expected.chunks(2)) {
        assert!((tension.flexor - expected[0]).abs() < 1e-6, "{tension:?}");
        assert!((tension.extensor - expected[1]).abs() < 1e-6, "{tension:?}");
    }
    assert_eq!(allocated.torque, torque);
}

#[test]
fn the_tensions_of_one_torque() {
    check_numbers(
        &symmetric(),
        [
            12.886_758, 5.012_743, 59.280_915, 4.162_805, 4.337_667, 30.653_457, 11.456_931,
            5.206_931,
        ],
    );
    check_numbers(
        &asymmetric(),
        [
            12.886_758, 5.012_743, 65.782_960, 4.145_671, 4.275_898, 36.620_765, 11.456_931,
            5.206_931,
        ],
    );
    let idle = symmetric().allocate(&Vector4::zeros(), &everywhere(SMOOTH));
    for tension in idle.tensions {
        assert!((tension.flexor - 7.0).abs() < 1e-12 && (tension.extensor - 7.0).abs() < 1e-12);
    }
}

#[derive(Deserialize)]
struct Reference {
    cases: Vec<Case>,
}

#[derive(Deserialize)]
struct Case {
    #[serde(rename = "P")]
    arms: String,
    tau: [f64; 4],
    feasible: bool,
    total: Option<f64>,
}

/// The least total tension is that of a linear program.
#[test]
fn hard_rectification_is_optimal_where_antagonists_are_opposite() {
    let text = include_str!("../reference/tendons.json");
    let reference: Reference = serde_json::from_str(text).unwrap();
    let (mut exact, mut worst) = (0, 1.0_f64);
    for case in &reference.cases {
        let symmetric = case.arms == "sym";
        let arms = if symmetric {
            self::symmetric()
        } else {
            asymmetric()
        };
        let torque = Vector4::from(case.tau);
        let allocated = arms.allocate(&torque, &everywhere(HARD));
        let error = (arms.torque(&allocated.tensions) - allocated.torque).amax();
        assert!(error < 1e-12, "{error}");
        let Some(optimum) = case.total else {
            assert_ne!(allocated.saturated, 0, "{:?}", case.tau);
            continue;
        };
        assert!(case.feasible);
        assert_eq!(allocated.saturated, 0, "{:?}", case.tau);
        let ratio = total(&allocated.tensions) / optimum;
        assert!(ratio > 1.0 - 1e-9, "below the optimum: {ratio}");
        if symmetric {
            assert!(ratio < 1.0 + 1e-9, "{ratio}");
            exact += 1;
        } else if ratio > worst {
            worst = ratio;
        }
    }
    assert!(exact > 50);
    assert!(worst <= 1.048, "{worst}");
}

#[test]
fn saturation_takes_co_contraction_first_and_then_says_what_is_left() {
    let arms = MomentArms::<1>::new([[opposite(0.01)]]).unwrap();
    let stiff = everywhere(Rectification::Mean {
        co_contraction_n: 100.0,
    });
    // 100 +- 40 would need 140 N.
    let allocated = arms.allocate(&SVector::from([0.8]), &stiff);
    assert_eq!(allocated.saturated, 0);
    assert!((allocated.tensions[0].flexor - 130.0).abs() < 1e-12);
    assert!((allocated.tensions[0].extensor - 50.0).abs() < 1e-12);

    for rectification in [
        HARD,
        SMOOTH,
        Rectification::Mean {
            co_contraction_n: 60.0,
        },
    ] {
        let allocated = arms.allocate(&SVector::from([-2.0]), &everywhere(rectification));
        assert_eq!(allocated.tensions, [pair(MIN_N, MAX_N)]);
        assert_eq!(allocated.saturated, 1);
        assert!((allocated.torque[0] + 1.26).abs() < 1e-12);
    }
}

#[test]
fn joints_next_to_a_saturated_one_still_get_their_torque() {
    let torque = Vector4::new(0.1, 0.2, 0.1, 5.0);
    let arms = symmetric();
    let allocated = arms.allocate(&torque, &everywhere(SMOOTH));
    assert_eq!(allocated.saturated, 0b1000);
    assert_eq!(
        allocated.torque.fixed_rows::<3>(0),
        torque.fixed_rows::<3>(0)
    );
    assert!((allocated.torque[3] - 0.008 * 126.0).abs() < 1e-12);
    assert!((arms.torque(&allocated.tensions) - allocated.torque).amax() < 1e-12);
}

#[test]
fn the_mean_is_kept_where_the_torque_allows() {
    let mean = Rectification::Mean {
        co_contraction_n: 20.0,
    };
    let arms = MomentArms::<1>::new([[pair(0.012, -0.008)]]).unwrap();
    for torque in [-0.1, 0.0, 0.1] {
        let [tension] = arms
            .allocate(&SVector::from([torque]), &everywhere(mean))
            .tensions;
        assert!((tension.flexor + tension.extensor - 40.0).abs() < 1e-12);
    }
    let hard = arms.allocate(&SVector::from([0.6]), &everywhere(HARD));
    let mean = arms.allocate(&SVector::from([0.6]), &everywhere(mean));
    assert!((hard.tensions[0].flexor - mean.tensions[0].flexor).abs() < 1e-12);
}

#[test]
fn each_joint_has_its_own_stiffness() {
    let mut allocation = everywhere(HARD);
    allocation[2].rectification = Rectification::Mean {
        co_contraction_n: 30.0,
    };
    let tensions = symmetric()
        .allocate(&Vector4::zeros(), &allocation)
        .tensions;
    assert_eq!(tensions[3], Pair::both(MIN_N));
    assert!((tensions[2].flexor - 30.0).abs() < 1e-12);
    assert_eq!(tensions[0], Pair::both(MIN_N));
}

#[test]
fn a_torque_that_is_not_finite_leaves_all_at_their_minimum() {
    for (broken, saturating) in [
        (f64::NAN, 0.0),
        (f64::INFINITY, 1e9),
        (f64::NEG_INFINITY, -1e9),
    ] {
        let torque = Vector4::new(0.1, saturating, broken, 0.1);
        let allocated = symmetric().allocate(&torque, &everywhere(SMOOTH));
        assert_eq!(allocated.not_finite, 0b100);
        assert_eq!(allocated.saturated, 0);
        assert_eq!(allocated.tensions, [Pair::both(MIN_N); 4]);
        assert!(allocated.torque.amax() < 1e-12);
    }
}

#[test]
fn allocations_say_what_is_wrong_with_them() {
    let [good] = everywhere(SMOOTH);
    assert_eq!(good.check(), Ok(()));
    let crossed = TensionAllocation {
        min_n: 140.0,
        ..good
    };
    let error = crossed.check().unwrap_err();
    assert_eq!(
        error.to_string(),
        "the largest tension, N, is 130; it must be at least 140"
    );
    let negative = TensionAllocation {
        rectification: Rectification::Smooth { softness_n: -1.0 },
        ..good
    };
    assert_eq!(negative.check().unwrap_err().what, "the softness, N,");
    assert!(
        TensionAllocation {
            max_n: f64::NAN,
            ..good
        }
        .check()
        .is_err()
    );
}

fn rectifications() -> impl Strategy<Value = Rectification> {
    prop_oneof![
        Just(HARD),
        (0.0..140.0).prop_map(|co_contraction_n| Rectification::Mean { co_contraction_n }),
        (0.0..50.0).prop_map(|softness_n| Rectification::Smooth { softness_n }),
    ]
}

/// Any block-triangular arms, with unequal own ones, and an allocation for each joint.
fn fingers() -> impl Strategy<Value = (MomentArms<4>, [TensionAllocation; 4])> {
    let own = || (0.003..0.02_f64, 0.003..0.02_f64);
    let crossing = prop::collection::vec(-0.015..0.015_f64, 12);
    let allocation = || {
        (rectifications(), 0.0..10.0, 50.0..200.0).prop_map(|(rectification, min_n, max_n)| {
            TensionAllocation {
                rectification,
                min_n,
                max_n,
            }
        })
    };
    (
        [own(), own(), own(), own()],
        crossing,
        [(); 4].map(|()| allocation()),
    )
        .prop_map(|(own, crossing, allocation)| {
            let mut crossing = crossing.chunks(2);
            let mut rows = [[Pair::both(0.0); 4]; 4];
            for (joint, row) in rows.iter_mut().enumerate() {
                row[joint] = pair(own[joint].0, -own[joint].1);
                for arm in row.iter_mut().skip(joint + 1) {
                    let both = crossing.next().unwrap();
                    *arm = pair(both[0], both[1]);
                }
            }
            (MomentArms::new(rows).unwrap(), allocation)
        })
}

fn torques(largest: f64) -> impl Strategy<Value = Vector4<f64>> {
    [(); 4].map(|()| -largest..largest).prop_map(Vector4::from)
}

fn within(allocated: &AllocatedTensions<4>, allocation: &[TensionAllocation; 4]) -> bool {
    allocated
        .tensions
        .iter()
        .zip(allocation)
        .all(|(tension, allocation)| {
            let limits = allocation.min_n..=allocation.max_n;
            limits.contains(&tension.flexor) && limits.contains(&tension.extensor)
        })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    /// The torque is made, or it is said which is made.
    #[test]
    fn tensions_make_the_torque(
        (arms, allocation) in fingers(),
        torque in prop_oneof![torques(0.2), torques(3.0), torques(1e15)],
    ) {
        let allocated = arms.allocate(&torque, &allocation);
        prop_assert!(within(&allocated, &allocation), "{:?}", allocated);
        prop_assert_eq!(allocated.not_finite, 0);
        let made = arms.torque(&allocated.tensions);
        for joint in 0..4 {
            prop_assert!((made[joint] - allocated.torque[joint]).abs() < 1e-12);
            if allocated.saturated & 1 << joint == 0 {
                prop_assert_eq!(allocated.torque[joint], torque[joint]);
                continue;
            }
            // The nearest torque: one tendon can give no more, and the other no less.
            prop_assert_ne!(allocated.torque[joint], torque[joint]);
            let TensionAllocation { min_n, max_n, .. } = allocation[joint];
            let nearest: Pair<f64> = if torque[joint] > made[joint] {
                pair(max_n, min_n)
            } else {
                pair(min_n, max_n)
            };
            let tension = allocated.tensions[joint];
            prop_assert!((tension.flexor - nearest.flexor).abs() < 1e-10);
            prop_assert!((tension.extensor - nearest.extensor).abs() < 1e-10);
        }
    }

    /// No step of the torque makes a larger step of tensions than its own size allows.
    #[test]
    fn smooth_tensions_have_no_step(
        (arms, mut allocation) in fingers(),
        from in torques(2.0),
        direction in torques(1.0),
    ) {
        for allocation in &mut allocation {
            allocation.rectification = SMOOTH;
        }
        let step = direction * 1e-9;
        let before = arms.allocate(&from, &allocation);
        let after = arms.allocate(&(from + step), &allocation);
        for (before, after) in before.tensions.iter().zip(&after.tensions) {
            // Arms of 3 mm, crossed three times by ones of 15 mm.
            let largest = 1e-9 / 0.003 * 11.0 * 11.0 * 11.0;
            prop_assert!((before.flexor - after.flexor).abs() < largest);
            prop_assert!((before.extensor - after.extensor).abs() < largest);
        }
    }

    /// Whatever comes in, what goes out is a tension.
    #[test]
    fn nothing_but_tensions_comes_out(
        (arms, mut allocation) in fingers(),
        torque in [(); 4].map(|()| any::<f64>()),
        amount in any::<f64>(),
        which in 0..4_usize,
        mean in any::<bool>(),
    ) {
        allocation[which].rectification = if mean {
            Rectification::Mean { co_contraction_n: amount }
        } else {
            Rectification::Smooth { softness_n: amount }
        };
        let allocated = arms.allocate(&Vector4::from(torque), &allocation);
        prop_assert!(within(&allocated, &allocation), "{:?}", allocated);
        prop_assert!(allocated.torque.iter().all(|torque| torque.is_finite()));
        let broken = torque.iter().any(|torque| !torque.is_finite());
        prop_assert_eq!(allocated.not_finite != 0, broken);
    }
}

#[test]
fn an_allocation_of_nonsense_still_gives_tensions() {
    for (min_n, max_n) in [
        (f64::NAN, 10.0),
        (-5.0, f64::NAN),
        (20.0, 10.0),
        (f64::NAN, f64::NAN),
    ] {
        let allocation = [TensionAllocation {
            rectification: SMOOTH,
            min_n,
            max_n,
        }; 4];
        let allocated = symmetric().allocate(&Vector4::repeat(0.1), &allocation);
        for tension in allocated.tensions {
            for tension in [tension.flexor, tension.extensor] {
                assert!((0.0..=20.0).contains(&tension), "{tension}");
            }
        }
        assert!(allocated.torque.iter().all(|torque| torque.is_finite()));
    }
}
