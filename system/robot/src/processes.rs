//! The programs of a robot as processes of Linux.

use core::marker::PhantomData;
use std::process::ExitCode;
use std::string::String;
use std::vec::Vec;

use condor_rt::linux;

use crate::RobotDescription;
use crate::boards::{BoardError, Boards, SimBoards};
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
    programs: &'static [(&'static str, Run)],
}

/// The programs of a robot with boards `B`.
struct On<B>(PhantomData<B>);

impl<B: Boards> On<B> {
    const MASTER: (&'static str, Run) = ("master", |arguments| linux::run(&Master, arguments));
    const REPLAY: (&'static str, Run) = ("replay", |arguments| linux::run(&Replay, arguments));
    const SERVO: (&'static str, Run) = ("servo", |arguments| {
        linux::run(&Servo::<B>::new(), arguments)
    });
    const TABLE: (&'static str, Run) = ("table", |arguments| {
        linux::run(&Table::<B>::new(), arguments)
    });
    const REAL: &'static [(&'static str, Run)] =
        &[Self::MASTER, Self::REPLAY, Self::SERVO, Self::TABLE];
}

impl<B: SimBoards> On<B> {
    const PLANT: (&'static str, Run) = ("plant", |arguments| {
        linux::run(&Plant::<B>::new(), arguments)
    });
    const SIMULATED: &'static [(&'static str, Run)] = &[
        Self::MASTER,
        Self::PLANT,
        Self::REPLAY,
        Self::SERVO,
        Self::TABLE,
    ];
}

impl Processes {
    /// Returns the programs of a robot with boards `B`: `master`, `replay`, `servo` and `table`.
    #[must_use]
    pub const fn on<B: Boards>() -> Self {
        let (check, programs) = (B::check as fn(&_) -> _, On::<B>::REAL);
        Self { check, programs }
    }

    /// Returns the programs of a robot with boards `B`, which may also be simulated: those of [`on`](Self::on), and
    /// `plant`.
    #[must_use]
    pub const fn simulated_on<B: SimBoards>() -> Self {
        let (check, programs) = (B::check as fn(&_) -> _, On::<B>::SIMULATED);
        Self { check, programs }
    }

    /// Returns the programs, each with its name.
    #[must_use]
    pub const fn programs(&self) -> &'static [(&'static str, Run)] {
        self.programs
    }

    /// Checks whether the boards can serve a robot.
    ///
    /// # Errors
    /// Returns the [`BoardError`] of [`Boards::check`] if they cannot.
    pub fn check(&self, robot: &RobotDescription) -> Result<(), BoardError> {
        (self.check)(robot)
    }
}
