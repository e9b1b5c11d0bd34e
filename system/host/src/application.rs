//! [`Application`]: the parts that a binary adds to `condor`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use crate::description::SystemDescription;
use crate::error::{AnyError, me};
use crate::extension::Extension;
use crate::robot::{DescribedKey, MotionFiles, MotionSender, Robot};
use crate::system::SystemDirectory;

/// The function of a program: it gets the program's arguments, runs in the process that a
/// supervisor started for it, and returns the exit status. Most such functions call
/// [`linux::run`](condor_rt::linux::run).
pub type ProgramFunction = fn(Vec<String>) -> ExitCode;

/// The parts that a robot's own binary adds to `condor`: programs, commands, extensions, and what `condor` must know of
/// the robot. The `main` of the crate condor-cli takes it. A binary that adds only programs and extensions can use
/// [`Programs`].
pub trait Application: Sync {
    /// Returns the names of the programs of the binary. A description selects one by `program = "self"` and
    /// its name as the first argument.
    fn programs(&self) -> Vec<&'static str>;

    /// Runs `program`, which is one of [`programs`](Self::programs), in the process that a supervisor started
    /// for it, and returns the exit status.
    fn run_program(&self, program: &str, arguments: Vec<String>) -> ExitCode;

    /// Returns the file of the description that commands use if the user names none; `None` if there is no such
    /// file.
    fn description(&self) -> Option<PathBuf> {
        None
    }

    /// Returns further commands of the binary: the name of each, its line in the help, and the function that
    /// gets its arguments.
    fn commands(&self) -> Vec<(&'static str, &'static str, ProgramFunction)> {
        Vec::new()
    }

    /// Returns the extensions: further kinds of processors, and further services.
    fn extensions(&self) -> &[&'static dyn Extension] {
        &[]
    }

    /// Checks the robot's configuration in the file `robot`, which the system description names. `served` are the parts
    /// of the robot that the description allocates to a processor: the number of the processor, and the name of the part.
    /// The default refuses every file.
    ///
    /// # Errors
    /// Returns an error if the configuration is wrong, or a part cannot be served so; the text says where.
    fn check_robot(&self, robot: &Path, served: &[(u8, &str)]) -> Result<(), AnyError> {
        let _ = served;
        Err(format!(
            "{} has no robot of its own, so it does not use a robot's configuration, such as {}; remove the key \
             `robot`, or use the program that was built for the robot",
            me(),
            robot.display()
        )
        .into())
    }

    /// Reads the robot's configuration in the file `robot`, so that people can look at the robot.
    /// The default returns `None`: nothing is drawn.
    ///
    /// # Errors
    /// Returns an error if the file is wrong or cannot be read; the text says where.
    fn robot(&self, robot: &Path) -> Result<Option<Box<dyn Robot>>, AnyError> {
        let _ = robot;
        Ok(None)
    }

    /// Returns the places of parameters, by their names, in the robot's configuration in the file `robot`; `None` for a
    /// parameter that does not stand there. The default finds none.
    fn described_keys(&self, robot: &Path, names: &[&str]) -> Vec<Option<DescribedKey>> {
        let _ = robot;
        vec![None; names.len()]
    }

    /// Returns the motion files of the robot whose configuration is in the file `robot`. `description` is
    /// that of the system that runs, if one does. The default returns `None`: no files are offered.
    ///
    /// # Errors
    /// Returns an error if the motion files cannot be provided; the text says why.
    fn motions(
        &self,
        robot: &Path,
        description: Option<&SystemDescription>,
    ) -> Result<Option<Box<dyn MotionFiles>>, AnyError> {
        let _ = (robot, description);
        Ok(None)
    }

    /// Returns a sender of composed motions to the robot of the system that runs in `directory`. The default
    /// returns `None`: composed motions cannot be sent.
    ///
    /// # Errors
    /// Returns an error if the sender cannot be made; the text says why.
    fn motion_queue(
        &self,
        description: &SystemDescription,
        directory: &SystemDirectory,
    ) -> Result<Option<Box<dyn MotionSender>>, AnyError> {
        let _ = (description, directory);
        Ok(None)
    }

    /// Makes the files and other things that the programs of a system need before they start.
    /// `condor up` calls it before it starts them; no other run of the system is alive then.
    ///
    /// # Errors
    /// Returns an error if something cannot be made; the system is not started then. The text says what it is.
    fn prepare(&self, description: &SystemDescription) -> Result<(), AnyError> {
        let _ = description;
        Ok(())
    }

    /// Prints a summary of the system that runs in `directory`, in addition to the summary of its
    /// loops and messages. In a run without user interface, it is called at the end, before the
    /// programs are stopped.
    ///
    /// # Errors
    /// Returns an error if there is no summary; the text says why.
    fn summarize(
        &self,
        description: &SystemDescription,
        directory: &SystemDirectory,
    ) -> Result<(), AnyError> {
        let _ = (description, directory);
        Ok(())
    }
}

/// An [`Application`] that adds only programs, each with a name, and extensions. A command that is given no description
/// uses `condor.toml` in the working directory.
#[derive(Clone, Copy, Default)]
pub struct Programs<'p> {
    programs: &'p [(&'static str, ProgramFunction)],
    extensions: &'p [&'static dyn Extension],
}

impl<'p> Programs<'p> {
    /// Makes an application with these `programs`: the name of each, by which a description selects it, and its
    /// function. The application has no extensions.
    #[must_use]
    pub const fn new(programs: &'p [(&'static str, ProgramFunction)]) -> Self {
        Self {
            programs,
            extensions: &[],
        }
    }

    /// Sets the extensions: further kinds of processors, and further services. A second call replaces the extensions of
    /// the first one.
    #[must_use]
    pub const fn with(mut self, extensions: &'p [&'static dyn Extension]) -> Self {
        self.extensions = extensions;
        self
    }
}

impl Application for Programs<'_> {
    fn programs(&self) -> Vec<&'static str> {
        self.programs.iter().map(|(name, _)| *name).collect()
    }

    fn run_program(&self, program: &str, arguments: Vec<String>) -> ExitCode {
        let mut programs = self.programs.iter();
        match programs.find(|(name, _)| *name == program) {
            Some((_, run)) => run(arguments),
            None => ExitCode::from(2),
        }
    }

    fn extensions(&self) -> &[&'static dyn Extension] {
        self.extensions
    }
}
