//! [`Extension`]: kinds of processors and services that an application adds to `condor`.
//!
//! Processes of this machine are an extension that is always there: [`PROCESSES`]. The crate of a
//! board adds its own: [`Application::extensions`](crate::application::Application::extensions) lists it,
//! and nothing in this crate changes.
//!
//! An extension goes through three stages, and each returns the next one: [`Extension::read`]
//! checks the description, [`Group::furnish`] makes what must exist before programs start, and
//! [`StartingExtension::launch`] returns the [`Launch`] that runs the program of a processor.

use core::fmt::Debug;
use std::collections::BTreeSet;
use std::ffi::OsString;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use condor_debug::gateway::Debuggee;
use condor_mbox::Processor;
use condor_mbox::linux::{LinuxDoorbell, LinuxWindow};
use condor_rt::linux::{Environment, FileRange, LoopContext, UioDevice};
use condor_rt::numbers::PROCESSORS;
use condor_toml::{Keys, Spanned, WholeNumber};
use serde::Deserialize;

use crate::error::{AnyError, NamedFileError};
use crate::launch::{ChildProcess, Launch};
use crate::paths::beside;
use crate::system::SystemDirectory;

/// An addition to `condor`: a kind of processors (such as the harts of a board), a service, or
/// both.
pub trait Extension: Sync {
    /// Returns the name of the extension in errors: the path of its type.
    fn name(&self) -> &'static str {
        core::any::type_name::<Self>()
    }

    /// Returns the word that a processor of this kind has as its `kind` in a description; `None` if
    /// the extension has only a service. No other extension of an application has the same word.
    fn kind(&self) -> Option<&'static str> {
        None
    }

    /// Returns the name of the table of a description that belongs to this extension, and of its
    /// service; `None` if it has neither. No other extension of an application has the same table.
    fn table(&self) -> Option<&'static str> {
        None
    }

    /// Returns true if the programs of such processors run on this machine. If so, `program` may be
    /// `"self"`, and is also searched in `PATH`; otherwise it is a file.
    fn runs_here(&self) -> bool {
        false
    }

    /// Reads and checks the keys of this extension in a description. It is called if the
    /// description has the extension's table or a processor of its kind. It reports mistakes by
    /// [`Keys::wrong`]; keys that it does not ask for are reported as unknown.
    ///
    /// Returns `None` if something is wrong.
    fn read(&self, found: &mut ExtensionPart<'_, '_>) -> Option<Box<dyn Group>>;

    /// Returns the program of processor `number`, which is of this kind, for a debugger; `None` if a
    /// debugger of this machine traces its process. `directory` is that of the running system, and
    /// `doorbell` rings processors.
    ///
    /// # Errors
    /// Returns an error if the program cannot be debugged; the text says why.
    fn debuggee(
        &self,
        directory: &SystemDirectory,
        number: Processor,
        doorbell: LinuxDoorbell<PROCESSORS>,
    ) -> Result<Option<Debuggee<LinuxWindow>>, AnyError> {
        let _ = (directory, number, doorbell);
        Ok(None)
    }

    /// Runs the service until SIGTERM, in the process that a supervisor started for it. `arguments`
    /// are the [`arguments`](Service::arguments) of the [`Service`].
    ///
    /// # Errors
    /// Returns an error if the service cannot start, or fails later; the text says why.
    fn serve(&self, arguments: &[String]) -> Result<(), AnyError> {
        let _ = arguments;
        Err("this extension has no service".into())
    }
}

/// The part of a description that [`Extension::read`] checks: the table of the extension, the processors of its kind,
/// and the sizes of the system's memories.
#[derive(Debug)]
#[non_exhaustive]
pub struct ExtensionPart<'a, 't> {
    /// The file of the description, to which paths are relative: see [`beside`] and
    /// [`find_program`](crate::paths::find_program).
    pub file: &'a Path,
    /// The keys of the extension's table; `None` if the description does not have the table.
    pub keys: Option<Keys<'a, 't>>,
    /// The processors of the extension's kind.
    pub processors: Vec<FoundProcessor<'a, 't>>,
    /// The size of the users' region of each processor's `data`, in bytes.
    pub window_bytes: u32,
    /// The size of the bus in bytes; 0 if there is none.
    pub bus_bytes: u32,
    /// The size of the shared memory that belongs to no processor, in bytes; 0 if there is none.
    pub shared_bytes: u32,
    /// Whether the system has a simulated clock.
    pub simulated: bool,
}

impl ExtensionPart<'_, '_> {
    /// Reads the key `serial` of each processor, and returns the paths of the terminal devices that are their serial
    /// ports. Reports a device that another one of these processors has.
    pub fn serial_ports(&mut self) -> Vec<Option<Spanned<PathBuf>>> {
        let mut ports: Vec<Option<Spanned<PathBuf>>> = Vec::new();
        for processor in &mut self.processors {
            let keys = &mut processor.keys;
            let port: Option<Spanned<String>> = keys.get("serial");
            let port = port.map(|it| Spanned::new(it.span(), beside(self.file, it.get_ref())));
            let same = ports
                .iter()
                .flatten()
                .find(|other| Some(*other) == port.as_ref());
            if let Some((other, port)) = same.zip(port.as_ref()) {
                let line = keys.line(other.span().start);
                let text = format!(
                    "the processor with the `serial` in line {line} has this device, too; name another one"
                );
                keys.wrong(&port.span(), text);
            }
            ports.push(port);
        }
        ports
    }
}

/// A processor in a description whose `kind` is that of the extension.
#[derive(Debug)]
#[non_exhaustive]
pub struct FoundProcessor<'a, 't> {
    /// The number of the processor; `None` if the number in the description is wrong.
    pub number: Option<u8>,
    /// The keys of its table.
    pub keys: Keys<'a, 't>,
    /// The file of its program; `None` if the program is one of the running binary.
    pub program: Option<Spanned<PathBuf>>,
    /// The arguments of the program.
    pub arguments: Spanned<Vec<String>>,
}

/// The part of a system that an extension adds, after its description was read and before the system starts.
/// [`Extension::read`] returns it.
pub trait Group: Debug {
    /// Makes, in the directory of the system, the files that must exist before the first program
    /// starts. The directory `mailbox/` exists; an extension that provides the processors' shared
    /// memory says there where that memory lies. Only one in a system may do so.
    ///
    /// # Errors
    /// Returns an error if something cannot be made; the system does not come up then. The text says what it
    /// is.
    fn furnish(&self, directory: &SystemDirectory) -> Result<Box<dyn StartingExtension>, AnyError>;
}

/// The part of a system that an extension adds, while the system starts. [`Group::furnish`] returns it. The supervisor
/// asks it for the memories and the service that the extension provides, and for a [`Launch`] for each of its
/// processors.
pub trait StartingExtension {
    /// Returns the file of the bus; `None` if this extension does not provide the bus.
    fn bus(&self) -> Option<FileRange> {
        None
    }

    /// Returns the file of the shared memory that belongs to no processor; `None` if this extension
    /// does not provide it.
    fn shared_memory(&self) -> Option<FileRange> {
        None
    }

    /// Returns the file of the page of the simulated clock, the memory in which it keeps its state;
    /// `None` if this extension does not provide it.
    fn clock(&self) -> Option<FileRange> {
        None
    }

    /// Returns the service of the extension; `None` if it has none to run.
    fn service(&self) -> Option<Service> {
        None
    }

    /// Returns the [`Launch`] that runs the programs of processor `number`, which is of this kind.
    /// Completes `environment`, the settings of these programs. `doorbell` is the supervisor's.
    ///
    /// # Errors
    /// Returns an error if the processor cannot be provided; the text says why.
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

/// The service of an extension: a process that runs as long as the system. [`Extension::serve`] is its program.
pub struct Service {
    /// The arguments for [`Extension::serve`]. The number of the service is in its
    /// [environment](condor_rt::linux::Environment::read).
    pub arguments: Vec<String>,
    /// The [`Launch`] that runs it: a [`ChildProcess`], or a wrapper of one.
    pub launch: Box<dyn Launch>,
}

/// Furnishes the groups of extensions with these names.
///
/// # Errors
/// The error of a group, or one that names two groups of which both provide the same memory.
pub(crate) fn furnish<'g>(
    groups: impl Iterator<Item = (&'static str, &'g dyn Group)>,
    directory: &SystemDirectory,
) -> Result<Vec<Box<dyn StartingExtension>>, AnyError> {
    let mut all = Vec::new();
    let mut providers = [None; 3];
    for (name, group) in groups {
        let before = entries(&directory.mailbox())?;
        let furnished = group.furnish(directory)?;
        let provided = [
            ("windows", entries(&directory.mailbox())? != before),
            ("bus", furnished.bus().is_some()),
            ("shared memory", furnished.shared_memory().is_some()),
        ];
        for ((what, _), provider) in provided.iter().zip(&mut providers).filter(|it| it.0.1) {
            if let Some(other) = provider.replace(name) {
                return Err(format!(
                    "two extensions provide the {what} of the system: {other} and {name}; \
                     only one of them can be in its description"
                )
                .into());
            }
        }
        all.push(furnished);
    }
    Ok(all)
}

/// The content of a directory: name, number and time of the last change of each file.
fn entries(directory: &Path) -> Result<BTreeSet<(OsString, u64, SystemTime)>, NamedFileError> {
    let entries = std::fs::read_dir(directory).and_then(|entries| {
        let entries = entries.map(|entry| {
            let entry = entry?;
            let metadata = entry.metadata()?;
            Ok((entry.file_name(), metadata.ino(), metadata.modified()?))
        });
        entries.collect()
    });
    entries.map_err(NamedFileError::at("read", directory))
}

/// The extension for processors that are processes of this machine. Every application has it, and `kind = "process"` is
/// the default in a description.
pub const PROCESSES: &dyn Extension = &Processes;

struct Processes;

impl Extension for Processes {
    fn kind(&self) -> Option<&'static str> {
        Some("process")
    }

    fn runs_here(&self) -> bool {
        true
    }

    fn read(&self, found: &mut ExtensionPart<'_, '_>) -> Option<Box<dyn Group>> {
        let ports = found.serial_ports();
        let settings = found.processors.iter_mut().zip(ports);
        let settings = settings.map(|(processor, port)| {
            let keys = &mut processor.keys;
            let loops: Option<LoopContext> = keys.get("loops");
            let cpu: Option<WholeNumber<_, 0, 1023>> = keys.get("cpu");
            let priority: Option<WholeNumber<_, 1, 99>> = keys.get("priority");
            let uio: Vec<WiredDevice> = keys.get("uio").unwrap_or_default();
            Settings {
                number: processor.number,
                loops: loops.unwrap_or_default(),
                cpu: cpu.map(|cpu| cpu.0),
                priority: priority.map(|priority| priority.0),
                uio: uio.into_iter().map(WiredDevice::into_device).collect(),
                serial: port.map(Spanned::into_inner),
            }
        });
        Some(Box::new(ProcessGroup(settings.collect())))
    }
}

/// A UIO device, as it stands in a description.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WiredDevice {
    vector: WholeNumber<u16, 1, 127>,
    file: PathBuf,
}

impl WiredDevice {
    fn into_device(self) -> UioDevice {
        UioDevice {
            vector: self.vector.0,
            path: self.file,
        }
    }
}

/// The way in which a process runs.
#[derive(Clone, Debug)]
struct Settings {
    number: Option<u8>,
    loops: LoopContext,
    cpu: Option<usize>,
    priority: Option<u8>,
    uio: Vec<UioDevice>,
    serial: Option<PathBuf>,
}

#[derive(Clone, Debug)]
struct ProcessGroup(Vec<Settings>);

impl Group for ProcessGroup {
    fn furnish(&self, _: &SystemDirectory) -> Result<Box<dyn StartingExtension>, AnyError> {
        Ok(Box::new(self.clone()))
    }
}

impl StartingExtension for ProcessGroup {
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
            environment.uio.clone_from(&settings.uio);
            environment.serial.clone_from(&settings.serial);
        }
        Ok(Box::new(ChildProcess::new()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Provides windows, or what else its word says.
    #[derive(Debug)]
    struct Board(&'static str);

    impl Group for Board {
        fn furnish(
            &self,
            directory: &SystemDirectory,
        ) -> Result<Box<dyn StartingExtension>, AnyError> {
            if self.0 == "windows" {
                // As `System::in_memory` does, whoever else has done so.
                let path = directory.mailbox().join("system");
                let part = path.with_extension("part");
                std::fs::write(&part, "condor-mbox system 1\n")?;
                std::fs::rename(part, path)?;
            }
            Ok(Box::new(Self(self.0)))
        }
    }

    impl StartingExtension for Board {
        fn bus(&self) -> Option<FileRange> {
            (self.0 == "bus").then(|| FileRange::whole("bus".into()))
        }

        fn shared_memory(&self) -> Option<FileRange> {
            (self.0 == "shared memory").then(|| FileRange::whole("shared".into()))
        }
    }

    #[test]
    fn two_that_provide_the_same_memory_are_refused_by_name() {
        let words = ["windows", "bus", "shared memory"];
        for (first, second) in words.iter().flat_map(|a| words.map(|b| (*a, b))) {
            let path = tempfile::tempdir().expect("a directory");
            let directory = SystemDirectory::at(path.path().into());
            std::fs::create_dir(directory.mailbox()).expect("a directory");
            let groups = [
                ("First", Board(first)),
                ("Other", Board("")),
                ("Second", Board(second)),
            ];
            let groups = groups
                .iter()
                .map(|(name, board)| (*name, board as &dyn Group));
            let refusal = furnish(groups, &directory)
                .err()
                .map(|error| error.to_string());
            let expected =
                format!("two extensions provide the {first} of the system: First and Second;");
            let is_refused = refusal.is_some_and(|text| text.starts_with(&expected));
            assert_eq!(is_refused, first == second, "{first} and {second}");
        }
    }
}
