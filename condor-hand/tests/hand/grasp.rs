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

mod arbitrary;
mod by_hand;
mod distributed;
mod hostile;
mod law;
mod reference;
mod settings;
mod wrenches;
