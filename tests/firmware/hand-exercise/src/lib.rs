//! The same input yields the same bits: a corpus runs through every level of `condor-hand`, and the results
//! are hashed to one number for each level.
//!
//! The numbers are committed here. A host and a firmware make the same checks, so a target on which one bit
//! differs fails. The corpus has zeros of both signs, subnormal numbers, singular postures, limits and
//! saturation, and NaN and infinities wherever sensors and users can send such values.
#![no_std]
#![allow(
    clippy::match_same_arms,
    reason = "scripts are read in the order of their ticks"
)]
#![allow(clippy::unnecessary_wraps, reason = "all levels have one signature")]
#![allow(
    clippy::large_stack_arrays,
    reason = "the firmwares have a stack for a whole hand"
)]

mod actuators;
mod control;
mod controlled;
mod corpus;
mod digest;
mod grasping;
mod mechanism;
mod numbers;
mod trajectories;

use condor_hand::config::Hand;
use digest::Digest;

/// The hand that ships with the crate.
type Shipped = Hand<4, 4, 8>;

/// The image of the shipped hand, with other limits of the faults of sensors: those of the exercise wander whatever is
/// asked of them, and fail for longer. A test of the hand system compares it with the text, and makes it anew.
pub const IMAGE: &[u8] = include_bytes!("../data/utah-mit.image");

/// One level of the hierarchy, and the hash of what it answers to the corpus.
struct Level {
    name: &'static str,
    /// `None` if the level refused what it takes elsewhere.
    run: fn(&mut Digest, &Shipped) -> Option<()>,
    hash: u64,
}

const LEVELS: [Level; 12] = [
    level(
        "elementary functions",
        numbers::functions,
        0x223e_f675_bf05_e64b,
    ),
    level("kinematics", mechanism::kinematics, 0xa3ae_7480_2698_7b29),
    level(
        "nearest postures",
        mechanism::nearest,
        0x6518_f624_558a_d2bf,
    ),
    level("dynamics", mechanism::dynamics, 0x8507_8642_3385_e5b7),
    level("filters", control::control, 0x9262_b362_4967_0e48),
    level(
        "efforts of torques",
        actuators::allocation,
        0x646a_d49e_a9e6_d70a,
    ),
    level(
        "servos of efforts",
        actuators::servos,
        0x398a_4eee_e2e3_b4f3,
    ),
    level("profiles", trajectories::profiles, 0xfb48_ea31_4de4_04f0),
    level(
        "generator and interpolator",
        trajectories::motion,
        0x3b79_d904_6251_d8eb,
    ),
    level("grasps", grasping::grasps, 0x6415_f901_61a0_746e),
    level(
        "a finger's controller",
        controlled::finger,
        0x85b4_f3e4_0c3c_28ec,
    ),
    level(
        "a simulated hand in closed loop",
        controlled::hand,
        0x9f16_a37a_7504_0e5c,
    ),
];

const fn level(
    name: &'static str,
    run: fn(&mut Digest, &Shipped) -> Option<()>,
    hash: u64,
) -> Level {
    Level { name, run, hash }
}

/// Runs the corpus through all levels. `compare` gets the name of each, the hash of its answers, which is `None`
/// if it refused what it takes elsewhere or answered a NaN where none may be, and the committed hash.
pub fn same_bits(compare: &mut dyn FnMut(&str, Option<u64>, u64)) {
    let Ok(hand) = Shipped::from_image(IMAGE) else {
        return compare("the image of the hand", None, 0);
    };
    for Level { name, run, hash } in &LEVELS {
        let mut digest = Digest::new();
        let complete = run(&mut digest, &hand).is_some() && !digest.is_spoilt();
        compare(name, complete.then_some(digest.hash()), *hash);
    }
}
