//! The programs of the hand as processes of Linux.
//!
//! They are functions of this library, so that each program that brings the hand up links them and
//! compiles none of them anew.

use std::process::ExitCode;
use std::string::String;
use std::vec::Vec;

use condor_rt::linux;

use crate::master::Master;
use crate::plant::Plant;
use crate::replay::Replay;
use crate::servo::Servo;
use crate::table::Table;

/// Runs the master, and returns its exit status.
#[must_use]
pub fn master(arguments: Vec<String>) -> ExitCode {
    linux::run(&Master, arguments)
}

/// Runs the simulated robot, and returns its exit status.
#[must_use]
pub fn plant(arguments: Vec<String>) -> ExitCode {
    linux::run(&Plant, arguments)
}

/// Runs the replay of a recording, and returns its exit status.
#[must_use]
pub fn replay(arguments: Vec<String>) -> ExitCode {
    linux::run(&Replay, arguments)
}

/// Runs a servo processor, and returns its exit status.
#[must_use]
pub fn servo(arguments: Vec<String>) -> ExitCode {
    linux::run(&Servo, arguments)
}

/// Runs the table, and returns its exit status.
#[must_use]
pub fn table(arguments: Vec<String>) -> ExitCode {
    linux::run(&Table, arguments)
}
