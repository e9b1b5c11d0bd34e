//! What `grasp` promises, against `NumPy`'s pseudo-inverse, Pinocchio's Jacobians, numbers by hand, and
//! arbitrary grasps.

#![allow(
    clippy::disallowed_methods,
    reason = "a test runs on one machine, and another way to the same number is the point"
)]
#![allow(
    clippy::cast_precision_loss,
    clippy::float_cmp,
    clippy::many_single_char_names,
    clippy::similar_names,
    reason = "small counts, exact numbers, and equations in the symbols of their sources"
)]

#[path = "grasp/arbitrary.rs"]
mod arbitrary;
#[path = "grasp/by_hand.rs"]
mod by_hand;
#[path = "grasp/hostile.rs"]
mod hostile;
#[path = "grasp/law.rs"]
mod law;
#[path = "grasp/reference.rs"]
mod reference;
mod support;
#[path = "grasp/wrenches.rs"]
mod wrenches;
