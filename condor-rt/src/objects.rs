//! The object table: what lies where in a processor's memory, for a host that did not build its program.
//!
//! A program makes its [`ObjectTable`] first of all, so that it lies at the beginning of the users'
//! region of its `data`, and enters what others may look at. Entries lie wherever there is room, one
//! behind the other, and there may be as many as the window holds. All words have 32 bits and are
//! little-endian; offsets are in bytes from the beginning of the users' region.
//!
//! | offset | |
//! |---|---|
//! | 0 | "COBJ", stored after the table was emptied |
//! | 4 | version of the layout, 1 |
//! | 8 | where the first entry begins; 0 if there is none |
//! | 12 | 0 |
//!
//! | offset in an entry | |
//! |---|---|
//! | 0 | where the next one begins, behind this one; 0 if there is none. Stored after that one is complete |
//! | 4 | [`Kind`] |
//! | 8 | offset of the object |
//! | 12 | its length |
//! | 16 | how many bytes its name has, at most 64 |
//! | 20 | its name, in UTF-8 |

use condor_mbox::{AccessError, MemoryWindow, Places, Published, Region};

use crate::error::Text;

const MAGIC: u32 = u32::from_le_bytes(*b"COBJ");
/// The version of the table.
pub const VERSION: u32 = 1;

/// Bytes that the table takes before its entries.
pub const BYTES: u32 = 16;
/// Bytes that a name may have.
pub const NAME_BYTES: usize = 64;

mod word {
    pub(super) const MAGIC: u32 = 0;
    pub(super) const VERSION: u32 = 4;
    pub(super) const FIRST: u32 = 8;
}

mod entry {
    pub(super) const NEXT: u32 = 0;
    pub(super) const KIND: u32 = 4;
    pub(super) const OFFSET: u32 = 8;
    pub(super) const LEN: u32 = 12;
    pub(super) const NAME_LEN: u32 = 16;
    pub(super) const NAME: u32 = 20;
}

/// What an object is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u32)]
#[non_exhaustive]
pub enum Kind {
    /// An object that only its users know.
    Other = 0,
    /// A terminal of condor-tty.
    Terminal = 1,
    /// The counts of a servo loop, as a [`LoopReport`](crate::loops::LoopReport) writes them.
    Loop = 2,
    /// A table of condor-vars: the variables and parameters of a loop, or the fields of a cell.
    Variables = 3,
}

impl Kind {
    const fn from_word(word: u32) -> Self {
        match word {
            1 => Self::Terminal,
            2 => Self::Loop,
            3 => Self::Variables,
            _ => Self::Other,
        }
    }
}

/// What the table says of an object.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Object {
    /// Its name; empty if what lay in memory was no UTF-8.
    pub name: Text<NAME_BYTES>,
    /// What it is.
    pub kind: Kind,
    /// Where it begins in the users' region, in bytes.
    pub offset: u32,
    /// How long it is, in bytes.
    pub len: u32,
}

/// Why an object cannot be entered.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ObjectError {
    /// The table is not where hosts look for it.
    #[error(
        "the object table would be at offset {offset}, but hosts look for it at 0: make it first of all"
    )]
    NotFirst {
        /// Where it would be, in bytes.
        offset: u32,
    },
    /// A name that is too long.
    #[error("an object's name has at most {NAME_BYTES} bytes, and that of `{name}...` has {len}")]
    Name {
        /// How it begins.
        name: Text<32>,
        /// How many bytes it has.
        len: usize,
    },
    /// There is one of this name and kind.
    #[error("there are two objects `{name}`: each needs a name of its own")]
    Taken {
        /// The name.
        name: Text<NAME_BYTES>,
    },
    /// The memory.
    #[error(transparent)]
    Access(#[from] AccessError),
}

/// The object table of the processor that this program runs on.
#[derive(Debug)]
pub struct ObjectTable<W> {
    region: Region<W>,
    /// The word that is to say where the next entry begins.
    last: u32,
}

impl<W: MemoryWindow> ObjectTable<W> {
    /// An empty table, which must be the first of `places` in the users' region of the program's own
    /// `data`.
    ///
    /// # Errors
    /// [`ObjectError::NotFirst`]; no room.
    pub fn new(region: Region<W>, places: &mut Places) -> Result<Self, ObjectError> {
        let offset = places.bytes(BYTES as usize)?;
        if offset != 0 {
            return Err(ObjectError::NotFirst { offset });
        }
        region.set_word(word::MAGIC, 0)?;
        region.set_word(word::FIRST, 0)?;
        region.set_word(word::VERSION, VERSION)?;
        region.set_word(word::MAGIC, MAGIC)?;
        let last = word::FIRST;
        Ok(Self { region, last })
    }

    /// Room for a cell of which others read the latest value, entered.
    ///
    /// # Errors
    /// No room; those of [`enter`](Self::enter).
    pub fn cell<T>(
        &mut self,
        places: &mut Places,
        name: &str,
        kind: Kind,
    ) -> Result<Published<T>, ObjectError> {
        let cell = places.published::<T>()?;
        // What a former program has left there is none of this one's.
        for word in (0..Published::<T>::BYTES).step_by(4) {
            self.region.set_word(cell.offset() + word, 0)?;
        }
        let bytes = Published::<T>::BYTES;
        self.enter(places, name, kind, cell.offset(), bytes)?;
        Ok(cell)
    }

    /// Enters an object, which must be ready to be looked at; the entry is the next of `places`.
    ///
    /// # Errors
    /// [`ObjectError::Name`], [`ObjectError::Taken`]; no room.
    pub fn enter(
        &mut self,
        places: &mut Places,
        name: &str,
        kind: Kind,
        offset: u32,
        len: u32,
    ) -> Result<(), ObjectError> {
        if name.len() > NAME_BYTES {
            let (name, len) = (Text::of(name), name.len());
            return Err(ObjectError::Name { name, len });
        }
        if find(&self.region, name, kind)?.is_some() {
            let name = Text::of(name);
            return Err(ObjectError::Taken { name });
        }
        let at = places.bytes(entry::NAME as usize + name.len())?;
        self.region.set_word(at + entry::NEXT, 0)?;
        self.region.set_word(at + entry::KIND, kind as u32)?;
        self.region.set_word(at + entry::OFFSET, offset)?;
        self.region.set_word(at + entry::LEN, len)?;
        let name_len = name.len() as u32;
        self.region.set_word(at + entry::NAME_LEN, name_len)?;
        self.region.write(at + entry::NAME, name.as_bytes())?;
        self.region.set_word(self.last, at)?;
        self.last = at + entry::NEXT;
        Ok(())
    }
}

/// The version of the table of a processor, whose users' region is `region`; `None` if there is no table, or not
/// yet. The objects of a table of another version than [`VERSION`] cannot be read.
///
/// # Errors
/// The memory's.
pub fn version<W: MemoryWindow>(region: &Region<W>) -> Result<Option<u32>, AccessError> {
    let is_there = region.word(word::MAGIC)? == MAGIC;
    let version = region.word(word::VERSION)?;
    Ok(is_there.then_some(version))
}

/// The objects in the table of a processor, whose users' region is `region`; none if there is no
/// table of this [`VERSION`], or not yet.
///
/// # Errors
/// The memory's.
pub fn all<W: MemoryWindow>(
    region: &Region<W>,
) -> Result<impl Iterator<Item = Result<Object, AccessError>> + '_, AccessError> {
    let first = if version(region)? == Some(VERSION) {
        region.word(word::FIRST)?
    } else {
        0
    };
    // Where the next entry begins, and behind what.
    let mut next = (first, 0);
    Ok(core::iter::from_fn(move || {
        let (at, before) = next;
        // Whatever others have written there: who only goes forward comes to an end.
        if at <= before {
            return None;
        }
        let found = read(region, at);
        let following = found.as_ref().map_or(0, |(_, following)| *following);
        next = (following, at);
        Some(found.map(|(object, _)| object))
    }))
}

fn read<W: MemoryWindow>(region: &Region<W>, at: u32) -> Result<(Object, u32), AccessError> {
    let word = |within: u32| region.word(at.saturating_add(within));
    let mut bytes = [0; NAME_BYTES];
    let len = word(entry::NAME_LEN)? as usize;
    let name = bytes.get_mut(..len).unwrap_or_default();
    region.read(at.saturating_add(entry::NAME), name)?;
    let object = Object {
        name: Text::of(core::str::from_utf8(name).unwrap_or_default()),
        kind: Kind::from_word(word(entry::KIND)?),
        offset: word(entry::OFFSET)?,
        len: word(entry::LEN)?,
    };
    Ok((object, word(entry::NEXT)?))
}

/// The object of a name and kind.
///
/// # Errors
/// The memory's.
pub fn find<W: MemoryWindow>(
    region: &Region<W>,
    name: &str,
    kind: Kind,
) -> Result<Option<Object>, AccessError> {
    for object in all(region)? {
        let object = object?;
        if object.kind == kind && object.name.as_str() == name {
            return Ok(Some(object));
        }
    }
    Ok(None)
}
