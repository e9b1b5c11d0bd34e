//! [`HARTS`]: harts of another machine as a kind of processors, and the machine as a service.

use std::path::PathBuf;

use condor_debug::gateway::Debuggee;
use condor_host::description::{Spanned, WholeNumber};
use condor_host::error::AnyError;
use condor_host::extension::{Extension, ExtensionPart, Group, Service, StartingExtension};
use condor_host::paths::{beside, find_program};
use condor_host::supervisor::Launch;
use condor_host::system::SystemDirectory;
use condor_mbox::Processor;
use condor_mbox::linux::{LinuxDoorbell, LinuxWindow};
use condor_platform::linux::{open_regular, read_regular};
use condor_rt::linux::{Environment, FileRange};
use condor_rt::numbers::PROCESSORS;

use crate::debuggee;
use crate::hart::{MachineProcess, flat};
use crate::{HartImage, HartLauncher, MachineMemory, Map, Power, Qemu, map, service};

const MIB: i64 = 1 << 20;
const MOST_BYTES: i64 = 1 << 30;
type HartNumber = WholeNumber<u32, 0, { map::HARTS as i64 - 1 }>;
/// The program that is the machine, if no other is named.
const QEMU: &str = "qemu-system-riscv64";

/// The extension by which the program `condor` runs harts of QEMU's RISC-V machine `virt`. In the description of a
/// system, it adds processors with `kind = "hart"`, and the table `[machine]`.
pub const HARTS: &dyn Extension = &Harts;

struct Harts;

impl Extension for Harts {
    fn kind(&self) -> Option<&'static str> {
        Some("hart")
    }

    fn table(&self) -> Option<&'static str> {
        Some("machine")
    }

    fn read(&self, found: &mut ExtensionPart<'_, '_>) -> Option<Box<dyn Group>> {
        let (harts, mut is_right) = harts(found);
        let ports = found.serial_ports();
        for ((processor, port), hart) in found.processors.iter().zip(&ports).zip(&harts) {
            if let Some(port) = port
                && hart.get_ref().0 >= map::SERIAL_HARTS
            {
                let text = "only harts 0 to 3 can have a serial port; use one of them, or leave `serial` out";
                processor.keys.wrong(&port.span(), text);
                is_right = false;
            }
        }
        let Some(keys) = &mut found.keys else {
            let text = "a processor of `kind = \"hart\"` needs a machine; add the table `[machine]`, or use another \
                        kind";
            if let Some((first, hart)) = found.processors.first().zip(harts.first()) {
                first.keys.wrong(&hart.span(), text);
            }
            return None;
        };
        if found.processors.is_empty() {
            let text = "no processor is a hart of this machine; add one with `kind = \"hart\"` and `hart = 0`";
            keys.wrong(&keys.span(), text);
            is_right = false;
        }
        keys.word("kind", &[("qemu-riscv-virt", ())]);
        let memory_bytes: Option<Spanned<WholeNumber<u32, MIB, MOST_BYTES, MIB>>> =
            keys.need("memory_bytes", "a multiple of 1048576");
        let expected = "the path of the monitor, the program with which harts start";
        let monitor: Option<Spanned<String>> = keys.need("monitor", expected);
        let command: Option<Spanned<String>> = keys.get("qemu");
        let options = keys.get("options");
        let command = command.unwrap_or_else(|| Spanned::new(keys.span(), QEMU.into()));
        let command_path = find_program(found.file, command.get_ref());
        if command_path.is_err() {
            let text = format!(
                "the simulator of the machine, `{command}`, is not found: install QEMU (package \
                 qemu-system-misc of Debian and Ubuntu), or give its path with the key `qemu`"
            );
            keys.wrong(&command.span(), text);
        }
        let (memory_bytes, monitor) = (memory_bytes?, monitor?);
        let path = beside(found.file, monitor.get_ref());
        if let Err(error) = open_regular(&path) {
            keys.wrong(
                &monitor.span(),
                format!("cannot read {}: {error}", path.display()),
            );
        }
        let mut qemu = Qemu {
            command: command_path.ok()?,
            monitor: path,
            options: options.unwrap_or_default(),
        };
        for (port, hart) in ports.iter().zip(&harts) {
            if let Some(port) = port {
                qemu.add_serial_port(hart.get_ref().0, port.get_ref());
            }
        }
        if !is_right {
            return None;
        }
        let numbers = found.processors.iter().zip(&harts);
        let numbers = numbers.map(|(one, hart)| Some((hart.get_ref().0, one.number?)));
        let mut numbers = numbers.collect::<Option<Vec<_>>>()?;
        numbers.sort_unstable();
        let numbers: Vec<_> = numbers.into_iter().map(|(_, number)| number).collect();
        let bytes = memory_bytes.get_ref().0;
        let (window, bus, shared) = (found.window_bytes, found.bus_bytes, found.shared_bytes);
        let map = match Map::new(bytes, &numbers, window, bus, shared) {
            Ok(map) => map,
            Err(error) => {
                keys.wrong(&memory_bytes.span(), error);
                return None;
            }
        };
        programs(found, &harts, &map)?;
        Some(Box::new(HartGroup { map, qemu }))
    }

    fn debuggee(
        &self,
        directory: &SystemDirectory,
        number: Processor,
        doorbell: LinuxDoorbell<PROCESSORS>,
    ) -> Result<Option<Debuggee<LinuxWindow>>, AnyError> {
        let memory = MachineMemory::open(memory_file(directory))?;
        debuggee::of(&memory, number, doorbell).map(Some)
    }

    fn serve(&self, arguments: &[String]) -> Result<(), AnyError> {
        let [memory, link, command, monitor, options @ ..] = arguments else {
            return Err(
                "give the arguments MEMORY LINK QEMU MONITOR OPTIONS…: the file of the machine's memory, the path of \
                 the socket to make, the command of QEMU, the ELF file of the monitor, further options of QEMU"
                    .into(),
            );
        };
        let qemu = Qemu {
            command: command.into(),
            monitor: monitor.into(),
            options: options.to_vec(),
        };
        service::serve(memory.as_ref(), link.as_ref(), &qemu)
    }
}

/// The harts of all processors that have one, and whether each is one processor and none is left out.
fn harts(found: &mut ExtensionPart<'_, '_>) -> (Vec<Spanned<HartNumber>>, bool) {
    let mut harts: Vec<Spanned<HartNumber>> = Vec::new();
    let mut is_right = true;
    for processor in &mut found.processors {
        let keys = &mut processor.keys;
        let Some(hart) = keys.need("hart", "a whole number from 0 to 11") else {
            is_right = false;
            continue;
        };
        if let Some(other) = harts.iter().find(|other| **other == hart) {
            let line = keys.line(other.span().start);
            is_right = false;
            let text = format!(
                "the processor in line {line} has hart {}, too; choose another hart",
                hart.get_ref().0
            );
            keys.wrong(&hart.span(), text);
        }
        harts.push(hart);
    }
    if let Some(last) = harts.iter().max_by_key(|hart| hart.get_ref().0)
        && let Some(first) = found.processors.first()
    {
        let is_missing = |wanted: &u32| harts.iter().all(|hart| hart.get_ref().0 != *wanted);
        if let Some(missing) = (0..last.get_ref().0).find(is_missing) {
            let text = format!(
                "this is hart {}, but no processor is hart {missing}; number harts from 0 on without a gap",
                last.get_ref().0
            );
            first.keys.wrong(&last.span(), text);
            is_right = false;
        }
    }
    (harts, is_right)
}

/// Each hart has room for its program.
fn programs(found: &ExtensionPart<'_, '_>, harts: &[Spanned<HartNumber>], map: &Map) -> Option<()> {
    let mut is_right = true;
    for (processor, hart) in found.processors.iter().zip(harts) {
        let hart = hart.get_ref().0;
        let program = processor.program.as_ref()?;
        let path = program.get_ref();
        let bytes = read_regular(path).ok()?;
        if let Err(error) = HartImage::new(&bytes, map, hart) {
            let text = format!("hart {hart} cannot run {}: {error}", path.display());
            processor.keys.wrong(&program.span(), text);
            is_right = false;
        }
        if let Err(error) = flat(processor.arguments.get_ref()) {
            let span = processor.arguments.span();
            processor.keys.wrong(&span, error);
            is_right = false;
        }
    }
    is_right.then_some(())
}

#[derive(Debug)]
struct HartGroup {
    map: Map,
    qemu: Qemu,
}

impl Group for HartGroup {
    fn furnish(&self, directory: &SystemDirectory) -> Result<Box<dyn StartingExtension>, AnyError> {
        let path = memory_file(directory);
        let memory = MachineMemory::create(&path, &self.map)?;
        memory.system(&directory.mailbox())?;
        Ok(Box::new(FurnishedHarts {
            link: directory.path().join("link"),
            path,
            memory,
            qemu: self.qemu.clone(),
            power: Power::new(),
        }))
    }
}

/// The file of the machine's memory.
fn memory_file(directory: &SystemDirectory) -> PathBuf {
    directory.path().join("memory")
}

struct FurnishedHarts {
    path: PathBuf,
    link: PathBuf,
    memory: MachineMemory,
    qemu: Qemu,
    power: Power,
}

impl StartingExtension for FurnishedHarts {
    fn bus(&self) -> Option<FileRange> {
        self.memory.bus()
    }

    fn shared_memory(&self) -> Option<FileRange> {
        self.memory.shared_memory()
    }

    fn clock(&self) -> Option<FileRange> {
        self.memory.clock()
    }

    fn service(&self) -> Option<Service> {
        let Qemu {
            command,
            monitor,
            options,
        } = &self.qemu;
        let paths = [&self.path, &self.link, command, monitor];
        let paths = paths.map(|path| path.to_string_lossy().into_owned());
        Some(Service {
            arguments: paths.into_iter().chain(options.iter().cloned()).collect(),
            launch: Box::new(MachineProcess::new(self.memory.clone(), self.power.clone())),
        })
    }

    fn launch(
        &self,
        number: Processor,
        _: &mut Environment,
        doorbell: LinuxDoorbell<PROCESSORS>,
    ) -> Result<Box<dyn Launch>, AnyError> {
        let mut numbers = self.memory.map().numbers.iter();
        let hart = numbers.position(|it| *it == number.0);
        let hart = hart
            .and_then(|hart| u32::try_from(hart).ok())
            .unwrap_or(u32::MAX);
        let hart = HartLauncher::new(self.memory.clone(), hart, doorbell, self.power.clone())?;
        Ok(Box::new(hart))
    }
}
