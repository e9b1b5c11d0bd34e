//! What `grasp` promises, against NumPy's pseudo-inverse, Pinocchio's Jacobians, numbers by hand, and
//! arbitrary grasps.

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
