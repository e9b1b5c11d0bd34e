#![doc = include_str!("../README.md")]
#![cfg_attr(not(any(feature = "std", test)), no_std)]
#![forbid(unsafe_code)]

// The boards on the bus.
pub mod boards;

// The messages between processors.
pub mod grasp;
pub mod guards;
pub mod message;
pub mod motions;
pub mod objects;
pub mod packet;

// The motions of several clients, none of which runs twice.
pub mod queue;

// The inputs of a servo processor, as a file.
pub mod recording;

// The programs.
pub mod master;
pub mod plant;
pub mod replay;
pub mod servo;
pub mod table;

// On the host, before anything runs.
#[cfg(feature = "std")]
pub mod compile;

// The motion queue of a running system.
#[cfg(feature = "host")]
pub mod host;

// The programs as processes.
#[cfg(feature = "linux")]
pub mod processes;

// The program `condor` for a robot.
#[cfg(feature = "program")]
pub mod program;

mod arguments;
mod desired;
mod failure;
mod file;
mod joints;
mod numbers;
mod start;
mod tracking;

pub use failure::{Failure, FailureText, FileName};

/// The greatest number of fingers of a robot.
pub const FINGERS: usize = 4;
/// The greatest number of joints of a finger.
pub const JOINTS: usize = 4;
/// The greatest number of actuators of a finger.
pub const ACTUATORS: usize = 2 * JOINTS;
/// The greatest number of joints of a robot. Lists of all joints go finger by finger, proximal joints first.
pub const ALL: usize = FINGERS * JOINTS;

/// The configuration of a robot with [`FINGERS`] fingers of [`JOINTS`] joints and [`ACTUATORS`] actuators.
pub type RobotDescription = condor_hand::config::Hand<FINGERS, JOINTS, ACTUATORS>;

/// The mechanism of a finger: any chain of joints.
pub type Mechanism = condor_hand::kinematics::Chain<JOINTS>;

/// The actuators of a finger, and the arms by which they move its joints.
pub type Actuators = condor_hand::transmission::Linear<JOINTS, ACTUATORS>;

/// The name of the file with the compiled configuration, which each program reads through the file service.
pub const IMAGE: &str = "hand.image";
