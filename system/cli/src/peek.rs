//! [`Peek`]: the variables of a hart's program by their names in its debug information, while it runs.

use condor_debug::gateway::Debuggee;
use condor_debug::names::{Names, Number};
use condor_mbox::linux::LinuxWindow;
use condor_platform::linux::read_regular;

use condor_host::control::{Member, SystemStatus};
use condor_host::error::{AnyError, NamedFileError};
use condor_host::extension::Extension;
use condor_host::paths::beside;
use condor_host::system::SystemDirectory;
use condor_host::view::View;

/// The program of a processor, for a debugger; `None` if it is a process of this machine.
pub(crate) fn debuggee(
    extensions: &[&'static dyn Extension],
    directory: &SystemDirectory,
    member: &Member,
    view: &View,
) -> Result<Option<Debuggee<LinuxWindow>>, AnyError> {
    let mut extensions = extensions.iter();
    let Some(extension) = extensions.find(|it| it.kind() == Some(&member.kind)) else {
        return Ok(None);
    };
    let doorbell = view.post().doorbell().doorbell().clone();
    extension.debuggee(directory, member.processor(), doorbell)
}

/// The memory of a program, and its file.
pub(crate) struct Peek {
    debuggee: Debuggee<LinuxWindow>,
    path: std::path::PathBuf,
    file: Vec<u8>,
}

/// The place of a number in the memory of a program.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NumberAt {
    address: u64,
    bytes: usize,
    number: Number,
}

impl Peek {
    /// Opens the program of a processor; `None` if it is a process of this machine.
    pub(crate) fn open(
        extensions: &[&'static dyn Extension],
        directory: &SystemDirectory,
        status: &SystemStatus,
        member: &Member,
        view: &View,
    ) -> Result<Option<Self>, AnyError> {
        let Some(debuggee) = debuggee(extensions, directory, member, view)? else {
            return Ok(None);
        };
        let path = beside(status.file.as_ref(), &member.program);
        let file = read_regular(&path).map_err(NamedFileError::at("read", &path))?;
        Ok(Some(Self {
            debuggee,
            path,
            file,
        }))
    }

    /// The names of the program.
    pub(crate) fn names(&self) -> Result<Names<'_>, AnyError> {
        let names = Names::read(&self.file);
        names.map_err(|error| format!("{}: {error}", self.path.display()).into())
    }

    /// Reads what lies at an address of the program's file; `None` if the program has no memory there.
    pub(crate) fn read(&self, address: u64, bytes: usize) -> Option<Vec<u8>> {
        self.debuggee.read(self.at(address), bytes)
    }

    /// Writes to an address of the program's file; `None` if the program has no memory there.
    pub(crate) fn write(&self, address: u64, bytes: &[u8]) -> Option<()> {
        self.debuggee.write(self.at(address), bytes)
    }

    const fn at(&self, address: u64) -> u64 {
        address.wrapping_add(self.debuggee.bias)
    }

    /// Finds a number by an expression.
    pub(crate) fn number(&self, expression: &str) -> Result<NumberAt, AnyError> {
        let names = self.names()?;
        let value = names.find(expression)?;
        let number = value.number();
        let number = number.ok_or_else(|| format!("`{expression}` is not a single number"))?;
        Ok(NumberAt {
            address: value.address,
            bytes: value.bytes,
            number,
        })
    }

    /// Reads a number; one that cannot be read is none.
    pub(crate) fn value(&self, it: NumberAt) -> f64 {
        let bytes = self.read(it.address, it.bytes);
        bytes.map_or(f64::NAN, |bytes| it.number.value(&bytes))
    }
}
