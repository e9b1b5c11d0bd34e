//! [`HartImage`]: a program as it is to lie in the memory of a machine.

use object::LittleEndian;
use object::elf::{self, Dyn64, FileHeader64};
use object::read::elf::{Dyn as _, FileHeader as _, ProgramHeader as _};

use condor_mbox::{AccessError, MemoryWindow, Region};

use super::map::{Map, PAGE};

/// The address at which harts see the beginning of the machine's memory.
pub const RAM: u64 = 0x8000_0000;

/// Bytes of an entry of a table of relocations.
const RELA_BYTES: u64 = 24;

/// A program in the form in which it lies in the memory of a hart: loaded from an ELF file, and
/// relocated to the addresses of that hart.
///
/// The file must be for RV64. It is either position-independent (static-pie, whose relocations are
/// all `R_RISCV_RELATIVE`; RISC-V ELF psABI, "Dynamic Linking"), or linked for the addresses of
/// that hart.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HartImage {
    bytes: Vec<u8>,
    /// The offset at which it begins, in bytes from the beginning of the memory.
    offset: u32,
    entry: u32,
    /// The bias to add to an address of the file.
    bias: u64,
}

/// The reason why a file cannot be the program of a hart, as text that also says what to do about
/// it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct HartImageError(String);

impl HartImageError {
    pub(crate) fn no_hart(hart: u32, map: &Map) -> Self {
        let harts = map.harts();
        Self(format!("there is no hart {hart}: the machine has {harts}"))
    }
}

/// The error of a program that would need a dynamic linker.
const DYNAMIC: &str = "it is dynamically linked; link it as static-pie, or as static";

/// A segment to load.
struct Segment<'f> {
    address: u64,
    end: u64,
    content: &'f [u8],
    align: u64,
    is_code: bool,
}

impl HartImage {
    /// Makes the image of a program for the hart with index `hart`. `file` is the content of an ELF
    /// file, and `map` the map of the machine's memory.
    ///
    /// # Errors
    /// [`HartImageError`] if the file is not a static RV64 program, does not fit into the memory of
    /// the hart, or the machine has no such hart.
    pub fn new(file: &[u8], map: &Map, hart: u32) -> Result<Self, HartImageError> {
        if hart >= map.harts() {
            return Err(HartImageError::no_hart(hart, map));
        }
        let header = header(file)?;
        let segments = header
            .program_headers(LittleEndian, file)
            .map_err(damaged)?;
        let mut dynamic: &[Dyn64<LittleEndian>] = &[];
        for segment in segments {
            if segment.p_type(LittleEndian) == elf::PT_INTERP {
                return Err(HartImageError(DYNAMIC.into()));
            }
            if let Some(found) = segment.dynamic(LittleEndian, file).map_err(damaged)? {
                dynamic = found;
            }
        }
        let mut loaded = Vec::new();
        for segment in segments {
            if segment.p_type(LittleEndian) == elf::PT_LOAD {
                loaded.extend(load(segment, file)?);
            }
        }
        loaded.sort_by_key(|segment| segment.address);
        let (Some(first), Some(last)) = (loaded.first(), loaded.last()) else {
            return Err(HartImageError("it has no segment to load".into()));
        };
        for (one, next) in loaded.iter().zip(loaded.iter().skip(1)) {
            if next.address < one.end {
                return Err(HartImageError(format!(
                    "its segment at {:#x} overlaps the one before, which ends at {:#x}",
                    next.address, one.end
                )));
            }
        }
        let low = first.address / u64::from(PAGE) * u64::from(PAGE);
        let needed = last.end - low;
        let most = u64::from(map.program_bytes());
        let range = RAM + u64::from(map.programs.at(hart));
        let bias = if header.e_type(LittleEndian) == elf::ET_DYN {
            range.wrapping_sub(low)
        } else {
            outside(&loaded, range, range + most)?;
            0
        };
        // From here on all that is loaded is inside of the range.
        if needed > most {
            return Err(HartImageError(format!(
                "it needs {needed:#x} bytes, but a hart has {most:#x} bytes for its program; raise `memory_bytes` of \
                 `[machine]`"
            )));
        }
        let mut image = Self {
            bytes: vec![0; usize::try_from(needed.next_multiple_of(4)).unwrap_or(0)],
            offset: offset(low.wrapping_add(bias)),
            entry: 0,
            bias,
        };
        for segment in &loaded {
            let at = segment.address.wrapping_add(bias);
            if segment.align > 1 && !bias.is_multiple_of(segment.align) {
                return Err(HartImageError(format!(
                    "its segment at {:#x} is aligned to {:#x}, and would lie at {at:#x}",
                    segment.address, segment.align
                )));
            }
            let place = image.range(low, segment.address, segment.content.len() as u64);
            if let Some(place) = place.and_then(|place| image.bytes.get_mut(place)) {
                place.copy_from_slice(segment.content);
            }
        }
        image.relocate(low, dynamic)?;
        let entry = header.e_entry.get(LittleEndian);
        let is_in = |segment: &&Segment<'_>| (segment.address..segment.end).contains(&entry);
        let code = loaded.iter().find(is_in).filter(|segment| segment.is_code);
        if code.is_none() || !entry.is_multiple_of(2) {
            let text = format!("its entry {entry:#x} lies in no segment of code");
            return Err(HartImageError(text));
        }
        image.entry = offset(entry.wrapping_add(bias));
        Ok(image)
    }

    /// Copies the image to its place in `memory`, the whole memory of the machine. The hart must
    /// not run a program meanwhile.
    ///
    /// # Errors
    /// [`AccessError`] if the memory cannot be accessed.
    pub fn load<W: MemoryWindow>(&self, memory: &Region<W>) -> Result<(), AccessError> {
        memory.write(self.offset, &self.bytes)
    }

    /// Returns the place of the program's first instruction, in bytes from the beginning of the
    /// memory.
    #[must_use]
    pub const fn entry(&self) -> u32 {
        self.entry
    }

    /// Returns the place at which the image begins, in bytes from the beginning of the memory.
    #[must_use]
    pub const fn offset(&self) -> u32 {
        self.offset
    }

    /// Returns the number of bytes that the image takes in the memory.
    #[must_use]
    pub fn len(&self) -> u32 {
        // The length fits: the image is no longer than the range of a hart.
        self.bytes.len() as u32
    }

    /// Returns true if the image has no bytes; the image of a program always has some.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    /// Converts an address at which the hart sees a byte of the program to the address in the ELF
    /// file, which a debugger uses. Returns `None` if `address` is outside of the program.
    #[must_use]
    pub fn linked(&self, address: u64) -> Option<u64> {
        let begin = RAM + u64::from(self.offset);
        let end = begin + u64::from(self.len());
        let is_inside = (begin..end).contains(&address);
        is_inside.then(|| address.wrapping_sub(self.bias))
    }

    /// Returns the range of the image that holds the bytes that are linked to `address`.
    fn range(&self, low: u64, address: u64, len: u64) -> Option<core::ops::Range<usize>> {
        let begin = address.checked_sub(low)?;
        let end = begin.checked_add(len)?;
        let range = usize::try_from(begin).ok()?..usize::try_from(end).ok()?;
        (range.end <= self.bytes.len()).then_some(range)
    }

    fn relocate(
        &mut self,
        low: u64,
        dynamic: &[Dyn64<LittleEndian>],
    ) -> Result<(), HartImageError> {
        let value = |tag: elf::DynamicTag| {
            let mut entries = dynamic
                .iter()
                .take_while(|entry| entry.tag(LittleEndian) != elf::DT_NULL);
            let entry = entries.find(|entry| entry.tag(LittleEndian) == tag);
            entry.map(|entry| entry.val(LittleEndian))
        };
        if value(elf::DT_NEEDED).is_some() {
            return Err(HartImageError(DYNAMIC.into()));
        }
        let known = [
            (elf::DT_RELA, elf::DT_RELASZ, true),
            (elf::DT_JMPREL, elf::DT_PLTRELSZ, true),
            (elf::DT_REL, elf::DT_RELSZ, false),
            (elf::DT_RELR, elf::DT_RELRSZ, false),
        ];
        for (tag, size, is_read) in known {
            let Some(address) = value(tag) else {
                continue;
            };
            let bytes = value(size).unwrap_or(0);
            if bytes == 0 {
                continue;
            }
            let table = self
                .range(low, address, bytes)
                .filter(|_| is_read && bytes.is_multiple_of(RELA_BYTES))
                .and_then(|range| self.bytes.get(range));
            let Some(table) = table else {
                return Err(HartImageError(format!(
                    "its table of relocations by tag {}, of {bytes:#x} bytes at {address:#x}, cannot be read",
                    tag.0
                )));
            };
            for entry in table.to_vec().as_chunks::<{ RELA_BYTES as usize }>().0 {
                self.relocate_one(low, entry)?;
            }
        }
        Ok(())
    }

    fn relocate_one(
        &mut self,
        low: u64,
        entry: &[u8; RELA_BYTES as usize],
    ) -> Result<(), HartImageError> {
        let [at, info, addend] = core::array::from_fn(|field| {
            let bytes = entry.as_chunks::<8>().0.get(field);
            bytes.map_or(0, |bytes| u64::from_le_bytes(*bytes))
        });
        match elf::RelocationType(info as u32) {
            elf::R_RISCV_NONE => return Ok(()),
            elf::R_RISCV_RELATIVE => {}
            other => {
                return Err(HartImageError(format!(
                    "its relocation at {at:#x} has type {}, but only type 3 (R_RISCV_RELATIVE) is supported",
                    other.0
                )));
            }
        }
        let place = self.range(low, at, 8);
        let Some(place) = place.and_then(|place| self.bytes.get_mut(place)) else {
            let text = format!("its relocation at {at:#x} is outside of the program");
            return Err(HartImageError(text));
        };
        place.copy_from_slice(&self.bias.wrapping_add(addend).to_le_bytes());
        Ok(())
    }
}

/// The head of the file, if it is for a hart.
fn header(file: &[u8]) -> Result<&FileHeader64<LittleEndian>, HartImageError> {
    let Some(rest) = file.strip_prefix(&elf::ELFMAG) else {
        let found = file.get(..4).unwrap_or(file);
        let text = format!("it is not an ELF file: it begins with {found:02x?}");
        return Err(HartImageError(text));
    };
    let expect = |what: &str, found: u16, expected: u16| {
        if found == expected {
            return Ok(());
        }
        Err(HartImageError(format!(
            "{what} is {found}, expected {expected}: build it for riscv64"
        )))
    };
    if let &[class, data, ..] = rest {
        expect("its class", class.into(), elf::ELFCLASS64.0.into())?;
        expect("its order of bytes", data.into(), elf::ELFDATA2LSB.0.into())?;
    }
    let header = FileHeader64::<LittleEndian>::parse(file).map_err(damaged)?;
    let machine = header.e_machine(LittleEndian).0;
    expect("its machine", machine, elf::EM_RISCV.0)?;
    match header.e_type(LittleEndian) {
        elf::ET_EXEC | elf::ET_DYN => Ok(header),
        other => Err(HartImageError(format!(
            "its type is {}, expected 2 (executable) or 3 (static-pie)",
            other.0
        ))),
    }
}

/// A segment, if it takes memory.
fn load<'f>(
    segment: &elf::ProgramHeader64<LittleEndian>,
    file: &'f [u8],
) -> Result<Option<Segment<'f>>, HartImageError> {
    let address = segment.p_vaddr(LittleEndian);
    let (bytes, memory_bytes) = (
        segment.p_filesz(LittleEndian),
        segment.p_memsz(LittleEndian),
    );
    let end = address.checked_add(memory_bytes);
    let Some(end) = end.filter(|_| bytes <= memory_bytes) else {
        return Err(HartImageError(format!(
            "its segment at {address:#x} has {bytes:#x} bytes in the file and {memory_bytes:#x} in memory"
        )));
    };
    if memory_bytes == 0 {
        return Ok(None);
    }
    let content = segment.data(LittleEndian, file).map_err(|()| {
        HartImageError(format!(
            "its segment at {address:#x} takes {bytes:#x} bytes from {:#x} on, but the file has only {:#x}",
            segment.p_offset(LittleEndian),
            file.len()
        ))
    })?;
    Ok(Some(Segment {
        address,
        end,
        content,
        align: segment.p_align(LittleEndian),
        is_code: segment.p_flags(LittleEndian).0 & elf::PF_X.0 != 0,
    }))
}

/// Refuses what does not lie in the range of the hart as it was linked.
fn outside(segments: &[Segment<'_>], range: u64, range_end: u64) -> Result<(), HartImageError> {
    for segment in segments {
        if segment.address < range || segment.end > range_end {
            return Err(HartImageError(format!(
                "its segment from {:#x} to {:#x} lies outside of the hart's range from {range:#x} to \
                 {range_end:#x}; link it as static-pie",
                segment.address, segment.end
            )));
        }
    }
    Ok(())
}

/// From an address inside of the memory.
const fn offset(address: u64) -> u32 {
    address.wrapping_sub(RAM) as u32
}

fn damaged(error: object::read::Error) -> HartImageError {
    HartImageError(format!("it is damaged: {error}"))
}
