//! [`Peek`]: the variables of a program by their names in its debug information, while it runs.

use std::fs::{File, read_link};
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};

use condor_debug::gateway::Debuggee;
use condor_debug::names::{self, Names, Number};
use condor_mbox::linux::LinuxWindow;
use condor_platform::linux::{read_regular, read_text};

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
    memory: Memory,
    path: PathBuf,
    file: Vec<u8>,
}

enum Memory {
    Hart(Debuggee<LinuxWindow>),
    /// The memory of a process, whose addresses are by `bias` above those of its file. The file begins at `first`.
    Process {
        memory: File,
        bias: u64,
        first: u64,
    },
}

/// The place of a number in the memory of a program.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NumberAt {
    address: u64,
    bytes: usize,
    number: Number,
}

impl Peek {
    /// Opens the program of a processor.
    pub(crate) fn open(
        extensions: &[&'static dyn Extension],
        directory: &SystemDirectory,
        status: &SystemStatus,
        member: &Member,
        view: &View,
    ) -> Result<Self, AnyError> {
        let debuggee = debuggee(extensions, directory, member, view)?;
        let path = match (&debuggee, member.pid) {
            (Some(_), _) => beside(status.file.as_ref(), &member.program),
            (None, Some(pid)) => format!("/proc/{pid}/exe").into(),
            (None, None) => {
                let name = &member.name;
                return Err(format!(
                    "the program of {name} does not run; `start {name}` starts it"
                )
                .into());
            }
        };
        let file = read_regular(&path).map_err(NamedFileError::at("read", &path))?;
        let memory = match (debuggee, member.pid) {
            (Some(debuggee), _) => Memory::Hart(debuggee),
            (None, pid) => process(&path, &file, pid.unwrap_or_default())?,
        };
        Ok(Self { memory, path, file })
    }

    /// The names of the program.
    pub(crate) fn names(&self) -> Result<Names<'_>, AnyError> {
        let names = Names::read(&self.file);
        names.map_err(|error| format!("{}: {error}", self.path.display()).into())
    }

    /// Returns false if the process of the program has ended.
    pub(crate) fn is_there(&self) -> bool {
        match &self.memory {
            Memory::Hart(_) => true,
            Memory::Process { first, .. } => self.read(*first, 1).is_some(),
        }
    }

    /// Reads what lies at an address of the program's file; `None` if the program has no memory there.
    pub(crate) fn read(&self, address: u64, bytes: usize) -> Option<Vec<u8>> {
        match &self.memory {
            Memory::Hart(debuggee) => debuggee.read(address.wrapping_add(debuggee.bias), bytes),
            Memory::Process { memory, bias, .. } => {
                let mut read = vec![0; bytes];
                let at = address.wrapping_add(*bias);
                memory.read_exact_at(&mut read, at).ok().map(|()| read)
            }
        }
    }

    /// Writes to an address of the program's file; `None` if the program has no memory there.
    pub(crate) fn write(&self, address: u64, bytes: &[u8]) -> Option<()> {
        match &self.memory {
            Memory::Hart(debuggee) => debuggee.write(address.wrapping_add(debuggee.bias), bytes),
            Memory::Process { memory, bias, .. } => {
                memory.write_all_at(bytes, address.wrapping_add(*bias)).ok()
            }
        }
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

/// Opens the memory of a process that runs the program `file`, which is at `path`.
fn process(path: &Path, file: &[u8], pid: u32) -> Result<Memory, AnyError> {
    let first = names::first_address(file)?;
    let maps = PathBuf::from(format!("/proc/{pid}/maps"));
    let text = read_text(&maps).map_err(NamedFileError::at("read", &maps))?;
    let program = read_link(path).map_err(NamedFileError::at("read", path))?;
    let start = (text.lines()).find_map(|line| start_of(line, &program.to_string_lossy()));
    let start = start.ok_or_else(|| format!("{} has no program yet", maps.display()))?;
    let path = PathBuf::from(format!("/proc/{pid}/mem"));
    let memory = File::options().read(true).write(true).open(&path);
    let memory = memory.map_err(|error| {
        let path = path.display();
        format!(
            "cannot open {path}: {error}; as for GDB, be root or set kernel.yama.ptrace_scope to 0"
        )
    })?;
    let bias = start.wrapping_sub(first);
    Ok(Memory::Process {
        memory,
        bias,
        first,
    })
}

/// Returns where a line of `/proc/PID/maps` says that the beginning of the file `program` lies.
fn start_of(line: &str, program: &str) -> Option<u64> {
    let mut words = line.splitn(6, ' ');
    let (start, _) = words.next()?.split_once('-')?;
    let offset = words.nth(1)?;
    let is_program = words.nth(2)?.trim_start() == program;
    let is_beginning = u64::from_str_radix(offset, 16) == Ok(0);
    (is_program && is_beginning).then_some(u64::from_str_radix(start, 16).ok()?)
}
