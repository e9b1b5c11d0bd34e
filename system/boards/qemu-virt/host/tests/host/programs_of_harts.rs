//! ELF files as programs of harts: placed, relocated, or refused with the reason.

use crate::elf::{DYN, EXEC, File, Segment};
use condor_mbox::MemoryWindow;
use proptest::prelude::*;
use qemu_virt_host::{HartImage, HartImageError, MachineMemory, Map, RAM};

use crate::elf;

const MEMORY: u32 = 16 << 20;

fn map() -> Map {
    Map::new(MEMORY, &[1, 2], 4096, 4096, 0).unwrap()
}

fn range(hart: u32) -> u64 {
    RAM + u64::from(map().programs.at(hart))
}

fn image(file: &File) -> Result<HartImage, HartImageError> {
    HartImage::new(&file.build(), &map(), 1)
}

/// What a program reads at an address of its own, after it was put into the memory.
fn word(memory: &MachineMemory, address: u64) -> u64 {
    let mut bytes = [0; 8];
    let offset = u32::try_from(address - RAM).unwrap();
    memory.region().read(offset, &mut bytes).unwrap();
    u64::from_le_bytes(bytes)
}

#[test]
fn a_program_is_moved_to_the_range_of_its_hart() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("ram");
    MachineMemory::create(&path, &map()).unwrap();
    let memory = MachineMemory::open(&path).unwrap();
    let file = File::pie();
    for hart in 0..2 {
        let begin = range(hart);
        // What another program left behind.
        let dirt = vec![0xff; 0x4000];
        memory.region().write((begin - RAM) as u32, &dirt).unwrap();
        let image = memory.load(hart, &file.build()).unwrap();
        assert_eq!(RAM + u64::from(image.offset()), begin);
        assert_eq!(RAM + u64::from(image.entry()), begin + elf::ENTRY);
        assert_eq!(word(&memory, begin + elf::ENTRY), elf::CODE);
        // The pointer leads to where its object lies now.
        assert_eq!(word(&memory, begin + elf::POINTER), begin + elf::OBJECT);
        assert_eq!(word(&memory, begin + elf::OBJECT), 0x1234);
        assert_eq!(word(&memory, begin + elf::BSS), 0, "bss");
        assert_eq!(word(&memory, begin + elf::BSS_LAST), 0, "the end of bss");
        assert_eq!(word(&memory, begin + elf::END), u64::MAX, "what is behind");
        let code = begin + elf::ENTRY;
        assert_eq!(image.linked(code), Some(elf::LOW + elf::ENTRY));
        assert_eq!(image.linked(begin + elf::END), None);
        assert_eq!(image.linked(begin - 1), None);
    }
    let error = memory.load(2, &file.build()).unwrap_err();
    assert_eq!(error.to_string(), "there is no hart 2: the machine has 2");
}

#[test]
fn a_program_that_was_linked_for_its_range_stays_there() {
    let mut file = File::pie();
    file.kind = EXEC;
    file.shift(range(1) - elf::LOW);
    let image = image(&file).unwrap();
    assert_eq!(RAM + u64::from(image.offset()), range(1));
    let code = range(1) + elf::ENTRY;
    assert_eq!(image.linked(code), Some(code));
    file.shift(range(0).wrapping_sub(range(1)));
    let (begin, end) = (range(0), range(0) + elf::CODE_BYTES);
    let error = HartImage::new(&file.build(), &map(), 1).unwrap_err();
    let (least, most) = (range(1), range(1) + u64::from(map().program_bytes()));
    assert_eq!(
        error.to_string(),
        format!(
            "its segment from {begin:#x} to {end:#x} lies outside of the hart's range from {least:#x} \
             to {most:#x}; link it as static-pie"
        )
    );
}

#[test]
fn what_is_wrong_is_told() {
    type Change = fn(&mut File);
    let cases: [(Change, &str); 19] = [
        (
            |file| file.magic = *b"\x7fELG",
            "it is not an ELF file: it begins with [7f, 45, 4c, 47]",
        ),
        (
            |file| file.class = 1,
            "its class is 1, expected 2: build it for riscv64",
        ),
        (
            |file| file.order = 2,
            "its order of bytes is 2, expected 1: build it for riscv64",
        ),
        (
            |file| file.machine = 62,
            "its machine is 62, expected 243: build it for riscv64",
        ),
        (
            |file| file.kind = 1,
            "its type is 1, expected 2 (executable) or 3 (static-pie)",
        ),
        (|file| file.segments.clear(), "it has no segment to load"),
        (
            |file| file.segments[0].bytes = 0x9000,
            "its segment at 0x10000 has 0x9000 bytes in the file and 0x1000 in memory",
        ),
        (
            |file| file.segments[1].memory_bytes = u64::MAX,
            "its segment at 0x11000 has 0x1000 bytes in the file and 0xffffffffffffffff in memory",
        ),
        (
            |file| file.segments[1].offset = 1 << 40,
            "its segment at 0x11000 takes 0x1000 bytes from 0x10000000000 on, but the file",
        ),
        (
            |file| file.segments[1].address -= 8,
            "its segment at 0x10ff8 overlaps the one before, which ends at 0x11000",
        ),
        (
            |file| file.segments[1].memory_bytes = 1 << 24,
            "it needs 0x1001000 bytes, but a hart has 0x",
        ),
        (
            |file| file.segments[0].align = 1 << 21,
            "its segment at 0x10000 is aligned to 0x200000, and would lie at 0x8",
        ),
        (
            |file| file.entry = elf::LOW + elf::OBJECT,
            "its entry 0x11008 lies in no segment of code",
        ),
        (
            |file| file.entry = 0,
            "its entry 0x0 lies in no segment of code",
        ),
        (
            |file| file.relocations[0].kind = 2,
            "its relocation at 0x11000 has type 2, but only type 3 (R_RISCV_RELATIVE) is supported",
        ),
        (
            |file| file.relocations[0].at = 0x12ffc,
            "its relocation at 0x12ffc is outside of the program",
        ),
        (
            |file| file.tags.push((7, 0x1000)),
            "its table of relocations by tag 7, of 0x30 bytes at 0x1000, cannot be read",
        ),
        (
            |file| file.tags.extend([(36, 0x11000), (35, 8)]),
            "its table of relocations by tag 36, of 0x8 bytes at 0x11000, cannot be read",
        ),
        (
            |file| file.tags.push((1, 1)),
            "it is dynamically linked; link it as static-pie, or as static",
        ),
    ];
    for (change, expected) in cases {
        let mut file = File::pie();
        change(&mut file);
        let error = image(&file).unwrap_err().to_string();
        assert!(error.starts_with(expected), "{error}\nexpected {expected}");
    }
    let interpreted = Segment {
        kind: 3,
        ..Segment::default()
    };
    let mut file = File::pie();
    file.segments.push(interpreted);
    let error = image(&file).unwrap_err().to_string();
    assert!(error.starts_with("it is dynamically linked"), "{error}");
}

#[test]
fn a_refused_program_leaves_the_memory_as_it_was() {
    let directory = tempfile::tempdir().unwrap();
    let memory = MachineMemory::create(directory.path().join("ram"), &map()).unwrap();
    let before = memory.load(1, &File::pie().build()).unwrap();
    let content = std::fs::read(memory.path()).unwrap();
    let mut file = File::pie();
    file.segments[0].content = vec![7; 64];
    file.relocations[1].kind = 5;
    let error = memory.load(1, &file.build()).unwrap_err();
    let error = error.to_string();
    assert!(error.contains(" has type 5, "), "{error}");
    assert!(content == std::fs::read(memory.path()).unwrap());
    assert_eq!(before, memory.load(1, &File::pie().build()).unwrap());
}

#[test]
fn a_memory_is_what_its_map_says() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("ram");
    let memory = MachineMemory::create(&path, &map()).unwrap();
    assert_eq!(memory.map(), &map());
    let bus = memory.bus().unwrap();
    assert_eq!((bus.offset, bus.bytes), (map().bus.into(), Some(4096)));
    let error = MachineMemory::create(&path, &map()).unwrap_err();
    assert!(error.to_string().starts_with("cannot make"), "{error}");

    let control = memory.control(1).unwrap();
    control.begin(5).unwrap();
    let system = memory.system(&directory.path().join("mailbox")).unwrap();
    let claim = system.claim(condor_mbox::Processor(3)).unwrap();
    claim.windows()[9].data.write(64, b"users' data").unwrap();
    memory.reset().unwrap();
    assert_eq!(control.state(), Ok(qemu_virt_host::HartState::Off));
    let mut text = [0; 11];
    let users = map().data.at(9) + 64;
    memory.region().read(users, &mut text).unwrap();
    assert_eq!(&text, b"users' data", "the windows stay");
    assert_eq!(MachineMemory::open(&path).unwrap().map(), &map());

    let file = std::fs::File::options().write(true).open(&path).unwrap();
    file.set_len(u64::from(MEMORY) - 4096).unwrap();
    let error = MachineMemory::open(&path).unwrap_err().to_string();
    assert!(
        error.ends_with("has 0xfff000 bytes, and its map says 0x1000000"),
        "{error}"
    );
    file.set_len(8).unwrap();
    assert!(MachineMemory::open(&path).is_err());
    file.set_len(0).unwrap();
    assert!(MachineMemory::open(&path).is_err());
    file.set_len(MEMORY.into()).unwrap();
    let error = MachineMemory::open(&path).unwrap_err().to_string();
    assert!(error.contains("has no map"), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 4096, ..ProptestConfig::default() })]

    /// Whatever a file says: no panic, and what is accepted lies in the range of its hart.
    #[test]
    fn changed_files_stay_in_their_range(
        is_static in any::<bool>(),
        changes in prop::collection::vec((0usize..elf::HEADS, any::<u8>(), any::<bool>()), 1..4),
        len in 0usize..0x4000,
    ) {
        let mut file = File::pie();
        if is_static {
            file.kind = EXEC;
            file.shift(range(1) - elf::LOW);
        }
        prop_assert!(file.kind == DYN || is_static);
        let mut bytes = file.build();
        let tables = file.tables();
        for (at, value, is_table) in changes {
            // Heads at the beginning, or the tables of the dynamic section.
            let at = if is_table { tables + at % 0x100 } else { at };
            bytes[at] = value;
        }
        if len < 0x400 {
            bytes.truncate(len);
        }
        if let Ok(image) = HartImage::new(&bytes, &map(), 1) {
            let (begin, end) = (image.offset(), image.offset() + image.len());
            prop_assert!(begin >= map().programs.at(1));
            prop_assert!(end <= map().programs.at(1) + map().program_bytes());
            prop_assert!((begin..end).contains(&image.entry()));
        }
    }
}
