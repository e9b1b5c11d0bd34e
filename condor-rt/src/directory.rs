//! What lies where in a processor's memory, for a host that did not build its program.
//!
//! A program makes its [`Directory`] first of all, so that it lies at the beginning of the users'
//! region of its `data`, and enters what others may look at. All words have 32 bits and are
//! little-endian; offsets are in bytes from the beginning of the users' region.
//!
//! | offset | |
//! |---|---|
//! | 0 | "CDIR", stored after the rest of the directory was emptied |
//! | 4 | version of the layout, 1 |
//! | 8 | how many entries there are, stored after each of them |
//! | 12 | 0 |
//! | 16 + 32 *i* | entry *i*: name (16 bytes of UTF-8, zeros after them), [`Kind`], offset, length, 0 |

use condor_mbox::{AccessError, MemoryWindow, Places, Region};

const MAGIC: u32 = u32::from_le_bytes(*b"CDIR");
const VERSION: u32 = 1;
const HEAD_BYTES: u32 = 16;
const ENTRY_BYTES: u32 = 32;
const NAME_BYTES: usize = 16;

/// Entries of a directory.
pub const ENTRIES: usize = 32;
/// Bytes of a directory.
pub const BYTES: u32 = HEAD_BYTES + ENTRIES as u32 * ENTRY_BYTES;

mod word {
    pub(super) const MAGIC: u32 = 0;
    pub(super) const VERSION: u32 = 4;
    pub(super) const COUNT: u32 = 8;
}

/// What an entry describes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u32)]
#[non_exhaustive]
pub enum Kind {
    /// An object that only its users know.
    Other = 0,
    /// A terminal of condor-tty.
    Terminal = 1,
    /// The counts of servo loops, as [`LoopReports`](crate::loops::LoopReports) writes them.
    Loops = 2,
    /// A monitor of condor-hand.
    Monitor = 3,
    /// Where the servos of condor-hand have their set-points and requests.
    Servos = 4,
    /// A table of condor-vars: the variables and parameters of a loop, or the fields of a cell.
    Variables = 5,
}

impl Kind {
    const fn from_word(word: u32) -> Self {
        match word {
            1 => Self::Terminal,
            2 => Self::Loops,
            3 => Self::Monitor,
            4 => Self::Servos,
            5 => Self::Variables,
            _ => Self::Other,
        }
    }
}

/// A name of at most 16 bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Name([u8; NAME_BYTES]);

impl Name {
    /// As much of `name` as fits.
    #[must_use]
    pub fn new(name: &str) -> Self {
        let mut bytes = [0; NAME_BYTES];
        let mut end = name.len().min(NAME_BYTES);
        while !name.is_char_boundary(end) {
            end -= 1;
        }
        for (to, from) in bytes.iter_mut().zip(name.bytes().take(end)) {
            *to = from;
        }
        Self(bytes)
    }

    /// The name; empty if what lay in memory was no UTF-8.
    #[must_use]
    pub fn as_str(&self) -> &str {
        let end = self.0.iter().position(|&byte| byte == 0);
        let bytes = self.0.split_at(end.unwrap_or(NAME_BYTES)).0;
        core::str::from_utf8(bytes).unwrap_or_default()
    }

    pub(crate) const fn bytes(&self) -> &[u8; NAME_BYTES] {
        &self.0
    }

    pub(crate) const fn from_bytes(bytes: [u8; NAME_BYTES]) -> Self {
        Self(bytes)
    }
}

/// What a directory says of an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Its name.
    pub name: Name,
    /// What it is.
    pub kind: Kind,
    /// Where it begins in the users' region, in bytes.
    pub offset: u32,
    /// How long it is, in bytes.
    pub len: u32,
}

/// Why an object cannot be entered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DirectoryError {
    /// The directory is full.
    #[error("a directory has {ENTRIES} entries, and all are taken")]
    Full,
    /// The directory is not where hosts look for it.
    #[error(
        "the directory would be at offset {offset}, but hosts look for it at 0: make it first of all"
    )]
    NotFirst {
        /// Where it would be, in bytes.
        offset: u32,
    },
    /// Its memory.
    #[error(transparent)]
    Access(#[from] AccessError),
}

/// The directory of the processor that this program runs on.
#[derive(Debug)]
pub struct Directory<W> {
    region: Region<W>,
    count: u32,
}

impl<W: MemoryWindow> Directory<W> {
    /// An empty directory, which must be the first of `places` in the users' region of the
    /// program's own `data`.
    ///
    /// # Errors
    /// [`DirectoryError::NotFirst`]; no room.
    pub fn new(region: Region<W>, places: &mut Places) -> Result<Self, DirectoryError> {
        let offset = places.bytes(BYTES as usize)?;
        if offset != 0 {
            return Err(DirectoryError::NotFirst { offset });
        }
        region.set_word(word::MAGIC, 0)?;
        region.set_word(word::COUNT, 0)?;
        region.set_word(word::VERSION, VERSION)?;
        region.set_word(word::MAGIC, MAGIC)?;
        Ok(Self { region, count: 0 })
    }

    /// Enters an object, which must be ready to be looked at.
    ///
    /// # Errors
    /// [`DirectoryError::Full`]; the memory's.
    pub fn enter(
        &mut self,
        name: &str,
        kind: Kind,
        offset: u32,
        len: u32,
    ) -> Result<(), DirectoryError> {
        if self.count as usize >= ENTRIES {
            return Err(DirectoryError::Full);
        }
        let at = HEAD_BYTES + self.count * ENTRY_BYTES;
        self.region.write(at, Name::new(name).bytes())?;
        self.region.set_word(at + 16, kind as u32)?;
        self.region.set_word(at + 20, offset)?;
        self.region.set_word(at + 24, len)?;
        self.region.set_word(at + 28, 0)?;
        self.count += 1;
        Ok(self.region.set_word(word::COUNT, self.count)?)
    }
}

/// The entries in the directory of a processor, whose users' region is `region`; none if there is
/// no directory, or not yet.
///
/// # Errors
/// The memory's.
pub fn entries<W: MemoryWindow>(
    region: &Region<W>,
) -> Result<impl Iterator<Item = Result<Entry, AccessError>> + '_, AccessError> {
    let is_there = region.word(word::MAGIC)? == MAGIC && region.word(word::VERSION)? == VERSION;
    let count = if is_there {
        region.word(word::COUNT)?
    } else {
        0
    };
    Ok((0..count.min(ENTRIES as u32)).map(move |number| entry(region, number)))
}

fn entry<W: MemoryWindow>(region: &Region<W>, number: u32) -> Result<Entry, AccessError> {
    let at = HEAD_BYTES + number * ENTRY_BYTES;
    let mut name = [0; NAME_BYTES];
    region.read(at, &mut name)?;
    Ok(Entry {
        name: Name::from_bytes(name),
        kind: Kind::from_word(region.word(at + 16)?),
        offset: region.word(at + 20)?,
        len: region.word(at + 24)?,
    })
}

/// The first entry of a name.
///
/// # Errors
/// The memory's.
pub fn find<W: MemoryWindow>(region: &Region<W>, name: &str) -> Result<Option<Entry>, AccessError> {
    for entry in entries(region)? {
        let entry = entry?;
        if entry.name.as_str() == name {
            return Ok(Some(entry));
        }
    }
    Ok(None)
}
