//! [`Cell`]: a published cell whose fields are shown.

use condor_mbox::published::{PublishedReadError, read_bytes};
use condor_mbox::{Allocator, MemoryWindow, Published, Region};

use crate::catalog::{self, Body, CatalogError, Item};
use crate::kind::{AnyValue, ValueKind};
use crate::scalar::Scalar;
use crate::table::{TableEntry, VariableTable, VariableTableError};
use crate::var::VarDescription;

/// A struct whose latest value is published in a [`Published`] cell, and whose fields other
/// programs can read by name. [`cell_struct!`](crate::cell_struct) implements it.
pub trait CellStruct {
    /// The fields, in any order; some may be left out.
    const FIELDS: &'static [CellField];
}

/// The description of one field of a struct, for [`CellStruct::FIELDS`]: its name, unit, type and
/// offset. [`cell_struct!`](crate::cell_struct) makes it.
#[derive(Clone, Copy, Debug)]
pub struct CellField {
    name: &'static str,
    unit: &'static str,
    about: &'static str,
    labels: &'static [&'static str],
    kind: ValueKind,
    offset: usize,
    /// The number of elements of an array, which lie one after the other; `None` for a single field.
    count: Option<usize>,
}

/// A type that a field can have: a [`Scalar`], or an array of such fields. Elements of an array are shown as `name.0`,
/// `name.1` and so on, also those of an array of arrays.
pub trait CellValue {
    /// The type of the value, or of each element.
    type Element: Scalar;
    /// The number of elements; `None` if the field is not an array.
    const COUNT: Option<usize>;
}

impl<T: Scalar> CellValue for T {
    type Element = T;
    const COUNT: Option<usize> = None;
}

impl<T: CellValue, const N: usize> CellValue for [T; N] {
    type Element = T::Element;
    const COUNT: Option<usize> = match T::COUNT {
        Some(count) => Some(N * count),
        None => Some(N),
    };
}

/// Implements [`CellStruct`](crate::CellStruct) for a struct: after the name of each field that is shown come its place
/// in the struct, its unit, and a text for people, which may be left out.
///
/// A name has at most 96 bytes, a unit 32, and may be empty, a text 128. The type of a field is that of its place: see
/// [`CellValue`](crate::CellValue). Places are those of fields of nested structs, too.
///
/// ```
/// use condor_vars::cell_struct;
///
/// #[repr(C)]
/// struct Grasp {
///     forces: [f32; 4],
///     contacts: u32,
/// }
///
/// cell_struct!(Grasp {
///     "force": forces, "N", "At the tips.";
///     "contacts": contacts, "";
/// });
/// ```
#[macro_export]
macro_rules! cell_struct {
    ($struct:ident { $($name:literal: $($place:ident).+, $unit:literal $(, $about:literal)?;)+ }) => {
        impl $crate::CellStruct for $struct {
            const FIELDS: &'static [$crate::CellField] = &[$(
                $crate::CellField::of(
                    [$name, $unit, concat!($($about)?)],
                    ::core::mem::offset_of!($struct, $($place).+),
                    |it: &$struct| &it.$($place).+,
                )
            ),+];
        }
    };
}

impl CellField {
    /// Describes the field that a function returns, with its name, unit and text, and its place in bytes.
    #[doc(hidden)]
    #[must_use]
    pub const fn of<S, T: CellValue>(
        [name, unit, about]: [&'static str; 3],
        offset: usize,
        _: fn(&S) -> &T,
    ) -> Self {
        Self {
            name,
            unit,
            about,
            labels: T::Element::LABELS,
            kind: T::Element::KIND,
            offset,
            count: T::COUNT,
        }
    }

    /// Calls `body` with each element of an array, or with the single field.
    fn each(&self, body: &mut Body<'_>) -> Result<(), CatalogError> {
        (0..self.count.unwrap_or(1)).try_for_each(|index| {
            body(&Item {
                description: VarDescription {
                    kind: self.kind,
                    unit: self.unit,
                    about: self.about,
                    labels: self.labels,
                    bounds: [[0; 2]; 2],
                },
                name: &|to| match self.count {
                    None => to.write_str(self.name),
                    Some(_) => write!(to, "{}.{index}", self.name),
                },
                is_param: false,
                position: (self.offset + index * self.kind.bytes()) as u32,
            })
        })
    }
}

/// Writes a table that describes the fields of `cell`, so that other programs can read them by
/// their names. Returns the offset of the table in bytes, from the beginning of `own`.
///
/// `own` is the users' region of the program's own `data`, which must contain the cell, too.
/// `allocator` hands out the room for the table in it.
///
/// # Errors
/// Returns [`CatalogError::TooLong`] if a text or a list of labels is too long, [`CatalogError::TooMany`] if there are
/// too many fields, [`CatalogError::Access`] if there is no room for the table or its memory cannot be
/// accessed.
pub fn describe<T: CellStruct, W: MemoryWindow + Clone>(
    cell: Published<T>,
    own: &Region<W>,
    allocator: &mut Allocator,
) -> Result<u32, CatalogError> {
    let items = |body: &mut Body<'_>| T::FIELDS.iter().try_for_each(|field| field.each(body));
    let (shape, _) = catalog::measure(items)?;
    let cell = (cell.offset(), size_of::<T>() as u32);
    let (_, offset, _) = catalog::write(own, allocator, shape, (0, 0), cell, items)?;
    Ok(offset)
}

/// A reader of another program's published cell, which need not know the type of the cell's value:
/// a table in shared memory describes its fields. [`read`](Self::read) copies the value, and
/// [`TableEntry::of_cell`] takes a field out of it.
#[derive(Clone, Copy, Debug)]
pub struct Cell<W> {
    table: VariableTable<W>,
    users: Region<W>,
    offset: u32,
    bytes: usize,
}

/// The reason why a [`Cell`] cannot be opened or its value cannot be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CellError {
    /// The cell's table cannot be read.
    #[error(transparent)]
    Table(#[from] VariableTableError),
    /// The table is that of a loop, not of a cell.
    #[error(
        "the table has the variables of a servo loop, not the fields of a published cell: read them by a \
         `Watcher`, which `VariableClient` makes"
    )]
    NoCell,
    /// The buffer is too short for the value.
    #[error("the value has {bytes} bytes, but the buffer has {room}; pass a longer one")]
    Room {
        /// The size of the value, in bytes.
        bytes: usize,
        /// The size of the buffer, in bytes.
        room: usize,
    },
    /// There is no value yet, or no consistent one could be read.
    #[error(transparent)]
    Read(#[from] PublishedReadError),
}

impl<W: MemoryWindow + Clone> Cell<W> {
    /// Opens the cell that a table describes. `users` is the users' region of the `data` of the
    /// processor that has the cell; `offset` is the offset of the table in `users`, in bytes.
    ///
    /// # Errors
    /// Returns [`CellError::Table`] if the table cannot be read, [`CellError::NoCell`] if it describes a loop instead
    /// of a cell.
    pub fn open(users: &Region<W>, offset: u32) -> Result<Self, CellError> {
        let table = VariableTable::open(users, offset)?;
        let (offset, bytes) = table.cell().ok_or(CellError::NoCell)?;
        Ok(Self {
            table,
            users: users.clone(),
            offset,
            bytes: bytes as usize,
        })
    }
}

impl<W: MemoryWindow> Cell<W> {
    /// Returns the table that describes the fields of the cell.
    #[must_use]
    pub const fn table(&self) -> &VariableTable<W> {
        &self.table
    }

    /// Returns the size of the cell's value in bytes: the least length of a buffer for
    /// [`read`](Self::read).
    #[must_use]
    pub const fn bytes(&self) -> usize {
        self.bytes
    }

    /// Copies the latest value of the cell into the beginning of `value`. Returns the sequence
    /// number of this value, which differs for each published value.
    ///
    /// # Errors
    /// Returns [`CellError::Room`] if `value` is too short, [`CellError::Read`] if there is no value yet or no
    /// consistent one could be read, [`CellError::Table`] if the owner has made the table anew.
    pub fn read(&self, value: &mut [u8]) -> Result<u32, CellError> {
        let (bytes, room) = (self.bytes, value.len());
        let value = value
            .get_mut(..bytes)
            .ok_or(CellError::Room { bytes, room })?;
        let sequence = read_bytes(&self.users, self.offset, value)?;
        self.table.check_incarnation()?;
        Ok(sequence)
    }
}

impl TableEntry {
    /// Returns the value of the field that this entry describes. `value` has the bytes of the whole
    /// cell, as [`Cell::read`] copies them. Returns `None` if `value` is too short.
    #[must_use]
    pub fn of_cell(&self, value: &[u8]) -> Option<AnyValue> {
        self.kind
            .value_of_bytes(value.get(self.position as usize..)?)
    }
}
