//! [`Alone`]: harts without a host, in a machine whose time counts instructions.
//!
//! What comes out is the same each time. Nobody starts the harts: the memory says before the machine is
//! switched on what they run.

use std::error::Error;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use condor_mbox::linux::LinuxWindow;
use condor_mbox::{AccessError, Region, layout};
use qemu_virt_host::{HartState, MachineMemory, Map, Qemu, StartOrder};
use tempfile::TempDir;

use crate::stress::SHARED_BYTES;

const QEMU: &str = "qemu-system-riscv64";
const MEMORY_BYTES: u32 = 64 << 20;
const USER_BYTES: u32 = 64 << 10;
/// The time between two looks whether all programs have ended.
const LOOK: Duration = Duration::from_millis(100);

/// Harts that are ready to be switched on, and what they leave behind.
#[derive(Debug)]
pub struct Alone {
    harts: u8,
    memory: MachineMemory,
    /// The directory of the memory, which exists as long as this value.
    _directory: TempDir,
}

impl Alone {
    /// Loads the program in the ELF file `image`, with the arguments `words`, for `harts` harts.
    ///
    /// # Errors
    /// Returns an error if there is no place for the memory, or if the image cannot be read or loaded.
    pub fn new(harts: u8, image: &Path, words: &[&str]) -> Result<Self, Box<dyn Error>> {
        let file = std::fs::read(image).map_err(|error| format!("{}: {error}", image.display()))?;
        let directory = tempfile::tempdir_in("/dev/shm")?;
        let numbers: Vec<u8> = (0..harts).collect();
        let map = Map::new(MEMORY_BYTES, &numbers, USER_BYTES, 0, SHARED_BYTES)?;
        let memory = MachineMemory::create(directory.path().join("memory"), &map)?;
        let arguments: String = words.iter().flat_map(|word| [*word, "\0"]).collect();
        for hart in 0..u32::from(harts) {
            let order = StartOrder {
                entry: memory.load(hart, &file)?.entry(),
                arguments: arguments.as_bytes(),
                simulated: None,
                float_exceptions: false,
            };
            memory.control(hart)?.order(order)?;
        }
        Ok(Self {
            harts,
            memory,
            _directory: directory,
        })
    }

    /// Switches the machine on, whose instructions take 2^`shift` ns each, with the monitor in the ELF
    /// file `monitor`, and waits until all programs have ended well.
    ///
    /// # Errors
    /// Returns an error if the emulator cannot be started or ends before its harts, or if a program does
    /// not end well, or not in time.
    pub fn play(
        &self,
        monitor: &Path,
        shift: u8,
        patience: Duration,
    ) -> Result<(), Box<dyn Error>> {
        let mut machine = self.switch_on(monitor, shift)?;
        let deadline = Instant::now() + patience;
        loop {
            let mut running = 0;
            for hart in 0..self.harts {
                match self.memory.control(hart.into())?.state()? {
                    HartState::Ended { status: 0, .. } => {}
                    HartState::Off | HartState::Waits | HartState::Runs { .. } => running += 1,
                    state => return Err(format!("hart {hart}: {state:?}").into()),
                }
            }
            if running == 0 {
                return Ok(());
            }
            if let Some(status) = machine.0.try_wait()? {
                return Err(format!("{QEMU} has ended: {status}").into());
            }
            if Instant::now() >= deadline {
                return Err(
                    format!("{running} harts have not come to an end within {patience:?}").into(),
                );
            }
            thread::sleep(LOOK);
        }
    }

    /// Returns the users' part of a hart's `data`, in which its program publishes.
    ///
    /// # Errors
    /// Returns an [`AccessError`] if there is no such hart.
    pub fn region(&self, hart: u8) -> Result<Region<LinuxWindow>, AccessError> {
        let (map, bell) = (self.memory.map(), layout::BELL_BYTES);
        let data = map.data.at(hart.into()).saturating_add(bell);
        let bytes = map.data_bytes.saturating_sub(bell);
        self.memory.region().part(data, bytes)
    }

    fn switch_on(&self, monitor: &Path, shift: u8) -> Result<Machine, Box<dyn Error>> {
        let qemu = Qemu {
            command: QEMU.into(),
            monitor: monitor.into(),
            options: vec!["-icount".into(), format!("shift={shift},sleep=off")],
        };
        Command::new(&qemu.command)
            .args(qemu.arguments(&self.memory, None))
            .stdin(Stdio::null())
            .spawn()
            .map(Machine)
            .map_err(|error| format!("{QEMU}: {error}; it is in Debian's qemu-system-misc").into())
    }
}

/// A machine that is switched off when nobody needs it any more.
struct Machine(Child);

impl Drop for Machine {
    fn drop(&mut self) {
        // The machine may have ended by itself.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
