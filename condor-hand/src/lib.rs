// The first definition of a link counts: here those of README.md lead to items instead of files.
//! [grasp]: mod@grasp
//! [trajectory]: mod@trajectory
//! [servo]: mod@servo
//! [fault]: mod@fault
//! [controller]: mod@controller
//! [control]: mod@control
//! [transmission]: mod@transmission
//! [kinematics]: mod@kinematics
//! [dynamics]: mod@dynamics
//! [config]: mod@config
//!
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

// From the counts of a hand to its motion.
pub mod config;
pub mod controller;

// The levels, from objects to actuators.
pub mod grasp;
pub mod servo;
pub mod trajectory;
pub mod transmission;

// The building blocks, useful without a hand.
pub mod control;
pub mod decimal;
pub mod dynamics;
pub mod fault;
mod fault_code;
mod image;
pub mod kinematics;
mod list;
pub mod math;
mod number;
mod pose;
mod rotation;

// A hand to try them on.
#[cfg(feature = "sim")]
pub mod plant;

// Functions that tests and fuzz targets call with arbitrary bytes.
#[cfg(feature = "hostile")]
#[doc(hidden)]
pub mod hostile;

pub use image::ImageError;
pub use number::{NumberError, Requirement, Subject};
pub use pose::{Pose, rotation_about, rotation_vector};
