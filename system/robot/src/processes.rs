//! The programs of a robot as processes of Linux.

use std::process::ExitCode;
use std::string::String;
use std::vec::Vec;

use condor_rt::linux;

use crate::RobotDescription;
#[cfg(doc)]
use crate::boards::Boards;
use crate::boards::{BoardError, SimBoards};
use crate::master::Master;
use crate::plant::Plant;
use crate::replay::Replay;
use crate::servo::Servo;
use crate::table::Table;

/// A program: it gets its arguments, and returns its exit status.
type Run = fn(Vec<String>) -> ExitCode;

/// The programs of a robot as processes of Linux, each with its name.
///
/// A crate of boards has them in a `static`, so that robots with these boards do not compile the programs anew.
#[derive(Clone, Copy, Debug)]
pub struct Processes {
    check: fn(&RobotDescription) -> Result<(), BoardError>,
    programs: [(&'static str, Run); 5],
}

impl Processes {
    /// Returns the programs of a robot with boards `B`.
    #[must_use]
    pub const fn on<B: SimBoards>() -> Self {
        Self {
            check: B::check,
            programs: [
                ("master", |arguments| linux::run(&Master, arguments)),
                ("plant", |arguments| {
                    linux::run(&Plant::<B>::new(), arguments)
                }),
                ("replay", |arguments| linux::run(&Replay, arguments)),
                ("servo", |arguments| {
                    linux::run(&Servo::<B>::new(), arguments)
                }),
                ("table", |arguments| {
                    linux::run(&Table::<B>::new(), arguments)
                }),
            ],
        }
    }

    /// Returns the programs, each with its name.
    #[must_use]
    pub const fn programs(&self) -> &[(&'static str, Run)] {
        &self.programs
    }

    /// Checks whether the boards can serve a robot.
    ///
    /// # Errors
    /// Returns the [`BoardError`] of [`Boards::check`] if they cannot.
    pub fn check(&self, robot: &RobotDescription) -> Result<(), BoardError> {
        (self.check)(robot)
    }
}
