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

/// Runs the program of the master ([`Master`]) as this process, and returns its exit status. `arguments` are those of
/// the program.
#[must_use]
pub fn master(arguments: Vec<String>) -> ExitCode {
    linux::run(&Master, arguments)
}

/// Runs the program of the simulated robot ([`Plant`]) as this process, and returns its exit status. `arguments` are
/// those of the program.
#[must_use]
pub fn plant(arguments: Vec<String>) -> ExitCode {
    linux::run(&Plant, arguments)
}

/// Runs the program that computes a recording again ([`Replay`]) as this process, and returns its exit status.
/// `arguments` are those of the program.
#[must_use]
pub fn replay(arguments: Vec<String>) -> ExitCode {
    linux::run(&Replay, arguments)
}

/// Runs the program of a servo processor ([`Servo`]) as this process, and returns its exit status. `arguments` are
/// those of the program.
#[must_use]
pub fn servo(arguments: Vec<String>) -> ExitCode {
    linux::run(&Servo, arguments)
}

/// Runs the program of the table's processor ([`Table`]) as this process, and returns its exit status. `arguments` are
/// those of the program.
#[must_use]
pub fn table(arguments: Vec<String>) -> ExitCode {
    linux::run(&Table, arguments)
}
