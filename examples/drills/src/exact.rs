//! A stress of harts alone, in a machine whose time counts instructions: what comes out is the same each
//! time, and a release that is skipped is a fault of the program's.

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use condor_host::cli::AnyError;
use condor_host::harts::{MachineMemory, Map, Order, State};
use condor_mbox::Region;

use crate::summary;

const QEMU: &str = "qemu-system-riscv64";
const HARTS: u8 = 4;
const MEMORY_BYTES: u32 = 64 << 20;
const USER_BYTES: u32 = 64 << 10;
/// An instruction takes 2⁴ ns.
const ICOUNT: &str = "shift=4,sleep=off";
/// How often it is looked whether it is over.
const LOOK: Duration = Duration::from_millis(100);
/// How long a second of the machine may take, and all else, in seconds.
const SLOWEST: u64 = 10;
const PATIENCE: Duration = Duration::from_secs(60);

/// A machine that is switched off when nobody needs it any more.
struct Machine(Child);

impl Drop for Machine {
    fn drop(&mut self) {
        // It may have ended.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Plays it: the arguments are the monitor, the image and how many seconds.
///
/// # Errors
/// What is missing; a stress that goes wrong.
pub(crate) fn run(mut arguments: impl Iterator<Item = String>) -> Result<(), AnyError> {
    let mut argument = || {
        let usage = "usage: drills exact MONITOR IMAGE SECONDS";
        arguments.next().ok_or(usage)
    };
    let (monitor, image) = (argument()?, argument()?);
    let seconds: u64 = argument()?
        .parse()
        .map_err(|error| format!("SECONDS: {error}"))?;
    let image = std::fs::read(&image).map_err(|error| format!("{image}: {error}"))?;

    let directory = tempfile::tempdir_in("/dev/shm")?;
    let numbers: Vec<u8> = (0..HARTS).collect();
    let map = Map::new(MEMORY_BYTES, &numbers, USER_BYTES, 0)?;
    let memory = MachineMemory::create(directory.path().join("memory"), &map)?;
    let peers: Vec<_> = numbers.iter().map(u8::to_string).collect();
    let words = format!(
        "stress\0peers={}\0seconds={seconds}\0exact\0",
        peers.join(",")
    );
    for hart in 0..u32::from(HARTS) {
        let entry = memory.load(hart, &image)?.entry();
        let arguments = words.as_bytes();
        memory.control(hart)?.order(Order { entry, arguments })?;
    }
    let mut machine = switch_on(&memory, monitor.as_ref())?;
    let ended = wait(&mut machine, &memory, seconds);
    drop(machine);
    let mut regions = Vec::new();
    for number in 0..HARTS {
        let offset = map.data.at(number.into());
        let data = memory.region().part(offset, map.data_bytes)?;
        // As the users of the processors see it.
        regions.push((format!("hart {number}"), data));
    }
    let regions = regions.iter().map(|(name, data)| {
        let region = data.part(BELL_BYTES, map.data_bytes - BELL_BYTES);
        region.map(|region| (name.as_str(), region))
    });
    let regions: Vec<(&str, Region<_>)> = regions.collect::<Result<_, _>>()?;
    summary::verdicts(regions.iter().map(|(name, region)| (*name, region)))?;
    ended
}

const BELL_BYTES: u32 = condor_mbox::layout::BELL_BYTES;

fn switch_on(memory: &MachineMemory, monitor: &Path) -> Result<Machine, AnyError> {
    let bytes = memory.map().memory_bytes;
    let file = format!(
        "memory-backend-file,id=ram,size={bytes},share=on,mem-path={}",
        memory.path().display()
    );
    let child = Command::new(QEMU)
        .args(["-machine", "virt,memory-backend=ram", "-bios", "none"])
        .arg("-smp")
        .arg(HARTS.to_string())
        .arg("-m")
        .arg(format!("{}M", bytes >> 20))
        .args(["-object", &file, "-icount", ICOUNT])
        .args(["-display", "none", "-monitor", "none", "-serial", "null"])
        .arg("-kernel")
        .arg(monitor)
        .stdin(Stdio::null())
        .spawn();
    let child = child.map_err(|error| format!("{QEMU}: {error}; it is in qemu-system-misc"))?;
    Ok(Machine(child))
}

/// Waits until all programs have ended.
fn wait(machine: &mut Machine, memory: &MachineMemory, seconds: u64) -> Result<(), AnyError> {
    let deadline = Instant::now() + PATIENCE + Duration::from_secs(SLOWEST * seconds);
    loop {
        let mut running = 0;
        for hart in 0..u32::from(HARTS) {
            match memory.control(hart)?.state()? {
                State::Ended { status: 0, .. } => {}
                State::Off | State::Waits | State::Runs { .. } => running += 1,
                other => return Err(format!("hart {hart}: {other:?}").into()),
            }
        }
        if running == 0 {
            return Ok(());
        }
        if let Some(status) = machine.0.try_wait()? {
            return Err(format!("{QEMU} has ended: {status}").into());
        }
        if Instant::now() >= deadline {
            return Err(format!("{running} harts have not come to an end").into());
        }
        thread::sleep(LOOK);
    }
}
