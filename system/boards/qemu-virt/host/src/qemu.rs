//! [`Qemu`]: the machine itself.

use std::path::{Path, PathBuf};

use super::MachineMemory;

/// The command line of QEMU for a machine of harts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Qemu {
    /// The program, `qemu-system-riscv64`.
    pub command: PathBuf,
    /// The ELF file of the monitor, the program in which all harts come up.
    pub monitor: PathBuf,
    /// Further arguments, at the end of those that [`arguments`](Self::arguments) returns.
    pub options: Vec<String>,
}

impl Qemu {
    /// Adds the serial port of the program on a hart to the machine: a 16550 whose line is the terminal device `path`.
    pub fn add_serial_port(&mut self, hart: u32, path: &Path) {
        let port = format!("port{hart}");
        let arguments = [
            "-chardev".into(),
            format!("serial,id={port},path={}", quoted(path)),
            "-device".into(),
            format!("pci-serial,chardev={port},addr={:#x}", hart + 1),
        ];
        // Before cards that take the first slot that is free.
        self.options.splice(0..0, arguments);
    }

    /// Returns all arguments of QEMU for a machine with this memory, [`options`](Self::options)
    /// included. `link` is the path of the socket to which the machine's serial line is connected,
    /// and at which a process must listen already. With `None` the line is connected to nothing.
    #[must_use]
    pub fn arguments(&self, memory: &MachineMemory, link: Option<&Path>) -> Vec<String> {
        let bytes = memory.map().memory_bytes;
        let mut arguments: Vec<String> = [
            "-machine",
            "virt,memory-backend=ram",
            "-bios",
            "none",
            "-display",
            "none",
            "-monitor",
            "none",
            "-chardev",
        ]
        .map(Into::into)
        .into();
        arguments.push(link.map_or("null,id=link".into(), |link| {
            format!("socket,id=link,path={},server=off", quoted(link))
        }));
        arguments.extend(["-serial".into(), "chardev:link".into()]);
        arguments.push("-object".into());
        arguments.push(format!(
            "memory-backend-file,id=ram,size={bytes},mem-path={},share=on",
            quoted(memory.path())
        ));
        arguments.extend(["-m".into(), format!("size={}M", bytes >> 20)]);
        // For a machine that can never have a second hart, QEMU makes atomic instructions of plain ones, which are not
        // atomic for processes of the host.
        let harts = memory.map().harts();
        let smp = format!("cpus={harts},maxcpus={}", harts.max(2));
        arguments.extend(["-smp".into(), smp]);
        arguments.push("-kernel".into());
        arguments.push(self.monitor.to_string_lossy().into_owned());
        arguments.extend_from_slice(&self.options);
        arguments
    }
}

/// A path in a value of an argument: a comma ends a value there, unless it is doubled.
fn quoted(path: &Path) -> String {
    path.to_string_lossy().replace(',', ",,")
}
