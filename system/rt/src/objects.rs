//! The object table: a list of the objects in a processor's memory. With it a host can find them
//! without knowing the program.
//!
//! A program makes its [`ObjectTable`] before it places anything else, so that the table lies at
//! the beginning of the users' region of its `data`. Then it enters the objects that others may
//! read. The entries form a linked list and may lie anywhere in the region; their number is limited
//! only by the window. All words have 32 bits and are little-endian. All offsets are in bytes from
//! the beginning of the users' region.
//!
//! | offset | content |
//! |---|---|
//! | 0 | "COBJ", stored after the table was emptied |
//! | 4 | version of the layout, 1 |
//! | 8 | offset of the first entry; 0 if there is none |
//! | 12 | 0 |
//!
//! | offset in an entry | content |
//! |---|---|
//! | 0 | offset of the next entry, which is greater than that of this one; 0 if there is none. It is stored after the next entry is complete |
//! | 4 | [`ObjectKind`] |
//! | 8 | offset of the object |
//! | 12 | length of the object in bytes |
//! | 16 | length of its name in bytes, at most 64 |
//! | 20 | its name, in UTF-8 |

use condor_mbox::{AccessError, Allocator, MemoryWindow, Published, Region};

use crate::text::ShortText;

const MAGIC: u32 = u32::from_le_bytes(*b"COBJ");
/// The version of the layout of object tables that this crate writes and reads.
pub const VERSION: u32 = 1;

/// The size of an object table without its entries, in bytes.
pub const BYTES: u32 = 16;
/// The greatest length of an object's name, in bytes.
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

/// The kind of an object in an object table, which says how tools can read the object.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u32)]
#[non_exhaustive]
pub enum ObjectKind {
    /// An object that only the program's own users know how to read.
    Other = 0,
    /// A terminal of condor-tty.
    Terminal = 1,
    /// The counts of a servo loop, as a [`LoopReport`](crate::loops::LoopReport) writes them.
    Loop = 2,
    /// A table of condor-vars: the variables and parameters of a loop, or the fields of a cell.
    Variables = 3,
}

impl ObjectKind {
    const fn from_word(word: u32) -> Self {
        match word {
            1 => Self::Terminal,
            2 => Self::Loop,
            3 => Self::Variables,
            _ => Self::Other,
        }
    }
}

/// An object in a processor's shared memory, as its entry in the object table describes it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SharedObject {
    /// The object's name; empty if the name in memory is too long or not UTF-8.
    pub name: ShortText<NAME_BYTES>,
    /// The object's kind.
    pub kind: ObjectKind,
    /// The object's offset in the users' region, in bytes.
    pub offset: u32,
    /// The object's length, in bytes.
    pub len: u32,
}

/// The reason why an object table cannot be made, or an object cannot be entered in it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ObjectError {
    /// The table would not lie at the offset 0, where hosts look for it.
    #[error(
        "the object table would be at offset {offset}, but hosts look for it at 0: make it before all other objects"
    )]
    NotFirst {
        /// The offset at which it would lie, in bytes.
        offset: u32,
    },
    /// A name is longer than [`NAME_BYTES`].
    #[error("an object's name has at most {NAME_BYTES} bytes, but `{name}...` has {len}")]
    Name {
        /// The beginning of the name.
        name: ShortText<32>,
        /// The length of the name, in bytes.
        len: usize,
    },
    /// The table has an object of this name and kind already.
    #[error("there are two objects `{name}`: each needs a name of its own")]
    Taken {
        /// The name that both objects have.
        name: ShortText<NAME_BYTES>,
    },
    /// The region has no room left, or its memory cannot be accessed.
    #[error(transparent)]
    Access(#[from] AccessError),
}

/// The object table of the processor on which this program runs: a list, in shared memory, of the
/// objects that the program shows to others. With the table, tools find its terminal, loops and
/// variables by their names. Other programs read a table through [`all`] and [`find`].
#[derive(Debug)]
pub struct ObjectTable<W> {
    region: Region<W>,
    /// The offset of the word that will say where the next entry begins.
    last: u32,
}

impl<W: MemoryWindow> ObjectTable<W> {
    /// Makes an empty table at the beginning of `region`, the users' region of the program's own
    /// `data`. `allocator` hands out the room in `region`; nothing must have been taken from it
    /// before.
    ///
    /// # Errors
    /// [`ObjectError::NotFirst`] if something was taken from `allocator` before;
    /// [`ObjectError::Access`] if there is no room.
    pub fn new(region: Region<W>, allocator: &mut Allocator) -> Result<Self, ObjectError> {
        let offset = allocator.bytes(BYTES as usize)?;
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

    /// Takes room from `allocator` for a cell, which shows others the latest value of type `T`, and
    /// enters it in the table as the object `name` of the kind `kind`. The cell has no value before
    /// its publisher has written one.
    ///
    /// # Errors
    /// [`ObjectError::Access`] if there is no room, [`ObjectError::Name`] if the name is too long,
    /// [`ObjectError::Taken`] if there is an object of this name and kind.
    pub fn cell<T>(
        &mut self,
        allocator: &mut Allocator,
        name: &str,
        kind: ObjectKind,
    ) -> Result<Published<T>, ObjectError> {
        let cell = allocator.published::<T>()?;
        // A former program may have left words there that are not this one's.
        for word in (0..Published::<T>::BYTES).step_by(4) {
            self.region.set_word(cell.offset() + word, 0)?;
        }
        let bytes = Published::<T>::BYTES;
        self.enter(allocator, name, kind, cell.offset(), bytes)?;
        Ok(cell)
    }

    /// Enters the object `name` of the kind `kind`, which takes `len` bytes at `offset` bytes of
    /// the users' region. From then on others may read the object, so it must be complete. The
    /// entry itself takes room from `allocator`.
    ///
    /// # Errors
    /// [`ObjectError::Name`] if the name is too long, [`ObjectError::Taken`] if there is an object
    /// of this name and kind, [`ObjectError::Access`] if there is no room.
    pub fn enter(
        &mut self,
        allocator: &mut Allocator,
        name: &str,
        kind: ObjectKind,
        offset: u32,
        len: u32,
    ) -> Result<(), ObjectError> {
        if name.len() > NAME_BYTES {
            let (name, len) = (ShortText::of(name), name.len());
            return Err(ObjectError::Name { name, len });
        }
        if find(&self.region, name, kind)?.is_some() {
            let name = ShortText::of(name);
            return Err(ObjectError::Taken { name });
        }
        let at = allocator.bytes(entry::NAME as usize + name.len())?;
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

/// Returns the version of a processor's object table; `None` if the processor has no table yet, or
/// never makes one. `region` is the users' region of that processor. The objects can be read only
/// if the version is [`VERSION`].
///
/// # Errors
/// [`AccessError`] if the memory cannot be read.
pub fn version<W: MemoryWindow>(region: &Region<W>) -> Result<Option<u32>, AccessError> {
    let is_there = region.word(word::MAGIC)? == MAGIC;
    let version = region.word(word::VERSION)?;
    Ok(is_there.then_some(version))
}

/// Iterates over the objects in a processor's object table, in the order in which they were
/// entered. `region` is the users' region of that processor. Yields nothing if the processor has no
/// table yet, or a table of another version than [`VERSION`].
///
/// # Errors
/// [`AccessError`] if the memory cannot be read. An item is this error if its entry cannot be read;
/// it is then the last one.
pub fn all<W: MemoryWindow>(
    region: &Region<W>,
) -> Result<impl Iterator<Item = Result<SharedObject, AccessError>> + '_, AccessError> {
    let first = if version(region)? == Some(VERSION) {
        region.word(word::FIRST)?
    } else {
        0
    };
    // The place where the next entry begins, and the place of the entry before it.
    let mut next = (first, 0);
    Ok(core::iter::from_fn(move || {
        let (at, before) = next;
        // Others may have written anything there: a walk that only goes forward comes to an end.
        if at <= before {
            return None;
        }
        let found = read(region, at);
        let following = found.as_ref().map_or(0, |(_, following)| *following);
        next = (following, at);
        Some(found.map(|(object, _)| object))
    }))
}

fn read<W: MemoryWindow>(region: &Region<W>, at: u32) -> Result<(SharedObject, u32), AccessError> {
    let word = |within: u32| region.word(at.saturating_add(within));
    let mut bytes = [0; NAME_BYTES];
    let len = word(entry::NAME_LEN)? as usize;
    let name = bytes.get_mut(..len).unwrap_or_default();
    region.read(at.saturating_add(entry::NAME), name)?;
    let object = SharedObject {
        name: ShortText::of(core::str::from_utf8(name).unwrap_or_default()),
        kind: ObjectKind::from_word(word(entry::KIND)?),
        offset: word(entry::OFFSET)?,
        len: word(entry::LEN)?,
    };
    Ok((object, word(entry::NEXT)?))
}

/// Returns the object called `name` of the kind `kind` in a processor's object table; `None` if the
/// table has no such object, or if there is no table. `region` is the users' region of that
/// processor.
///
/// # Errors
/// [`AccessError`] if the memory cannot be read.
pub fn find<W: MemoryWindow>(
    region: &Region<W>,
    name: &str,
    kind: ObjectKind,
) -> Result<Option<SharedObject>, AccessError> {
    for object in all(region)? {
        let object = object?;
        if object.kind == kind && object.name.as_str() == name {
            return Ok(Some(object));
        }
    }
    Ok(None)
}
