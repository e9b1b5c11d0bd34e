//! [`Area`]: the places of a client's blocks in its window.

use condor_mbox::{AccessError, Allocator, Call};

use crate::wire::{block, slot, table};

/// The shared memory that a [`FileSystem`](super::FileSystem) needs for up to `FILES` open files:
/// requests, paths, and a buffer for each file. It lies in the users' region of the processor's own
/// `data`, the part of `data` that is for programs.
///
/// Make it before the mailbox, because the mailbox borrows the [handler](Self::handler) by which
/// the server asks for the open files.
///
/// ```
/// use condor_fs::Area;
/// use condor_mbox::Allocator;
///
/// // 4 files, paths of up to 100 bytes, and a buffer of 512 bytes for each file.
/// let mut allocator = Allocator::new(8192);
/// let area = Area::<4>::new(&mut allocator, 100, 512)?;
/// assert!(Area::<64>::new(&mut allocator, 100, 512).is_err(), "there is no room left for 64");
/// # Ok::<(), condor_mbox::AccessError>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Area<const FILES: usize> {
    slot: u32,
    table: u32,
    blocks: u32,
    paths: u32,
    buffers: u32,
    path_bytes: u32,
    buffer_bytes: u32,
}

impl<const FILES: usize> Area<FILES> {
    /// Takes memory from `allocator`, that of the users' region: room for paths of up to
    /// `path_bytes` bytes, and for every file a buffer of `buffer_bytes` bytes. Both sizes are
    /// rounded up to a multiple of four.
    ///
    /// To list a directory, `buffer_bytes` must be at least 16 more than the length of its longest
    /// name.
    ///
    /// # Errors
    /// [`AccessError`] of the kind `OutOfBounds` if there is no room.
    pub const fn new(
        allocator: &mut Allocator,
        path_bytes: u32,
        buffer_bytes: u32,
    ) -> Result<Self, AccessError> {
        let path_bytes = round_up(path_bytes);
        let buffer_bytes = round_up(buffer_bytes);
        let slot = match allocator.bytes(slot::BYTES as usize) {
            Ok(slot) => slot,
            Err(error) => return Err(error),
        };
        let table = match allocator.bytes(table::BYTES as usize) {
            Ok(table) => table,
            Err(error) => return Err(error),
        };
        let blocks = match allocator.bytes(FILES.saturating_mul(block::BYTES as usize)) {
            Ok(blocks) => blocks,
            Err(error) => return Err(error),
        };
        // One for each file, and two for the paths of an operation.
        let paths =
            match allocator.bytes(FILES.saturating_add(2).saturating_mul(path_bytes as usize)) {
                Ok(paths) => paths,
                Err(error) => return Err(error),
            };
        let buffers = match allocator.bytes(FILES.saturating_mul(buffer_bytes as usize)) {
            Ok(buffers) => buffers,
            Err(error) => return Err(error),
        };
        Ok(Self {
            slot,
            table,
            blocks,
            paths,
            buffers,
            path_bytes,
            buffer_bytes,
        })
    }

    /// Returns the message handler that the server needs to ask this client for its open files. Set
    /// it for the vector [`OPEN_FILES`](crate::wire::OPEN_FILES) before the mailbox joins. Its
    /// reply is the offset of the table of open files in the users' region.
    pub fn handler(self) -> impl Fn(&Call<'_>) -> u32 + Sync {
        move |_| self.table
    }

    pub(super) const fn slot(&self) -> u32 {
        self.slot
    }

    pub(super) const fn table(&self) -> u32 {
        self.table
    }

    pub(super) const fn blocks(&self) -> u32 {
        self.blocks
    }

    /// The block of a file; `file` is below `FILES`, so nothing wraps that had room.
    pub(super) const fn block(&self, file: usize) -> u32 {
        self.blocks
            .wrapping_add((file as u32).wrapping_mul(block::BYTES))
    }

    /// Room for the path of a file, or after those for one of the two of an operation.
    pub(super) const fn path(&self, file: usize) -> u32 {
        self.paths
            .wrapping_add((file as u32).wrapping_mul(self.path_bytes))
    }

    pub(super) const fn buffer(&self, file: usize) -> u32 {
        self.buffers
            .wrapping_add((file as u32).wrapping_mul(self.buffer_bytes))
    }

    pub(super) const fn path_bytes(&self) -> u32 {
        self.path_bytes
    }

    pub(super) const fn buffer_bytes(&self) -> u32 {
        self.buffer_bytes
    }
}

const fn round_up(bytes: u32) -> u32 {
    match bytes.checked_next_multiple_of(4) {
        Some(bytes) => bytes,
        None => u32::MAX - 3,
    }
}
