#![doc = include_str!("../README.md")]
#![cfg_attr(not(any(feature = "std", test)), no_std)]
#![forbid(unsafe_code)]
#![allow(
    clippy::many_single_char_names,
    clippy::similar_names,
    reason = "equations are in the symbols of their sources"
)]
#![allow(
    clippy::float_cmp,
    reason = "zero is a value that people write, and the same input gives the same bits"
)]

// Numbers.
pub mod math;
mod pose;

// The laws of control, useful without a hand.
pub mod control;

// The laws of a finger.
pub mod dynamics;
pub mod kinematics;
pub mod tendon;

// The laws of several fingers.
pub mod grasp;

// The servos of a finger, and the motion that they follow.
pub mod controller;
pub mod servo;
pub mod trajectory;

// What differs from hand to hand.
pub mod config;

// A hand to try them on.
#[cfg(feature = "sim")]
pub mod plant;

pub use math::Real;
pub use pose::Pose;
