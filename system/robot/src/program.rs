//! The program `condor` for a robot.

use std::boxed::Box;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::string::String;
use std::vec::Vec;

use condor_cli::{AnyError, Application, ProgramFunction, Programs};
use condor_host::description::{Files, SystemDescription, served};
use condor_host::extension::Extension;
use condor_host::robot::{DescribedKey, MotionFiles, MotionSender, Robot};
use condor_host::system::SystemDirectory;
use condor_platform::linux::read_text;
use condor_scene::{Ball, HandView};

use crate::RobotDescription;
use crate::compile::{CompileError, compile_all, read_robot};
use crate::processes::Processes;

mod keys;
mod motion;
mod offers;
mod points;
mod summary;
mod texts;

use offers::Offers;
use texts::Texts;

/// The variables that tell of the ball.
const BALL: Ball<'_> = Ball {
    center: ["ball.x", "ball.y", "ball.z"],
    radius_m: "object.radius_m",
    touching: "ball.touching",
};

/// A command: its name, its line in the help, and the function that gets its arguments.
type Command = (&'static str, &'static str, ProgramFunction);

/// The program of a robot: `condor` with the programs of the robot's processors, its motions, its view and
/// its simulator.
#[derive(Clone, Copy)]
pub struct RobotApplication {
    system: &'static str,
    processes: &'static Processes,
    own: Programs<'static>,
    commands: &'static [Command],
    extensions: &'static [&'static dyn Extension],
}

impl RobotApplication {
    /// Makes the program of the robot in the system description `system`, which is used when the command line
    /// names no other. `processes` are those of the robot's boards.
    #[must_use]
    pub const fn new(system: &'static str, processes: &'static Processes) -> Self {
        Self {
            system,
            processes,
            own: Programs::new(&[]),
            commands: &[],
            extensions: &[],
        }
    }

    /// Adds programs with their names, for processors that do something peculiar to the robot. A program with the name
    /// of a usual one takes its place.
    #[must_use]
    pub const fn with_programs(self, programs: &'static [(&'static str, ProgramFunction)]) -> Self {
        let own = Programs::new(programs);
        Self { own, ..self }
    }

    /// Adds commands: the name of each, its line in the help, and the function that gets its arguments.
    #[must_use]
    pub const fn with_commands(self, commands: &'static [Command]) -> Self {
        Self { commands, ..self }
    }

    /// Adds kinds of processors, such as harts of a board, that system descriptions may name.
    #[must_use]
    pub const fn with_extensions(self, extensions: &'static [&'static dyn Extension]) -> Self {
        Self { extensions, ..self }
    }

    fn of_boards(&self) -> Programs<'static> {
        Programs::new(self.processes.programs())
    }

    fn read(&self, robot: &Path) -> Result<RobotDescription, CompileError> {
        self.read_served(robot, &[])
    }

    fn read_served(
        &self,
        robot: &Path,
        served: &[(u8, &str)],
    ) -> Result<RobotDescription, CompileError> {
        read_robot(robot, served, |robot| self.processes.check(robot))
    }

    /// Executes the command line, and returns the exit status.
    #[must_use]
    pub fn run(&self) -> ExitCode {
        condor_cli::main(self)
    }
}

impl Application for RobotApplication {
    fn programs(&self) -> Vec<&'static str> {
        let own = self.own.programs();
        let mut programs = self.of_boards().programs();
        programs.retain(|name| !own.contains(name));
        [programs, own].concat()
    }

    fn run_program(&self, program: &str, arguments: Vec<String>) -> ExitCode {
        if self.own.programs().contains(&program) {
            self.own.run_program(program, arguments)
        } else {
            self.of_boards().run_program(program, arguments)
        }
    }

    fn description(&self) -> Option<PathBuf> {
        Some(self.system.into())
    }

    fn commands(&self) -> Vec<Command> {
        [
            &[("motion", motion::ABOUT, motion::run as ProgramFunction)],
            self.commands,
        ]
        .concat()
    }

    fn extensions(&self) -> &[&'static dyn Extension] {
        self.extensions
    }

    fn check_robot(&self, robot: &Path, served: &[(u8, &str)]) -> Result<(), AnyError> {
        self.read_served(robot, served)?;
        Ok(())
    }

    fn robot(&self, robot: &Path) -> Result<Option<Box<dyn Robot>>, AnyError> {
        let hand = HandView::new(&self.read(robot)?);
        Ok(Some(Box::new(hand.with_ball(&BALL))))
    }

    fn described_keys(&self, robot: &Path, names: &[&str]) -> Vec<Option<DescribedKey>> {
        let texts = self.read(robot).ok().zip(read_text(robot).ok());
        let key = |name: &&str| keys::find(&texts.as_ref()?.0, &texts.as_ref()?.1, name);
        names.iter().map(key).collect()
    }

    fn motions(
        &self,
        robot: &Path,
        description: Option<&SystemDescription>,
    ) -> Result<Option<Box<dyn MotionFiles>>, AnyError> {
        let texts = match description {
            Some(description) => description.files.as_ref().map(texts_of),
            None => Some(Path::new(self.system).with_file_name("")),
        };
        let Some(texts) = texts else { return Ok(None) };
        Ok(Some(Box::new(Texts {
            directory: texts.join("motions"),
            robot: self.read(robot)?,
        })))
    }

    fn motion_queue(
        &self,
        description: &SystemDescription,
        directory: &SystemDirectory,
    ) -> Result<Option<Box<dyn MotionSender>>, AnyError> {
        let (Some(hand), Some(files)) = (&description.robot, &description.files) else {
            return Ok(None);
        };
        let robot = self.read(hand)?;
        Ok(Some(Box::new(Offers::new(directory, &files.root, robot))))
    }

    fn prepare(&self, description: &SystemDescription) -> Result<(), AnyError> {
        let (Some(hand), Some(files)) = (&description.robot, &description.files) else {
            return Ok(());
        };
        offers::clear(&files.root);
        Ok(compile_all(
            &self.read_served(hand, &served(&description.processors))?,
            &texts_of(files),
            &files.root,
        )?)
    }

    fn summarize(
        &self,
        description: &SystemDescription,
        directory: &SystemDirectory,
    ) -> Result<(), AnyError> {
        let robot = description.robot.as_ref();
        let robot = robot.ok_or("the description of the system has no key `robot`")?;
        let robot = self.read_served(robot, &served(&description.processors))?;
        summary::of(&robot, description, directory)
    }
}

/// Returns the directory with the texts of what is compiled into these files.
fn texts_of(files: &Files) -> PathBuf {
    files.root.with_file_name("")
}
