//! [`MachineMemory`]: the memory of a machine of harts, as a file.

use std::fs::File;
use std::path::{Path, PathBuf};

use condor_mbox::linux::{self, Access, LinuxWindow, System, SystemError};
use condor_mbox::{AccessError, MemoryWindow as _, Region, layout};
use rustix::fs::FallocateFlags;

use super::control::Control;
use super::image::{Image, ImageError};
use super::map::{self, Map, MapError, PAGE, Run};
use condor_rt::linux::FileRange;
use condor_rt::numbers::PROCESSORS;

/// The file that is the memory of a machine, mapped, with its map.
#[derive(Clone, Debug)]
pub struct MachineMemory {
    path: PathBuf,
    map: Map,
    region: Region<LinuxWindow>,
}

/// Why a file is not the memory of a machine.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MemoryError {
    /// The file.
    #[error("cannot {doing} {path:?}: {source}")]
    File {
        /// What was tried.
        doing: &'static str,
        /// With which file.
        path: PathBuf,
        /// The answer.
        source: std::io::Error,
    },
    /// It has another size than its map says.
    #[error("{path:?} has {found:#x} bytes, and its map says {expected:#x}")]
    Size {
        /// The file.
        path: PathBuf,
        /// Its size, in bytes.
        found: u64,
        /// What its map says, in bytes.
        expected: u32,
    },
    /// It cannot be mapped.
    #[error("cannot map {path:?}: {source}")]
    Window {
        /// The file.
        path: PathBuf,
        /// Why not.
        source: linux::MapError,
    },
    /// Its map.
    #[error("the memory {path:?}: {source}")]
    Map {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: MapError,
    },
    /// An access.
    #[error("the memory {path:?}: {source}")]
    Access {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: AccessError,
    },
    /// A program.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// The windows of the processors.
    #[error(transparent)]
    System(#[from] SystemError),
}

impl MachineMemory {
    /// Makes the file `path`, which must not be there yet: zeros, with the map. All its memory is taken
    /// now, rather than missing later.
    ///
    /// # Errors
    /// [`MemoryError`].
    pub fn create(path: impl Into<PathBuf>, map: &Map) -> Result<Self, MemoryError> {
        let path = path.into();
        let make = || {
            let file = File::options()
                .read(true)
                .write(true)
                .create_new(true)
                .open(&path)?;
            let (flags, bytes) = (FallocateFlags::empty(), u64::from(map.memory_bytes));
            let allocate = || rustix::fs::fallocate(&file, flags, 0, bytes);
            match rustix::io::retry_on_intr(allocate) {
                // A file system that cannot promise memory.
                Err(rustix::io::Errno::OPNOTSUPP) => file.set_len(bytes)?,
                other => other?,
            }
            Ok(file)
        };
        let file = make().map_err(|source| MemoryError::File {
            doing: "make",
            path: path.clone(),
            source,
        })?;
        let region = mapped(&file, &path, map.memory_bytes)?;
        let memory = Self {
            path,
            map: map.clone(),
            region,
        };
        map.write(&memory.region).map_err(memory.at())?;
        Ok(memory)
    }

    /// The memory in the file `path`, as somebody made it.
    ///
    /// # Errors
    /// [`MemoryError`].
    pub fn open(path: impl Into<PathBuf>) -> Result<Self, MemoryError> {
        let path = path.into();
        let open = || {
            let file = File::options().read(true).write(true).open(&path)?;
            let bytes = file.metadata()?.len();
            Ok((file, bytes))
        };
        let (file, found) = open().map_err(|source| MemoryError::File {
            doing: "open",
            path: path.clone(),
            source,
        })?;
        // A larger one is told below, by its map.
        let bytes = u32::try_from(found).unwrap_or(u32::MAX) / PAGE * PAGE;
        let region = mapped(&file, &path, bytes)?;
        let map = Map::read(&region).map_err(|source| MemoryError::Map {
            path: path.clone(),
            source,
        })?;
        if u64::from(map.memory_bytes) != found {
            return Err(MemoryError::Size {
                path,
                found,
                expected: map.memory_bytes,
            });
        }
        Ok(Self { path, map, region })
    }

    /// The file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What lies where.
    #[must_use]
    pub const fn map(&self) -> &Map {
        &self.map
    }

    /// All of it.
    #[must_use]
    pub const fn region(&self) -> &Region<LinuxWindow> {
        &self.region
    }

    /// Puts the memory in the state in which a machine is switched on: no hart has come up. Programs
    /// and windows stay.
    ///
    /// # Errors
    /// [`MemoryError::Access`].
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

    /// The page of a hart.
    ///
    /// # Errors
    /// [`MemoryError::Access`].
    pub fn control(&self, hart: u32) -> Result<Control<LinuxWindow>, MemoryError> {
        Control::new(&self.region, hart).map_err(self.at())
    }

    /// Puts the program in `file`, the bytes of an ELF file, into the range of a hart, which must not run
    /// there. [`Control::order`] with its [`entry`](Image::entry) is to follow, and a ring.
    ///
    /// # Errors
    /// [`MemoryError::Image`], [`MemoryError::Access`].
    pub fn load(&self, hart: u32, file: &[u8]) -> Result<Image, MemoryError> {
        let image = Image::new(file, &self.map, hart)?;
        image.load(&self.region).map_err(self.at())?;
        Ok(image)
    }

    /// Returns where in the file the bus is; `None` if there is none.
    #[must_use]
    pub fn bus(&self) -> Option<FileRange> {
        self.range(self.map.bus, self.map.bus_bytes)
    }

    /// Returns where in the file the memory is that belongs to no processor; `None` if there is none.
    #[must_use]
    pub fn shared_memory(&self) -> Option<FileRange> {
        self.range(self.map.shared, self.map.shared_bytes)
    }

    fn range(&self, offset: u32, bytes: u32) -> Option<FileRange> {
        (bytes > 0).then(|| FileRange {
            path: self.path.clone(),
            offset: offset.into(),
            bytes: Some(bytes.into()),
        })
    }

    /// The processors whose windows lie in it, with what processes need in `directory`; from then on
    /// [`System::at`] finds them there.
    ///
    /// # Errors
    /// [`MemoryError::System`].
    pub fn system(&self, directory: &Path) -> Result<System<PROCESSORS>, MemoryError> {
        let run = |run: Run| linux::Run {
            offset: run.offset.into(),
            stride: run.stride.into(),
        };
        let memory = linux::Memory {
            file: self.path.clone(),
            mail: run(self.map.mail),
            data: run(self.map.data),
        };
        let user_bytes = self.map.data_bytes.saturating_sub(layout::BELL_BYTES);
        Ok(System::in_memory(directory, user_bytes, &memory)?)
    }

    /// What an access of it failed of.
    pub(crate) fn at(&self) -> impl FnOnce(AccessError) -> MemoryError + use<> {
        let path = self.path.clone();
        move |source| MemoryError::Access { path, source }
    }
}

fn mapped(file: &File, path: &Path, bytes: u32) -> Result<Region<LinuxWindow>, MemoryError> {
    let window = LinuxWindow::map(file, 0, bytes, Access::ReadWrite);
    let window = window.map_err(|source| MemoryError::Window {
        path: path.into(),
        source,
    })?;
    Ok(Region::whole(window))
}
