//! ELF files for RV64, made byte by byte.

/// `ET_EXEC`
pub(crate) const EXEC: u16 = 2;
/// `ET_DYN`
pub(crate) const DYN: u16 = 3;

/// Where the usual program is linked to lie.
pub(crate) const LOW: u64 = 0x10000;
/// Bytes of its code.
pub(crate) const CODE_BYTES: u64 = 0x1000;
/// Where it begins, from `LOW` on.
pub(crate) const ENTRY: u64 = 0x10;
/// What lies there: `wfi` and `j .`
pub(crate) const CODE: u64 = 0x0000_006f_1050_0073;
/// A word that leads to `OBJECT`.
pub(crate) const POINTER: u64 = 0x1000;
pub(crate) const OBJECT: u64 = 0x1008;
/// Memory of zeros.
pub(crate) const BSS: u64 = 0x2000;
pub(crate) const BSS_LAST: u64 = END - 8;
pub(crate) const END: u64 = 0x3000;

/// Bytes of the file's head and of those of three segments.
pub(crate) const HEADS: usize = 64 + 3 * 56;

#[derive(Clone, Debug, Default)]
pub(crate) struct Segment {
    pub(crate) kind: u32,
    pub(crate) flags: u32,
    pub(crate) address: u64,
    /// Laid down at `offset`.
    pub(crate) content: Vec<u8>,
    pub(crate) offset: u64,
    pub(crate) bytes: u64,
    pub(crate) memory_bytes: u64,
    pub(crate) align: u64,
}

#[derive(Clone, Debug)]
pub(crate) struct Relocation {
    pub(crate) at: u64,
    pub(crate) kind: u32,
    pub(crate) addend: u64,
}

#[derive(Clone, Debug)]
pub(crate) struct File {
    pub(crate) magic: [u8; 4],
    pub(crate) class: u8,
    pub(crate) order: u8,
    pub(crate) kind: u16,
    pub(crate) machine: u16,
    pub(crate) entry: u64,
    pub(crate) segments: Vec<Segment>,
    pub(crate) relocations: Vec<Relocation>,
    /// Tags of the dynamic section that come before the usual ones.
    pub(crate) tags: Vec<(u64, u64)>,
}

/// Where the tables begin in the segment of data.
const RELOCATIONS: u64 = 0x100;
const DYNAMIC: u64 = 0x800;

impl File {
    /// A program of code, data with a pointer and a text, and zeros; linked to `LOW`.
    pub(crate) fn pie() -> Self {
        let mut code = vec![0; CODE_BYTES as usize];
        code[ENTRY as usize..][..8].copy_from_slice(&CODE.to_le_bytes());
        let mut data = vec![0; 0x1000];
        data[8..16].copy_from_slice(&0x1234_u64.to_le_bytes());
        let load = Segment {
            kind: 1,
            align: 0x1000,
            ..Segment::default()
        };
        Self {
            magic: *b"\x7fELF",
            class: 2,
            order: 1,
            kind: DYN,
            machine: 243,
            entry: LOW + ENTRY,
            segments: vec![
                Segment {
                    flags: 5,
                    address: LOW,
                    content: code,
                    offset: 0x1000,
                    bytes: CODE_BYTES,
                    memory_bytes: CODE_BYTES,
                    ..load.clone()
                },
                Segment {
                    flags: 6,
                    address: LOW + POINTER,
                    content: data,
                    offset: 0x2000,
                    bytes: 0x1000,
                    memory_bytes: END - POINTER,
                    ..load
                },
                Segment {
                    kind: 2,
                    address: LOW + POINTER + DYNAMIC,
                    offset: 0x2000 + DYNAMIC,
                    bytes: 0x400,
                    memory_bytes: 0x400,
                    align: 8,
                    ..Segment::default()
                },
            ],
            relocations: vec![
                Relocation {
                    at: LOW + POINTER,
                    kind: 3,
                    addend: LOW + OBJECT,
                },
                Relocation {
                    at: LOW + POINTER + 0x40,
                    kind: 3,
                    addend: LOW,
                },
            ],
            tags: Vec::new(),
        }
    }

    /// The same program, linked to lie further on.
    pub(crate) fn shift(&mut self, by: u64) {
        self.entry = self.entry.wrapping_add(by);
        for segment in &mut self.segments {
            segment.address = segment.address.wrapping_add(by);
        }
        for relocation in &mut self.relocations {
            relocation.at = relocation.at.wrapping_add(by);
            relocation.addend = relocation.addend.wrapping_add(by);
        }
    }

    /// Where in the file the dynamic section begins.
    pub(crate) fn tables(&self) -> usize {
        self.segments[2].offset as usize
    }

    pub(crate) fn build(&self) -> Vec<u8> {
        let mut file = Vec::new();
        file.extend(self.magic);
        file.extend([self.class, self.order, 1]);
        file.resize(16, 0);
        file.extend(self.kind.to_le_bytes());
        file.extend(self.machine.to_le_bytes());
        file.extend(1_u32.to_le_bytes());
        file.extend(self.entry.to_le_bytes());
        file.extend(64_u64.to_le_bytes());
        file.extend(0_u64.to_le_bytes());
        file.extend(0_u32.to_le_bytes());
        for half in [64, 56, self.segments.len() as u16, 64, 0, 0] {
            file.extend(half.to_le_bytes());
        }
        for segment in &self.segments {
            file.extend(segment.kind.to_le_bytes());
            file.extend(segment.flags.to_le_bytes());
            for double in [
                segment.offset,
                segment.address,
                segment.address,
                segment.bytes,
                segment.memory_bytes,
                segment.align,
            ] {
                file.extend(double.to_le_bytes());
            }
        }
        file.resize(0x3000, 0);
        for segment in &self.segments {
            if let Some(place) = file.get_mut(segment.offset as usize..) {
                let len = segment.content.len();
                if let Some(place) = place.get_mut(..len) {
                    place.copy_from_slice(&segment.content);
                }
            }
        }
        let mut put = |at: u64, doubles: &[u64]| {
            for (place, double) in (at as usize..).step_by(8).zip(doubles) {
                file[0x2000 + place..][..8].copy_from_slice(&double.to_le_bytes());
            }
        };
        for (place, one) in (RELOCATIONS..).step_by(24).zip(&self.relocations) {
            put(place, &[one.at, one.kind.into(), one.addend]);
        }
        let data = self.segments.get(1).map_or(0, |segment| segment.address);
        let usual = [
            (7, data + RELOCATIONS),
            (8, 24 * self.relocations.len() as u64),
            (9, 24),
            (0, 0),
        ];
        for (place, (tag, value)) in (DYNAMIC..).step_by(16).zip(self.tags.iter().chain(&usual)) {
            put(place, &[*tag, *value]);
        }
        file
    }
}
