//! [`Extension`]: kinds of processors and services that an application adds to `condor`.
//!
//! Processes are one, [`PROCESSES`], which is always there. A board's crate adds its own:
//! [`Application::extensions`](crate::cli::Application::extensions) names it, and nothing in this crate changes.
//!
//! An extension goes through three stages, each of which makes the next one: [`Extension::read`] checks what a
//! description says, [`Group::furnish`] makes what must be there before programs start, and
//! [`Furnished::launch`] what runs the program of a processor.

use core::fmt::Debug;
use std::path::{Path, PathBuf};

use condor_mbox::Processor;
use condor_mbox::linux::LinuxDoorbell;
use condor_rt::linux::{Environment, FileRange, Loops};
use condor_rt::numbers::PROCESSORS;

use crate::cli::AnyError;
use crate::description::{At, Keys};
use crate::supervisor::{Launch, Process};
use crate::system::SystemDirectory;

/// A kind of processors, a service, or both.
pub trait Extension: Sync {
    /// The word that a processor of this kind has as its `kind` in a description; `None` if the extension is a
    /// service alone.
    fn kind(&self) -> Option<&'static str> {
        None
    }

    /// The table of a description that belongs to this extension, which is also the name of its service.
    fn table(&self) -> Option<&'static str> {
        None
    }

    /// Whether the programs of such processors run on this machine: then `program` may be `"self"`, and is
    /// looked for in `PATH`. Otherwise it is a file.
    fn runs_here(&self) -> bool {
        false
    }

    /// Reads the keys that are this extension's. It is called if the description has the table or a processor
    /// of this kind. What is wrong it tells by [`Keys::wrong`]; a key that it does not ask for is told as
    /// unknown.
    ///
    /// Returns `None` if something is wrong.
    fn read(&self, found: &mut Found<'_, '_>) -> Option<Box<dyn Group>>;

    /// Runs the service, in the process that a supervisor started for it, until SIGTERM. It is given the
    /// arguments of its [`Service`].
    ///
    /// # Errors
    /// Why it does not serve.
    fn serve(&self, arguments: &[String]) -> Result<(), AnyError> {
        let _ = arguments;
        Err("this extension has no service".into())
    }
}

/// What a description says of an extension.
#[derive(Debug)]
#[non_exhaustive]
pub struct Found<'a, 't> {
    /// The file of the description, to which paths are relative: see [`beside`](crate::description::beside) and
    /// [`find_program`](crate::description::find_program).
    pub file: &'a Path,
    /// The table.
    pub keys: Option<Keys<'a, 't>>,
    /// The processors of this kind.
    pub processors: Vec<FoundProcessor<'a, 't>>,
    /// Users' memory of each processor, in bytes.
    pub window_bytes: u32,
    /// Bytes of the bus; 0 if there is none.
    pub bus_bytes: u32,
    /// Bytes of the memory that belongs to no processor; 0 if there is none.
    pub shared_bytes: u32,
}

/// A processor, of which some may be wrong.
#[derive(Debug)]
#[non_exhaustive]
pub struct FoundProcessor<'a, 't> {
    /// Its number.
    pub number: Option<u8>,
    /// Its table.
    pub keys: Keys<'a, 't>,
    /// Its program; `None` if that is one of the application's own.
    pub program: Option<At<PathBuf>>,
    /// What the program is given.
    pub arguments: At<Vec<String>>,
}

/// What an extension has in a system that is described.
pub trait Group: Debug {
    /// Makes what must be there before the first program starts, in the directory of the system. The
    /// directory `mailbox/` is there and empty; an extension that provides memory puts windows there.
    ///
    /// # Errors
    /// Why it cannot be made; the system does not come up.
    fn furnish(&self, directory: &SystemDirectory) -> Result<Box<dyn Furnished>, AnyError>;
}

/// What an extension has in a system that comes up.
pub trait Furnished {
    /// Where the bus is, if it lies in memory that this extension provides.
    fn bus(&self) -> Option<FileRange> {
        None
    }

    /// Where the memory is that belongs to no processor, if it lies in memory that this extension provides.
    fn shared_memory(&self) -> Option<FileRange> {
        None
    }

    /// The service, if it is to run.
    fn service(&self) -> Option<Service> {
        None
    }

    /// Returns what runs the programs of a processor of this kind, and completes what they are told.
    /// `doorbell` is the supervisor's.
    ///
    /// # Errors
    /// Why there is no such processor.
    fn launch(
        &self,
        number: Processor,
        environment: &mut Environment,
        doorbell: LinuxDoorbell<PROCESSORS>,
    ) -> Result<Box<dyn Launch>, AnyError> {
        let _ = (number, environment, doorbell);
        Err("this extension has no processors".into())
    }
}

/// A service of an extension, which runs as long as the system.
pub struct Service {
    /// What [`Extension::serve`] is given. The number of the service is in its
    /// [environment](condor_rt::linux::Environment::read).
    pub arguments: Vec<String>,
    /// What runs it: a [`Process`], or something around one.
    pub launch: Box<dyn Launch>,
}

/// Processes of this machine: the kind of a processor that names none.
pub const PROCESSES: &dyn Extension = &Processes;

struct Processes;

impl Extension for Processes {
    fn kind(&self) -> Option<&'static str> {
        Some("process")
    }

    fn runs_here(&self) -> bool {
        true
    }

    fn read(&self, found: &mut Found<'_, '_>) -> Option<Box<dyn Group>> {
        let loops = Loops::ALL.map(|loops| (loops.word(), loops));
        let settings = found.processors.iter_mut().map(|processor| {
            let keys = &mut processor.keys;
            let loops = keys.word("loops", &loops).unwrap_or_default();
            let cpu = keys.optional_number("cpu", 0..=1023);
            let priority = keys.optional_number("priority", 1..=99);
            Settings {
                number: processor.number,
                loops,
                cpu: cpu.and_then(|cpu| usize::try_from(cpu).ok()),
                priority: priority.and_then(|priority| u8::try_from(priority).ok()),
            }
        });
        Some(Box::new(ProcessGroup(settings.collect())))
    }
}

/// How a process runs.
#[derive(Clone, Copy, Debug)]
struct Settings {
    number: Option<u8>,
    loops: Loops,
    cpu: Option<usize>,
    priority: Option<u8>,
}

#[derive(Clone, Debug)]
struct ProcessGroup(Vec<Settings>);

impl Group for ProcessGroup {
    fn furnish(&self, _: &SystemDirectory) -> Result<Box<dyn Furnished>, AnyError> {
        Ok(Box::new(self.clone()))
    }
}

impl Furnished for ProcessGroup {
    fn launch(
        &self,
        number: Processor,
        environment: &mut Environment,
        _: LinuxDoorbell<PROCESSORS>,
    ) -> Result<Box<dyn Launch>, AnyError> {
        let mut settings = self.0.iter();
        if let Some(settings) = settings.find(|settings| settings.number == Some(number.0)) {
            environment.loops = settings.loops;
            environment.cpu = settings.cpu;
            environment.priority = settings.priority;
        }
        Ok(Box::new(Process::new()))
    }
}
