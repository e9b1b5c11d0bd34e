//! [`Alone`]: harts without a host, in a machine whose time counts instructions.
//!
//! What comes out is the same each time. Nobody starts the harts: the memory says before the machine is
//! switched on what they run.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use condor_mbox::linux::LinuxWindow;
use condor_mbox::{AccessError, Region, layout};
use qemu_virt_host::{HartState, MachineMemory, Map, MapError, MemoryError, Order, Qemu};
use tempfile::TempDir;

use crate::stress::SHARED_BYTES;

const QEMU: &str = "qemu-system-riscv64";
const MEMORY_BYTES: u32 = 64 << 20;
const USER_BYTES: u32 = 64 << 10;
/// How often it is looked whether it is over.
const LOOK: Duration = Duration::from_millis(100);

/// Harts that are ready to be switched on, and what they leave behind.
#[derive(Debug)]
pub struct Alone {
    harts: u8,
    memory: MachineMemory,
    /// Where the memory is, as long as this is there.
    _directory: TempDir,
}

/// Why harts do not come to an end.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AloneError {
    /// No place for the memory.
    #[error("cannot make a directory in /dev/shm: {0}")]
    Directory(std::io::Error),
    /// How it is laid out.
    #[error(transparent)]
    Map(#[from] MapError),
    /// The memory.
    #[error(transparent)]
    Memory(#[from] MemoryError),
    /// The memory.
    #[error(transparent)]
    Access(#[from] AccessError),
    /// The image cannot be read.
    #[error("{path:?}: {source}")]
    Image {
        /// Which.
        path: PathBuf,
        /// The answer.
        source: std::io::Error,
    },
    /// The emulator cannot be started.
    #[error("{QEMU}: {0}; it is in Debian's qemu-system-misc")]
    Qemu(std::io::Error),
    /// The emulator has ended before its harts.
    #[error("{QEMU} has ended: {0}")]
    Ended(ExitStatus),
    /// A program has not gone well.
    #[error("hart {hart}: {state:?}")]
    Hart {
        /// Whose.
        hart: u8,
        /// What became of it.
        state: HartState,
    },
    /// Harts that run for ever.
    #[error("{running} harts have not come to an end within {patience:?}")]
    Late {
        /// How many.
        running: u32,
        /// How long they had.
        patience: Duration,
    },
}

impl Alone {
    /// As many harts with the program in the ELF file `image`, whose arguments are `words`.
    ///
    /// # Errors
    /// [`AloneError`].
    pub fn new(harts: u8, image: &Path, words: &[&str]) -> Result<Self, AloneError> {
        let file = std::fs::read(image).map_err(|source| AloneError::Image {
            path: image.into(),
            source,
        })?;
        let directory = tempfile::tempdir_in("/dev/shm").map_err(AloneError::Directory)?;
        let numbers: Vec<u8> = (0..harts).collect();
        let map = Map::new(MEMORY_BYTES, &numbers, USER_BYTES, 0, SHARED_BYTES)?;
        let memory = MachineMemory::create(directory.path().join("memory"), &map)?;
        let arguments: String = words.iter().flat_map(|word| [*word, "\0"]).collect();
        for hart in 0..u32::from(harts) {
            let order = Order {
                entry: memory.load(hart, &file)?.entry(),
                arguments: arguments.as_bytes(),
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
    /// [`AloneError`].
    pub fn play(&self, monitor: &Path, shift: u8, patience: Duration) -> Result<(), AloneError> {
        let mut machine = self.switch_on(monitor, shift)?;
        let deadline = Instant::now() + patience;
        loop {
            let mut running = 0;
            for hart in 0..self.harts {
                match self.memory.control(hart.into())?.state()? {
                    HartState::Ended { status: 0, .. } => {}
                    HartState::Off | HartState::Waits | HartState::Runs { .. } => running += 1,
                    state => return Err(AloneError::Hart { hart, state }),
                }
            }
            if running == 0 {
                return Ok(());
            }
            if let Some(status) = machine.0.try_wait().map_err(AloneError::Qemu)? {
                return Err(AloneError::Ended(status));
            }
            if Instant::now() >= deadline {
                return Err(AloneError::Late { running, patience });
            }
            thread::sleep(LOOK);
        }
    }

    /// What users have of a hart's `data`: what its program has published lies there.
    ///
    /// # Errors
    /// There is no such hart.
    pub fn region(&self, hart: u8) -> Result<Region<LinuxWindow>, AccessError> {
        let (map, bell) = (self.memory.map(), layout::BELL_BYTES);
        let data = map.data.at(hart.into()).saturating_add(bell);
        let bytes = map.data_bytes.saturating_sub(bell);
        self.memory.region().part(data, bytes)
    }

    fn switch_on(&self, monitor: &Path, shift: u8) -> Result<Machine, AloneError> {
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
            .map_err(AloneError::Qemu)
    }
}

/// A machine that is switched off when nobody needs it any more.
struct Machine(Child);

impl Drop for Machine {
    fn drop(&mut self) {
        // It may have ended.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
