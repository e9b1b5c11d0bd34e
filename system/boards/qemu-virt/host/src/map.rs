//! [`Map`]: what lies where in the memory of a machine of harts.

use condor_mbox::{AccessError, MemoryWindow, Region, layout};

use condor_rt::numbers::PROCESSORS;

/// The offset of the [`Map`] in the machine's memory, in bytes. The memory before the map belongs
/// to the monitor.
pub const AT: u32 = 1 << 20;
/// The number of bytes of a page. Every object in the map begins at a multiple of this.
pub const PAGE: u32 = 4096;
/// The greatest number of harts that a machine can have.
pub const HARTS: u32 = 12;
/// The number of harts that can have a serial port, from hart 0 on: as many as the PCI bus has interrupts.
pub const SERIAL_HARTS: u32 = 4;
/// The number of bytes of the stack of a hart's program.
pub const STACK_BYTES: u32 = 1024 * 1024;
/// The number of guard bytes directly below the stack of a hart, which no program can access.
pub const GUARD_BYTES: u32 = PAGE;

const MAGIC: u32 = u32::from_le_bytes(*b"CHRT");
const VERSION: u32 = 6;

mod word {
    pub(super) const MAGIC: u32 = 0;
    pub(super) const VERSION: u32 = 4;
    pub(super) const MEMORY: u32 = 8;
    pub(super) const HARTS: u32 = 12;
    /// Three times: offset, stride.
    pub(super) const MAIL: u32 = 16;
    pub(super) const DATA: u32 = 24;
    pub(super) const PROGRAMS: u32 = 32;
    pub(super) const DATA_BYTES: u32 = 40;
    pub(super) const BUS: u32 = 44;
    pub(super) const BUS_BYTES: u32 = 48;
    pub(super) const SHARED: u32 = 52;
    pub(super) const SHARED_BYTES: u32 = 56;
    pub(super) const CLOCK: u32 = 60;
    /// A word for each hart.
    pub(super) const NUMBERS: u32 = 64;
}

/// The number of bytes that the page of a simulated clock takes in the memory.
pub const CLOCK_BYTES: u32 = condor_clock::PAGE_BYTES;

/// Bytes of the map.
const BYTES: u32 = word::NUMBERS + 4 * HARTS;
/// The offset in a page, in bytes, from which on the harts' own software uses it, up to the end of
/// the page. In the page of the map this part belongs to all harts together. In the
/// [`Control`](super::Control) page of a hart it is the [debug area](super::Control::debug_area) of
/// that hart, which a debugger uses. The host sets these parts to 0 when the machine is switched
/// on.
pub const BOARD: u32 = PAGE / 2;
const _: () = assert!(BOARD + condor_debug::AREA_BYTES <= PAGE);

/// A row of equal objects in the memory, at equal distances.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ObjectRun {
    /// The offset of the first object, in bytes from the beginning of the memory.
    pub offset: u32,
    /// The distance from the beginning of an object to that of the next, in bytes.
    pub stride: u32,
}

impl ObjectRun {
    /// Returns the offset of the object with index `number`, counted from 0, in bytes from the
    /// beginning of the memory.
    #[must_use]
    pub const fn at(&self, number: u32) -> u32 {
        self.offset
            .saturating_add(self.stride.saturating_mul(number))
    }
}

/// The map of a machine's memory: the places of all objects in it. Offsets are in bytes from the
/// beginning of the memory, and are multiples of [`PAGE`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Map {
    /// The size of the memory in bytes.
    pub memory_bytes: u32,
    /// The `mail` of each processor, by its number.
    pub mail: ObjectRun,
    /// The `data` of each processor, by its number.
    pub data: ObjectRun,
    /// The size of each `data` in bytes.
    pub data_bytes: u32,
    /// The offset of the bus, the part of the memory that stands for the registers of simulated boards.
    pub bus: u32,
    /// The size of the bus in bytes; 0 if there is none.
    pub bus_bytes: u32,
    /// The offset of the memory that belongs to no processor.
    pub shared: u32,
    /// The size of that memory in bytes; 0 if there is none.
    pub shared_bytes: u32,
    /// The offset of the [`Page`](condor_clock::Page) of a simulated clock.
    pub clock: u32,
    /// The memory of each hart for its program and stack, by the index of the hart.
    pub programs: ObjectRun,
    /// The processor number of each hart, by the index of the hart. The length is the number of
    /// harts.
    pub numbers: heapless::Vec<u8, { HARTS as usize }>,
}

/// The reason why [`Map::new`] cannot lay out a memory, or [`Map::read`] finds no valid map in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MemoryMapError {
    /// The memory has no map.
    #[error(
        "the memory of the machine has no map: the word at {AT:#x} is {found:#010x}, not {MAGIC:#010x}"
    )]
    NoMap {
        /// The word in the place of the map's magic number.
        found: u32,
    },
    /// The map has another version.
    #[error(
        "the map of the machine has version {found}, not {VERSION}; build its programs and this one from the \
             same source"
    )]
    Version {
        /// The version of the map.
        found: u32,
    },
    /// The number of harts is 0, or greater than a machine can have.
    #[error("a machine has 1 to {HARTS} harts, not {found}")]
    Harts {
        /// The number of harts that was requested.
        found: u32,
    },
    /// The processor does not exist, or another hart is that processor.
    #[error(
        "hart {hart} cannot be processor {number}: numbers are below {PROCESSORS}, and each belongs to one hart"
    )]
    Number {
        /// The number of the hart.
        hart: u32,
        /// The number of the processor that it was to be.
        number: u32,
    },
    /// The memory is too small for the machine.
    #[error("the memory has {found:#x} bytes, but the machine needs {needed:#x}")]
    TooSmall {
        /// The size of the memory, in bytes.
        found: u32,
        /// The least size that the machine needs, in bytes.
        needed: u64,
    },
    /// An object of the map lies outside of the memory, or does not begin at a page.
    #[error(
        "the map puts {object} at {offset:#x}, with {bytes:#x} bytes: it must begin at a page and lie in the memory \
         of {memory:#x} bytes"
    )]
    Outside {
        /// The name of the object.
        object: &'static str,
        /// The offset of the object, in bytes.
        offset: u32,
        /// The size of the object, in bytes.
        bytes: u32,
        /// The size of the memory, in bytes.
        memory: u32,
    },
    /// The memory cannot be accessed.
    #[error(transparent)]
    Access(#[from] AccessError),
}

/// The least range that is of use, for stack and guard and as much again.
const LEAST_RANGE: u32 = 2 * (STACK_BYTES + GUARD_BYTES);

impl Map {
    /// Lays out the memory of a machine. All sizes are in bytes.
    ///
    /// `memory_bytes` is the size of the memory; `numbers[i]` is the processor number of hart *i*.
    /// Each processor of the system gets `user_bytes` of data for its users. `bus_bytes` are for
    /// the registers of simulated boards, and `shared_bytes` belong to no processor; both may be 0.
    /// The harts share the rest equally, for programs and stacks.
    ///
    /// # Errors
    /// [`MemoryMapError::Harts`] if there are no harts or too many; [`MemoryMapError::Number`] if a processor
    /// does not exist or is given twice; [`MemoryMapError::TooSmall`] if the memory is too small.
    pub fn new(
        memory_bytes: u32,
        numbers: &[u8],
        user_bytes: u32,
        bus_bytes: u32,
        shared_bytes: u32,
    ) -> Result<Self, MemoryMapError> {
        let harts = u32::try_from(numbers.len()).unwrap_or(u32::MAX);
        let numbers = heapless::Vec::from_slice(numbers)
            .ok()
            .filter(|numbers| !numbers.is_empty());
        let numbers = numbers.ok_or(MemoryMapError::Harts { found: harts })?;
        check_numbers(&numbers)?;
        let pages = |bytes: u64| bytes.next_multiple_of(PAGE.into());
        let processors = PROCESSORS as u64;
        let data_bytes = user_bytes.saturating_add(layout::BELL_BYTES);
        let mail = u64::from(AT) + u64::from(PAGE) * (1 + u64::from(harts));
        let mail_stride = pages(layout::mail_bytes(PROCESSORS as u32).into());
        let data = mail + processors * mail_stride;
        let data_stride = pages(data_bytes.into());
        let bus = data + processors * data_stride;
        let shared = bus + pages(bus_bytes.into());
        let clock = shared + pages(shared_bytes.into());
        let programs = clock + pages(CLOCK_BYTES.into());
        let needed = programs + u64::from(harts) * u64::from(LEAST_RANGE);
        let small = MemoryMapError::TooSmall {
            found: memory_bytes,
            needed,
        };
        if needed > memory_bytes.into() {
            return Err(small);
        }
        // From here on everything is below the memory's size.
        let word = |value: u64| u32::try_from(value).map_err(|_| small);
        let programs = word(programs)?;
        let range = (memory_bytes - programs) / harts / PAGE * PAGE;
        Ok(Self {
            memory_bytes,
            mail: ObjectRun {
                offset: word(mail)?,
                stride: word(mail_stride)?,
            },
            data: ObjectRun {
                offset: word(data)?,
                stride: word(data_stride)?,
            },
            data_bytes,
            bus: word(bus)?,
            bus_bytes,
            shared: word(shared)?,
            shared_bytes,
            clock: word(clock)?,
            programs: ObjectRun {
                offset: programs,
                stride: range,
            },
            numbers,
        })
    }

    /// Returns the number of harts of the machine.
    #[must_use]
    pub fn harts(&self) -> u32 {
        self.numbers.len() as u32
    }

    /// Returns the size in bytes of the `mail` of each processor, the part of its window that only
    /// the processor writes.
    #[must_use]
    pub const fn mail_bytes() -> u32 {
        layout::mail_bytes(PROCESSORS as u32)
    }

    /// Returns the offset of the [`Control`](super::Control) page of the hart with index `hart`, in
    /// bytes from the beginning of the memory.
    #[must_use]
    pub const fn control(hart: u32) -> u32 {
        AT.saturating_add(PAGE.saturating_mul(hart.saturating_add(1)))
    }

    /// Returns the index of the hart with the processor number `number`; `None` if no hart has it.
    #[must_use]
    pub fn hart_of(&self, number: u8) -> Option<u32> {
        (0..)
            .zip(&self.numbers)
            .find_map(|(hart, &one)| (one == number).then_some(hart))
    }

    /// Returns the number of bytes that a hart has for its program, without the stack and the guard
    /// bytes.
    #[must_use]
    pub const fn program_bytes(&self) -> u32 {
        self.programs
            .stride
            .saturating_sub(STACK_BYTES + GUARD_BYTES)
    }

    /// Returns the offset of the upper end of the stack of the hart with index `hart`, in bytes
    /// from the beginning of the memory. The stack grows downwards from there.
    #[must_use]
    pub const fn stack_end(&self, hart: u32) -> u32 {
        self.programs.at(hart).saturating_add(self.programs.stride)
    }

    /// Writes the map into `memory`, the whole memory of the machine, where harts and other
    /// processes [`read`](Self::read) it.
    ///
    /// # Errors
    /// [`AccessError`] if the memory cannot be accessed.
    pub fn write<W: MemoryWindow>(&self, memory: &Region<W>) -> Result<(), AccessError> {
        let set = |word: u32, value| memory.set_word(AT + word, value);
        set(word::MAGIC, 0)?;
        set(word::VERSION, VERSION)?;
        set(word::MEMORY, self.memory_bytes)?;
        set(word::HARTS, self.harts())?;
        for (at, run) in [
            (word::MAIL, self.mail),
            (word::DATA, self.data),
            (word::PROGRAMS, self.programs),
        ] {
            set(at, run.offset)?;
            set(at + 4, run.stride)?;
        }
        set(word::DATA_BYTES, self.data_bytes)?;
        set(word::BUS, self.bus)?;
        set(word::BUS_BYTES, self.bus_bytes)?;
        set(word::SHARED, self.shared)?;
        set(word::SHARED_BYTES, self.shared_bytes)?;
        set(word::CLOCK, self.clock)?;
        for (hart, &number) in (0..).zip(&self.numbers) {
            set(word::NUMBERS + 4 * hart, number.into())?;
        }
        set(word::MAGIC, MAGIC)
    }

    /// Reads the map from `memory`, the whole memory of the machine or its beginning, and checks
    /// that all objects lie inside the memory.
    ///
    /// # Errors
    /// [`MemoryMapError::NoMap`] or [`MemoryMapError::Version`] if there is no map of this version;
    /// [`MemoryMapError::Harts`], [`MemoryMapError::Number`] or [`MemoryMapError::Outside`] if it is invalid;
    /// [`MemoryMapError::Access`] if the memory cannot be accessed.
    pub fn read<W: MemoryWindow>(memory: &Region<W>) -> Result<Self, MemoryMapError> {
        let get = |word: u32| memory.word(AT + word);
        match get(word::MAGIC)? {
            MAGIC => {}
            found => return Err(MemoryMapError::NoMap { found }),
        }
        match get(word::VERSION)? {
            VERSION => {}
            found => return Err(MemoryMapError::Version { found }),
        }
        let run = |at| -> Result<ObjectRun, AccessError> {
            Ok(ObjectRun {
                offset: get(at)?,
                stride: get(at + 4)?,
            })
        };
        let harts = get(word::HARTS)?;
        if !(1..=HARTS).contains(&harts) {
            return Err(MemoryMapError::Harts { found: harts });
        }
        let mut numbers = heapless::Vec::new();
        for hart in 0..harts {
            let number = get(word::NUMBERS + 4 * hart)?;
            let small =
                u8::try_from(number).map_err(|_| MemoryMapError::Number { hart, number })?;
            // As many as there is room for.
            let _ = numbers.push(small);
        }
        check_numbers(&numbers)?;
        let map = Self {
            memory_bytes: get(word::MEMORY)?,
            mail: run(word::MAIL)?,
            data: run(word::DATA)?,
            data_bytes: get(word::DATA_BYTES)?,
            bus: get(word::BUS)?,
            bus_bytes: get(word::BUS_BYTES)?,
            shared: get(word::SHARED)?,
            shared_bytes: get(word::SHARED_BYTES)?,
            clock: get(word::CLOCK)?,
            programs: run(word::PROGRAMS)?,
            numbers,
        };
        map.check()?;
        Ok(map)
    }

    fn check(&self) -> Result<(), MemoryMapError> {
        let processors = PROCESSORS as u32;
        let runs = [
            ("mail", self.mail, processors, Self::mail_bytes()),
            ("data", self.data, processors, self.data_bytes),
            ("programs", self.programs, self.harts(), LEAST_RANGE),
        ];
        for (object, run, count, least) in runs {
            let bytes = run.stride.saturating_mul(count);
            self.check_inside(object, run.offset, bytes)?;
            if run.stride < least || !run.stride.is_multiple_of(PAGE) {
                return Err(self.outside(object, run.offset, run.stride));
            }
        }
        self.check_inside("the bus", self.bus, self.bus_bytes)?;
        self.check_inside("the shared memory", self.shared, self.shared_bytes)?;
        self.check_inside("the clock", self.clock, CLOCK_BYTES)
    }

    fn check_inside(
        &self,
        object: &'static str,
        offset: u32,
        bytes: u32,
    ) -> Result<(), MemoryMapError> {
        let end = offset.checked_add(bytes);
        let inside = end.is_some_and(|end| end <= self.memory_bytes);
        if inside && offset >= AT + BYTES && offset.is_multiple_of(PAGE) {
            return Ok(());
        }
        Err(self.outside(object, offset, bytes))
    }

    const fn outside(&self, object: &'static str, offset: u32, bytes: u32) -> MemoryMapError {
        MemoryMapError::Outside {
            object,
            offset,
            bytes,
            memory: self.memory_bytes,
        }
    }
}

fn check_numbers(numbers: &[u8]) -> Result<(), MemoryMapError> {
    for (hart, &number) in (0_u32..).zip(numbers) {
        let mut above = numbers.iter().take(hart as usize);
        if usize::from(number) >= PROCESSORS || above.any(|&other| other == number) {
            let number = number.into();
            return Err(MemoryMapError::Number { hart, number });
        }
    }
    Ok(())
}
