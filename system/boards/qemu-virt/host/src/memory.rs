//! [`MachineMemory`]: the memory of a machine of harts, as a file.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::{fmt, io};

use condor_mbox::linux::{self, LinuxSystem, LinuxWindow, WindowAccess};
use condor_mbox::{AccessError, MemoryWindow as _, Region, layout};
use rustix::fs::FallocateFlags;

use super::control::Control;
use super::image::{HartImage, HartImageError};
use super::map::{self, Map, ObjectRun, PAGE};
use condor_rt::linux::FileRange;
use condor_rt::numbers::PROCESSORS;

/// The memory of a machine of harts, as the host accesses it: a file that is mapped into this
/// process and that QEMU uses as the RAM of the machine, with the [`Map`] of the objects in it.
#[derive(Clone, Debug)]
pub struct MachineMemory {
    path: PathBuf,
    map: Map,
    region: Region<LinuxWindow>,
}

/// The reason why a [`MachineMemory`] cannot be made, opened or accessed, as text.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct MemoryError(String);

impl From<HartImageError> for MemoryError {
    fn from(error: HartImageError) -> Self {
        Self(error.to_string())
    }
}

impl MachineMemory {
    /// Creates the file `path`, which must not exist yet, and writes `map` into it; the rest is
    /// zeros. All of the memory is allocated at once, so that none can be missing later.
    ///
    /// # Errors
    /// [`MemoryError`] if the file exists, cannot be made, or has no room.
    pub fn create(path: impl Into<PathBuf>, map: &Map) -> Result<Self, MemoryError> {
        let path = path.into();
        let make = || -> io::Result<_> {
            let file = File::options()
                .read(true)
                .write(true)
                .create_new(true)
                .open(&path)?;
            let (flags, bytes) = (FallocateFlags::empty(), u64::from(map.memory_bytes));
            let allocate = || rustix::fs::fallocate(&file, flags, 0, bytes);
            match rustix::io::retry_on_intr(allocate) {
                // A filesystem that cannot promise memory.
                Err(rustix::io::Errno::OPNOTSUPP) => file.set_len(bytes)?,
                other => other?,
            }
            Ok(file)
        };
        let file = make().map_err(cannot("make", &path))?;
        let region = mapped(&file, &path, map.memory_bytes)?;
        let memory = Self {
            path,
            map: map.clone(),
            region,
        };
        map.write(&memory.region).map_err(memory.at())?;
        Ok(memory)
    }

    /// Opens the memory in the file `path`, which [`create`](Self::create) has made.
    ///
    /// # Errors
    /// [`MemoryError`] if the file cannot be opened or mapped, or has no valid map.
    pub fn open(path: impl Into<PathBuf>) -> Result<Self, MemoryError> {
        let path = path.into();
        let open = || -> io::Result<_> {
            let file = File::options().read(true).write(true).open(&path)?;
            let bytes = file.metadata()?.len();
            Ok((file, bytes))
        };
        let (file, found) = open().map_err(cannot("open", &path))?;
        // A larger one is told below, by its map.
        let bytes = u32::try_from(found).unwrap_or(u32::MAX) / PAGE * PAGE;
        let region = mapped(&file, &path, bytes)?;
        let map = Map::read(&region).map_err(|error| {
            MemoryError(format!("cannot use the memory {}: {error}", path.display()))
        })?;
        let expected = map.memory_bytes;
        if u64::from(expected) != found {
            return Err(MemoryError(format!(
                "{} has {found:#x} bytes, and its map says {expected:#x}",
                path.display()
            )));
        }
        Ok(Self { path, map, region })
    }

    /// Returns the path of the file that is the memory.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the map, which tells where everything lies in the memory.
    #[must_use]
    pub const fn map(&self) -> &Map {
        &self.map
    }

    /// Returns the whole memory as a region; offsets are in bytes from its beginning.
    #[must_use]
    pub const fn region(&self) -> &Region<LinuxWindow> {
        &self.region
    }

    /// Prepares the memory for switching the machine on: every hart is
    /// [`Off`](super::HartState::Off). The programs of harts and the windows of processors stay.
    ///
    /// # Errors
    /// [`MemoryError`] if the memory cannot be accessed.
    pub fn reset(&self) -> Result<(), MemoryError> {
        let zeros = [0; PAGE as usize];
        // The words of the harts themselves: one may have been switched off while it held a lock.
        let words = zeros.split_at((PAGE - map::BOARD) as usize).0;
        let board = map::AT + map::BOARD;
        self.region.write(board, words).map_err(self.at())?;
        for hart in 0..self.map.harts() {
            let page = Map::control(hart);
            self.region.write(page, &zeros).map_err(self.at())?;
        }
        Ok(())
    }

    /// Returns the control of the hart with index `hart`, counted from 0.
    ///
    /// # Errors
    /// [`MemoryError`] if the memory cannot be accessed.
    pub fn control(&self, hart: u32) -> Result<Control<LinuxWindow>, MemoryError> {
        Control::new(&self.region, hart).map_err(self.at())
    }

    /// Copies a program into the memory of the hart with index `hart`, which must not run a
    /// program. `file` is the content of an ELF file. To start the program, call [`Control::order`]
    /// with the [`entry`](HartImage::entry) of the result, and ring the hart's doorbell.
    ///
    /// # Errors
    /// [`MemoryError`] if the file is not a program for this hart, as in [`HartImage::new`], or if the
    /// memory cannot be accessed.
    pub fn load(&self, hart: u32, file: &[u8]) -> Result<HartImage, MemoryError> {
        let image = HartImage::new(file, &self.map, hart)?;
        image.load(&self.region).map_err(self.at())?;
        Ok(image)
    }

    /// Returns the range of the file that holds the bus, which is the registers of simulated
    /// boards; `None` if the machine has no bus.
    #[must_use]
    pub fn bus(&self) -> Option<FileRange> {
        self.range(self.map.bus, self.map.bus_bytes)
    }

    /// Returns the range of the file that holds the shared memory, which belongs to no processor;
    /// `None` if the machine has none.
    #[must_use]
    pub fn shared_memory(&self) -> Option<FileRange> {
        self.range(self.map.shared, self.map.shared_bytes)
    }

    /// Returns the range of the file that holds the page of a simulated clock; it is always `Some`.
    #[must_use]
    pub fn clock(&self) -> Option<FileRange> {
        self.range(self.map.clock, map::CLOCK_BYTES)
    }

    fn range(&self, offset: u32, bytes: u32) -> Option<FileRange> {
        (bytes > 0).then(|| FileRange {
            path: self.path.clone(),
            offset: offset.into(),
            bytes: Some(bytes.into()),
        })
    }

    /// Returns the system of the processors whose windows are in this memory, through which
    /// processes and harts exchange messages. The call creates the other files that processes need
    /// in `directory`; later, [`LinuxSystem::at`] finds the system there.
    ///
    /// # Errors
    /// [`MemoryError`] if [`LinuxSystem::in_memory`] fails, with the text of that error.
    pub fn system(&self, directory: &Path) -> Result<LinuxSystem<PROCESSORS>, MemoryError> {
        let run = |run: ObjectRun| linux::ObjectPositions {
            offset: run.offset.into(),
            stride: run.stride.into(),
        };
        let memory = linux::Memory {
            file: self.path.clone(),
            mail: run(self.map.mail),
            data: run(self.map.data),
        };
        let user_bytes = self.map.data_bytes.saturating_sub(layout::BELL_BYTES);
        LinuxSystem::in_memory(directory, user_bytes, &memory)
            .map_err(|error| MemoryError(error.to_string()))
    }

    /// Returns a function that makes the error of a failed access to this memory.
    pub(crate) fn at(&self) -> impl FnOnce(AccessError) -> MemoryError + use<> {
        let path = self.path.display().to_string();
        move |error| MemoryError(format!("cannot use the memory {path}: {error}"))
    }
}

fn mapped(file: &File, path: &Path, bytes: u32) -> Result<Region<LinuxWindow>, MemoryError> {
    let window = LinuxWindow::map(file, 0, bytes, WindowAccess::ReadWrite);
    Ok(Region::whole(window.map_err(cannot("map", path))?))
}

fn cannot<E: fmt::Display>(doing: &str, path: &Path) -> impl FnOnce(E) -> MemoryError {
    move |error| MemoryError(format!("cannot {doing} {}: {error}", path.display()))
}
