//! [`Debug`]: what DWARF says of static variables and their types.

use std::borrow::Cow;

use gimli::{
    AttributeValue, DW_AT_bit_offset, DW_AT_bit_size, DW_AT_byte_size, DW_AT_const_value,
    DW_AT_count, DW_AT_data_bit_offset, DW_AT_data_member_location, DW_AT_declaration, DW_AT_discr,
    DW_AT_discr_value, DW_AT_encoding, DW_AT_location, DW_AT_name, DW_AT_specification, DW_AT_type,
    DW_AT_upper_bound, DebugInfoOffset, Dwarf, EndianSlice, LittleEndian, Operation, Unit,
    UnitOffset, UnitSectionOffset,
};
use object::{Object as _, ObjectSection as _};

type Slice<'f> = EndianSlice<'f, LittleEndian>;
type Entry<'f> = gimli::DebuggingInformationEntry<Slice<'f>>;

/// The number of types that may refer to each other without a size of their own.
const DEPTH: u32 = 32;

/// The place of a type, or of another entry, in the debug information.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct TypeAt {
    unit: usize,
    offset: UnitOffset,
}

/// The place of a static variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum VariableLocation {
    /// All of its bytes are there, in order.
    Address(u64),
    /// The variable has no such address, because the compiler does this.
    None(&'static str),
}

/// A field of a structure.
#[derive(Clone, Debug)]
pub(super) struct Field {
    pub(super) name: String,
    pub(super) offset: u64,
    pub(super) at: TypeAt,
    /// For a bit field, its bits in the bytes from `offset` on; `None` for other fields.
    pub(super) bits: Option<Bits>,
}

/// Some bits of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Bits {
    /// The place of the lowest one in the first byte.
    pub(super) shift: u32,
    /// Their number, at most 64.
    pub(super) count: u32,
}

impl Bits {
    /// The bytes in which they are.
    pub(super) const fn bytes(self) -> u64 {
        (self.shift + self.count).div_ceil(8) as u64
    }

    /// Returns the value of a type of `size` bytes that they stand for.
    pub(super) fn value(self, bytes: &[u8], is_signed: bool, size: usize) -> Vec<u8> {
        let bytes = bytes.iter().take(9).rev();
        let word = bytes.fold(0_u128, |word, byte| word << 8 | u128::from(*byte));
        let unused = 128 - self.count;
        let high = (word >> self.shift) << unused;
        let value = if is_signed {
            (high.cast_signed() >> unused).cast_unsigned()
        } else {
            high >> unused
        };
        value.to_le_bytes().into_iter().take(size).collect()
    }
}

/// A variant of an enumeration with data.
#[derive(Clone, Debug)]
pub(super) struct Variant {
    /// The value of the tag; `None` for the variant that stands for all values without one.
    pub(super) tag: Option<u64>,
    /// Its data, a structure that has the variant's name.
    pub(super) field: Field,
}

impl Field {
    /// The fields of tuples are called `__0` there.
    pub(super) fn shown_name(&self) -> &str {
        self.name.strip_prefix("__").unwrap_or(&self.name)
    }

    pub(super) fn has_name(&self, name: &str) -> bool {
        self.name == name || self.shown_name() == name
    }
}

/// The structure of a type.
#[derive(Clone, Debug)]
pub(super) enum Shape {
    Base {
        encoding: gimli::DwAte,
    },
    Pointer,
    Enumeration(Vec<(u64, String)>),
    Fields(Vec<Field>),
    /// One of several structures; the tag, if there is one, says which.
    Variants {
        tag: Option<Field>,
        of: Vec<Variant>,
    },
    Array {
        of: TypeAt,
        count: u64,
    },
    Unknown,
}

pub(super) struct Debug<'f> {
    dwarf: Dwarf<Slice<'f>>,
    units: Vec<Unit<Slice<'f>>>,
}

impl core::fmt::Debug for Debug<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Debug").finish_non_exhaustive()
    }
}

/// Returns the address at which a program begins, as its file counts addresses.
pub(super) fn entry(file: &[u8]) -> Result<u64, String> {
    let object = object::File::parse(file).map_err(|error| error.to_string())?;
    Ok(object.entry())
}

impl<'f> Debug<'f> {
    pub(super) fn read(file: &'f [u8]) -> Result<Self, String> {
        let object = object::File::parse(file).map_err(|error| error.to_string())?;
        let section = |id: gimli::SectionId| -> Result<Slice<'f>, String> {
            let section = object.section_by_name(id.name());
            let data = section.map_or(Ok(Cow::Borrowed(&[][..])), |section| {
                section.uncompressed_data()
            });
            match data.map_err(|error| error.to_string())? {
                Cow::Borrowed(data) => Ok(EndianSlice::new(data, LittleEndian)),
                Cow::Owned(_) => Err(format!("the section {} is compressed", id.name())),
            }
        };
        let dwarf = Dwarf::load(section)?;
        let mut units = Vec::new();
        let mut headers = dwarf.units();
        while let Some(header) = headers.next().map_err(|error| error.to_string())? {
            units.push(dwarf.unit(header).map_err(|error| error.to_string())?);
        }
        if units.is_empty() {
            return Err("build the program with `debug = 2`".into());
        }
        Ok(Self { dwarf, units })
    }

    /// The static variables whose path ends with these segments: path, type and place. The paths of several that are
    /// alike have the names of their units behind them.
    pub(super) fn variables(
        &self,
        name: &str,
    ) -> Result<Vec<(String, TypeAt, VariableLocation)>, String> {
        let mut found: Vec<(String, TypeAt, VariableLocation)> = Vec::new();
        let mut units = Vec::new();
        for (number, unit) in self.units.iter().enumerate() {
            let mut path: Vec<(isize, String)> = Vec::new();
            // The depths of the functions around an entry.
            let mut functions: Vec<isize> = Vec::new();
            let mut entries = unit.entries();
            while let Some(entry) = entries.next_dfs().map_err(|error| error.to_string())? {
                let depth = entry.depth();
                while path.last().is_some_and(|(above, _)| *above >= depth) {
                    path.pop();
                }
                let function = entry.tag() == gimli::DW_TAG_subprogram;
                if function || entry.tag() == gimli::DW_TAG_namespace {
                    path.push((depth, self.name(unit, entry)));
                    functions.retain(|above| *above < depth);
                    functions.extend(function.then_some(depth));
                }
                if entry.tag() != gimli::DW_TAG_variable {
                    continue;
                }
                functions.retain(|above| *above < depth);
                // A definition of what was declared before it refers to the declaration for name, type and path.
                let declared = match entry.attr_value(DW_AT_specification) {
                    Some(value) => match self.reference(number, &value) {
                        Some(at) => Some(at),
                        None => continue,
                    },
                    None => None,
                };
                let declaration = declared.and_then(|at| {
                    let unit = self.units.get(at.unit)?;
                    Some((at.unit, unit, unit.entry(at.offset).ok()?))
                });
                let (home, home_unit, named) = match &declaration {
                    Some((home, home_unit, named)) => (*home, *home_unit, named),
                    None => (number, unit, entry),
                };
                let Some(at) = self.type_of(home, named) else {
                    continue;
                };
                let own = self.name(home_unit, named);
                if !name.ends_with(&own) && !own.ends_with(name) {
                    continue;
                }
                let Some(place) = self.place(unit, entry, self.size(at), !functions.is_empty())
                else {
                    continue;
                };
                let declared_in = declared.and_then(|at| self.path_to(at));
                let path = declared_in.as_ref().unwrap_or(&path);
                let segments = path.iter().map(|(_, name)| &**name);
                let whole = segments.chain([&*own]).collect::<Vec<_>>().join("::");
                let ends = whole.strip_suffix(name);
                let is_it = ends.is_some_and(|rest| rest.is_empty() || rest.ends_with("::"));
                let known = |(path, _, known): &(String, TypeAt, VariableLocation)| match place {
                    VariableLocation::Address(_) => *known == place,
                    VariableLocation::None(_) => *path == whole,
                };
                if is_it && !found.iter().any(known) {
                    found.push((whole, at, place));
                    units.push(unit);
                }
            }
        }
        let paths: Vec<_> = found.iter().map(|(path, ..)| path.clone()).collect();
        for ((path, ..), unit) in found.iter_mut().zip(units) {
            let alike = paths.iter().filter(|it| *it == path).count();
            if alike > 1
                && let Some(name) = &unit.name
            {
                *path = format!("{path} ({})", name.to_string_lossy());
            }
        }
        Ok(found)
    }

    /// The names of what is around an entry, each with its depth.
    fn path_to(&self, at: TypeAt) -> Option<Vec<(isize, String)>> {
        let unit = self.units.get(at.unit)?;
        let mut path: Vec<(isize, String)> = Vec::new();
        let mut entries = unit.entries();
        while let Some(entry) = entries.next_dfs().ok()? {
            let depth = entry.depth();
            path.retain(|(above, _)| *above < depth);
            if entry.offset() == at.offset {
                return Some(path);
            }
            if matches!(
                entry.tag(),
                gimli::DW_TAG_namespace
                    | gimli::DW_TAG_subprogram
                    | gimli::DW_TAG_structure_type
                    | gimli::DW_TAG_class_type
                    | gimli::DW_TAG_union_type
            ) {
                path.push((depth, self.name(unit, entry)));
            }
        }
        None
    }

    /// Returns the place of a static variable of `size` bytes; `None` if the entry is not a static
    /// variable, or only declares one.
    fn place(
        &self,
        unit: &Unit<Slice<'f>>,
        entry: &Entry<'f>,
        size: u64,
        in_function: bool,
    ) -> Option<VariableLocation> {
        // Most variables of functions are on the stack or in registers; the others begin with an address.
        let nowhere = |reason| (!in_function).then_some(VariableLocation::None(reason));
        let expression = match entry.attr_value(DW_AT_location) {
            Some(AttributeValue::Exprloc(expression)) => expression,
            Some(_) => return nowhere("moves it while the program runs"),
            None if entry.attr_value(DW_AT_declaration).is_some() => return None,
            None if entry.attr_value(DW_AT_const_value).is_some() => {
                return nowhere("uses its only value directly");
            }
            None => return nowhere("has removed it"),
        };
        let mut operations = expression.operations(unit.encoding());
        let first = match operations.next() {
            Ok(Some(Operation::Address { address })) => Some(address),
            Ok(Some(Operation::AddressIndex { index })) => self.dwarf.address(unit, index).ok(),
            Ok(None) => return nowhere("has removed it"),
            _ => None,
        };
        let Some(mut address) = first else {
            return nowhere("keeps it in another form, or has one for each thread");
        };
        // The first operation alone is the address of something else if others follow it: the compiler lets
        // variables share a place, splits them, and keeps values in another form.
        loop {
            let reason = match operations.next() {
                Ok(None) => return Some(VariableLocation::Address(address)),
                Ok(Some(Operation::PlusConstant { value })) => {
                    address = address.wrapping_add(value);
                    continue;
                }
                Ok(Some(Operation::Piece {
                    size_in_bits,
                    bit_offset: None,
                })) if size > 0 && size_in_bits == size.saturating_mul(8) => continue,
                Ok(Some(Operation::Piece { .. })) => {
                    "keeps only parts of it, or stores its parts separately"
                }
                Ok(Some(_)) => "keeps it in another form, from which its value is computed",
                Err(_) => {
                    return Some(VariableLocation::None(
                        "describes its address in a way that this program cannot read",
                    ));
                }
            };
            return Some(VariableLocation::None(reason));
        }
    }

    fn name(&self, unit: &Unit<Slice<'f>>, entry: &Entry<'f>) -> String {
        let value = entry.attr_value(DW_AT_name);
        let name = value.and_then(|value| self.dwarf.attr_string(unit, value).ok());
        name.map_or_else(String::new, |name| name.to_string_lossy().into_owned())
    }

    fn type_of(&self, unit: usize, entry: &Entry<'f>) -> Option<TypeAt> {
        self.reference(unit, &entry.attr_value(DW_AT_type)?)
    }

    /// The entry to which an attribute in a unit refers.
    fn reference(&self, unit: usize, value: &AttributeValue<Slice<'f>>) -> Option<TypeAt> {
        match *value {
            AttributeValue::UnitRef(offset) => Some(TypeAt { unit, offset }),
            AttributeValue::DebugInfoRef(offset) => self.elsewhere(offset),
            _ => None,
        }
    }

    /// A place in another unit.
    fn elsewhere(&self, offset: DebugInfoOffset) -> Option<TypeAt> {
        let mut units = self.units.iter().enumerate();
        units.find_map(|(unit, it)| {
            let offset = UnitSectionOffset(offset.0).to_unit_offset(it)?;
            Some(TypeAt { unit, offset })
        })
    }

    fn number(entry: &Entry<'f>, name: gimli::DwAt) -> Option<u64> {
        let value = entry.attr_value(name)?;
        let signed = || value.sdata_value().map(i64::cast_unsigned);
        value.udata_value().or_else(signed)
    }

    /// The size of a value of a type in bytes; 0 if it has none, or is not known.
    pub(super) fn size(&self, at: TypeAt) -> u64 {
        self.size_within(at, DEPTH)
    }

    fn size_within(&self, at: TypeAt, depth: u32) -> u64 {
        let entry = self.units.get(at.unit);
        let entry = entry.and_then(|unit| unit.entry(at.offset).ok());
        let (Some(entry), Some(deeper)) = (entry, depth.checked_sub(1)) else {
            return 0;
        };
        if let Some(bytes) = Self::number(&entry, DW_AT_byte_size) {
            return bytes;
        }
        match self.shape(at) {
            Shape::Array { of, count } => self.size_within(of, deeper).saturating_mul(count),
            Shape::Pointer => 8,
            _ => match self.type_of(at.unit, &entry) {
                Some(other) => self.size_within(other, deeper),
                None => 0,
            },
        }
    }

    /// The one field of a structure that wraps it, if it does: what else it has takes no room.
    pub(super) fn wrapped(&self, fields: &[Field]) -> Option<Field> {
        let mut sized = fields.iter().filter(|field| self.size(field.at) > 0);
        match (sized.next(), sized.next()) {
            (Some(field), None) if field.bits.is_none() => Some(field.clone()),
            _ => None,
        }
    }

    pub(super) fn shape(&self, mut at: TypeAt) -> Shape {
        for _ in 0..DEPTH {
            let Some(unit) = self.units.get(at.unit) else {
                return Shape::Unknown;
            };
            let Ok(entry) = unit.entry(at.offset) else {
                return Shape::Unknown;
            };
            match entry.tag() {
                gimli::DW_TAG_base_type => {
                    let encoding = match entry.attr_value(DW_AT_encoding) {
                        Some(AttributeValue::Encoding(encoding)) => encoding,
                        _ => gimli::DW_ATE_unsigned,
                    };
                    return Shape::Base { encoding };
                }
                gimli::DW_TAG_pointer_type | gimli::DW_TAG_reference_type => return Shape::Pointer,
                gimli::DW_TAG_structure_type | gimli::DW_TAG_union_type => {
                    let variants = self.variants(at);
                    return variants
                        .unwrap_or_else(|| Shape::Fields(self.fields(at).unwrap_or_default()));
                }
                gimli::DW_TAG_enumeration_type => {
                    return Shape::Enumeration(self.enumerators(at).unwrap_or_default());
                }
                gimli::DW_TAG_array_type => {
                    let of = self.type_of(at.unit, &entry);
                    return match (of, self.count(at)) {
                        (Some(of), Some(count)) => Shape::Array { of, count },
                        _ => Shape::Unknown,
                    };
                }
                // Typedefs and qualifiers.
                _ => match self.type_of(at.unit, &entry) {
                    Some(other) => at = other,
                    None => return Shape::Unknown,
                },
            }
        }
        Shape::Unknown
    }

    /// Calls `look` for each entry directly below one.
    fn below(&self, at: TypeAt, mut look: impl FnMut(&Unit<Slice<'f>>, &Entry<'f>)) -> Option<()> {
        let unit = self.units.get(at.unit)?;
        let mut tree = unit.entries_tree(Some(at.offset)).ok()?;
        let mut children = tree.root().ok()?.children();
        while let Some(child) = children.next().ok()? {
            look(unit, child.entry());
        }
        Some(())
    }

    fn fields(&self, at: TypeAt) -> Option<Vec<Field>> {
        let mut fields = Vec::new();
        self.below(at, |unit, entry| {
            if entry.tag() == gimli::DW_TAG_member
                && let Some(field) = self.field(at.unit, unit, entry)
            {
                fields.push(field);
            }
        })?;
        Some(fields)
    }

    fn field(&self, number: usize, unit: &Unit<Slice<'f>>, entry: &Entry<'f>) -> Option<Field> {
        let at = self.type_of(number, entry)?;
        let mut offset = Self::number(entry, DW_AT_data_member_location).unwrap_or(0);
        let mut bits = None;
        if let Some(count) = Self::number(entry, DW_AT_bit_size) {
            let count = u32::try_from(count)
                .ok()
                .filter(|it| (1..=64).contains(it))?;
            let first = if let Some(first) = Self::number(entry, DW_AT_data_bit_offset) {
                first
            } else {
                // Before DWARF 4 it is counted from the highest bit of the number down.
                let high = Self::number(entry, DW_AT_bit_offset).unwrap_or(0);
                let own = Self::number(entry, DW_AT_byte_size);
                let of = own.unwrap_or_else(|| self.size(at)).checked_mul(8)?;
                of.checked_sub(high)?.checked_sub(count.into())?
            };
            offset = offset.checked_add(first / 8)?;
            let shift = (first % 8) as u32;
            bits = Some(Bits { shift, count });
        }
        Some(Field {
            name: self.name(unit, entry),
            offset,
            at,
            bits,
        })
    }

    /// The variants of an enumeration with data; `None` if the structure is none.
    fn variants(&self, at: TypeAt) -> Option<Shape> {
        let mut part = None;
        self.below(at, |_, entry| {
            if entry.tag() == gimli::DW_TAG_variant_part {
                let tag = match entry.attr_value(DW_AT_discr) {
                    Some(AttributeValue::UnitRef(offset)) => Some(offset),
                    _ => None,
                };
                part = Some((entry.offset(), tag));
            }
        })?;
        let (part, tag) = part?;
        let unit = self.units.get(at.unit)?;
        let tag = tag.and_then(|tag| self.field(at.unit, unit, &unit.entry(tag).ok()?));
        let part = TypeAt {
            unit: at.unit,
            offset: part,
        };
        let mut variants = Vec::new();
        self.below(part, |_, entry| {
            if entry.tag() == gimli::DW_TAG_variant {
                variants.push((entry.offset(), Self::number(entry, DW_AT_discr_value)));
            }
        })?;
        let of = variants.into_iter().filter_map(|(offset, tag)| {
            let at = TypeAt {
                unit: at.unit,
                offset,
            };
            let field = self.fields(at)?.into_iter().next()?;
            Some(Variant { tag, field })
        });
        Some(Shape::Variants {
            tag,
            of: of.collect(),
        })
    }

    fn enumerators(&self, at: TypeAt) -> Option<Vec<(u64, String)>> {
        let mut names = Vec::new();
        self.below(at, |unit, entry| {
            if let Some(value) = Self::number(entry, DW_AT_const_value) {
                names.push((value, self.name(unit, entry)));
            }
        })?;
        Some(names)
    }

    fn count(&self, at: TypeAt) -> Option<u64> {
        let mut count = None;
        self.below(at, |_, entry| {
            if entry.tag() == gimli::DW_TAG_subrange_type {
                let last = Self::number(entry, DW_AT_upper_bound);
                let behind = last.and_then(|last| last.checked_add(1));
                let one = Self::number(entry, DW_AT_count).or(behind);
                count = match (count, one) {
                    (Some(before), Some(one)) => Some(u64::saturating_mul(before, one)),
                    (before, one) => before.or(one),
                };
            }
        })?;
        count
    }
}
