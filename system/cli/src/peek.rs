//! [`Peek`]: the variables of a program by their names in its debug information, while it runs.

use std::fs::{self, File, read_link};
use std::os::fd::AsRawFd as _;
use std::os::unix::fs::FileExt as _;
use std::path::PathBuf;

use condor_debug::gateway::Debuggee;
use condor_debug::names::{self, Names, Number};
use condor_mbox::linux::LinuxWindow;
use condor_platform::linux::read_regular;

use condor_host::control::{ControlClient, Member, SystemStatus};
use condor_host::error::{AnyError, NamedFileError};
use condor_host::extension::Extension;
use condor_host::paths::beside;
use condor_host::system::SystemDirectory;
use condor_host::view::View;

/// The kind of the value in the auxiliary vector of a process that is the address at which its program begins.
const AT_ENTRY: usize = 9;

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
    /// The memory of a process, whose addresses are by `bias` above those of its file. The program begins at `entry`.
    Process {
        memory: File,
        bias: u64,
        entry: u64,
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
        if let Some(debuggee) = debuggee(extensions, directory, member, view)? {
            let path = beside(status.file.as_ref(), &member.program);
            let file = read_regular(&path).map_err(NamedFileError::at("read", &path))?;
            let memory = Memory::Hart(debuggee);
            return Ok(Self { memory, path, file });
        }
        let name = &member.name;
        let process = member.pid.map(ProcessFiles::open).transpose()?;
        let process = process.ok_or_else(|| {
            format!("the program of {name} does not run; `start {name}` starts it")
        })?;
        let now = ControlClient::connect(directory)?.status()?;
        if now.processor(name)?.pid != Some(process.pid) {
            return Err(format!("the program of {name} has just ended; try again").into());
        }
        let link = process.path("exe");
        let path = read_link(&link).map_err(NamedFileError::at("read", &link))?;
        let file = read_regular(&link).map_err(NamedFileError::at("read", &path))?;
        let memory = process.memory(&file)?;
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
            Memory::Process { entry, .. } => self.read(*entry, 1).is_some(),
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

/// A process whose program is read. It is not mistaken for another one that gets its number later.
struct ProcessFiles {
    pid: u32,
    directory: File,
}

impl ProcessFiles {
    fn open(pid: u32) -> Result<Self, AnyError> {
        let path = PathBuf::from(format!("/proc/{pid}"));
        let directory = File::open(&path).map_err(NamedFileError::at("open", &path))?;
        Ok(Self { pid, directory })
    }

    fn path(&self, name: &str) -> PathBuf {
        format!("/proc/self/fd/{}/{name}", self.directory.as_raw_fd()).into()
    }

    /// Opens the memory, in which the program `file` lies.
    fn memory(&self, file: &[u8]) -> Result<Memory, AnyError> {
        let entry = names::entry(file)?;
        let pid = self.pid;
        let vector = fs::read(self.path("auxv"));
        let vector = vector.map_err(NamedFileError::at("read", format!("/proc/{pid}/auxv")))?;
        let words: Vec<_> = vector
            .as_chunks()
            .0
            .iter()
            .map(|it| usize::from_ne_bytes(*it))
            .collect();
        let mut pairs = words.as_chunks().0.iter();
        let loaded = pairs.find_map(|[kind, value]| (*kind == AT_ENTRY).then_some(*value as u64));
        let loaded = loaded.ok_or_else(|| format!("process {pid} has no program yet"))?;
        let memory = File::options()
            .read(true)
            .write(true)
            .open(self.path("mem"));
        let memory = memory.map_err(|error| {
            format!(
                "cannot open the memory of process {pid}: {error}; as for GDB, be root or set \
                 kernel.yama.ptrace_scope to 0"
            )
        })?;
        let bias = loaded.wrapping_sub(entry);
        Ok(Memory::Process {
            memory,
            bias,
            entry,
        })
    }
}
