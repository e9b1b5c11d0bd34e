//! A region is a window of its own that reaches nothing else.

use condor_mbox::layout::{BELL_BYTES, LINE};
use condor_mbox::window::WindowErrorKind;
use condor_mbox::{AccessError, Allocator, MemoryWindow, Offset, Region};
use proptest::prelude::*;
use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::memory::{Memory, Mortal};

#[derive(Clone, Copy, Debug, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
struct Sample {
    time_ns: u64,
    angles_rad: [f32; 3],
    flags: [u8; 4],
}

const SAMPLE: Sample = Sample {
    time_ns: 0x0123_4567_89AB_CDEF,
    angles_rad: [1.5, -2.25, f32::MAX],
    flags: [1, 2, 3, 4],
};

#[test]
fn the_line_of_the_doorbell_is_not_the_users() {
    let memory = Memory::new(64);
    let ram = Region::users(&memory).unwrap();
    assert_eq!(ram.size(), 256 - BELL_BYTES);
    ram.set_word(0, 977).unwrap();
    assert_eq!(Region::whole(&memory).word(BELL_BYTES), Ok(977));

    let small = Memory::new(BELL_BYTES as usize / 4 - 1);
    assert_eq!(
        Region::users(&small).unwrap_err(),
        AccessError {
            offset: 0,
            len: BELL_BYTES as usize,
            size: BELL_BYTES - 4,
            kind: WindowErrorKind::OutOfBounds,
        }
    );
    let line = Memory::new(BELL_BYTES as usize / 4);
    assert_eq!(Region::users(&line).unwrap().size(), 0);
}

#[test]
fn an_offset_from_a_message_reaches_the_same_value() {
    let memory = Memory::new(64);
    let ram = Region::users(&memory).unwrap();
    let mut allocator = Allocator::new(ram.size());
    allocator.bytes(1).unwrap();
    let place = allocator.place::<Sample>().unwrap();
    ram.set(place, &SAMPLE).unwrap();
    let message = place.offset();
    assert_eq!(ram.get(Offset::<Sample>::at(message)), Ok(SAMPLE));
}

#[test]
fn no_offset_from_a_message_is_trusted() {
    let memory = Memory::new(64);
    let ram = Region::users(&memory).unwrap().part(64, 32).unwrap();
    let last = 32 - u32::try_from(size_of::<Sample>()).unwrap();
    assert!(ram.get(Offset::<Sample>::at(last)).is_ok());
    for (offset, kind) in [
        (last + 4, WindowErrorKind::OutOfBounds),
        (32, WindowErrorKind::OutOfBounds),
        (0x8000_0000, WindowErrorKind::OutOfBounds),
        (u32::MAX - 63, WindowErrorKind::OutOfBounds),
        (u32::MAX - 3, WindowErrorKind::OutOfBounds),
        (1, WindowErrorKind::Misaligned),
        (u32::MAX, WindowErrorKind::Misaligned),
    ] {
        let expected = AccessError {
            offset,
            len: size_of::<Sample>(),
            size: 32,
            kind,
        };
        assert_eq!(ram.get(Offset::<Sample>::at(offset)), Err(expected));
        assert_eq!(ram.set(Offset::at(offset), &SAMPLE), Err(expected));
    }
}

#[test]
fn a_part_has_no_more_than_it_was_given() {
    let memory = Memory::new(64);
    let ram = Region::whole(&memory);
    let part = ram.part(16, 8).unwrap().part(4, 4).unwrap();
    part.set_word(0, 7).unwrap();
    assert_eq!(ram.word(20), Ok(7));
    assert!(part.word(4).is_err());
    assert!(part.part(0, 8).is_err());
    assert_eq!(
        ram.part(0, 6).unwrap_err().kind,
        WindowErrorKind::Misaligned
    );
    assert_eq!(
        ram.part(2, 4).unwrap_err().kind,
        WindowErrorKind::Misaligned
    );
    assert_eq!(ram.part(256, 0).unwrap().size(), 0);
    assert_eq!(
        ram.part(4, u32::MAX - 3).unwrap_err().kind,
        WindowErrorKind::OutOfBounds
    );
}

#[test]
fn places_are_the_same_at_compile_time() {
    const fn first(mut allocator: Allocator) -> Offset<Sample> {
        match allocator.place() {
            Ok(place) => place,
            Err(_) => panic!("no room"),
        }
    }
    const FIRST: Offset<Sample> = first(Allocator::new(128));
    let memory = Memory::new(32);
    assert_eq!(Allocator::new(memory.size()).place().ok(), Some(FIRST));
}

#[test]
fn places_begin_at_lines_and_end_with_the_region() {
    let mut allocator = Allocator::new(3 * LINE - 4);
    assert_eq!(allocator.bytes(1), Ok(0));
    assert_eq!(allocator.bytes(LINE as usize), Ok(LINE));
    assert!(allocator.bytes(LINE as usize).is_err());
    assert_eq!(allocator.bytes(LINE as usize - 4), Ok(2 * LINE));
    assert!(allocator.bytes(1).is_err());
    assert!(Allocator::new(64).bytes(usize::MAX).is_err());
    assert_eq!(Allocator::new(u32::MAX - 3).bytes(0xFFFF_FFF0), Ok(0));
}

#[test]
fn a_lost_window_is_told_with_the_access() {
    let memory = Memory::new(64);
    let ram = Region::users(Mortal::new(&memory, 2)).unwrap();
    assert_eq!(
        ram.get(Offset::<Sample>::at(8)),
        Err(AccessError {
            offset: 8,
            len: size_of::<Sample>(),
            size: 192,
            kind: WindowErrorKind::Lost,
        })
    );
}

#[cfg(feature = "conformance")]
#[test]
fn a_region_is_a_conforming_window() {
    use condor_mbox::conformance;

    let memory = Memory::new(64);
    conformance::window(&memory).unwrap();
    conformance::compare_exchange(&memory).unwrap();
    let ram = Region::users(&memory).unwrap();
    conformance::window(&ram).unwrap();
    conformance::compare_exchange(&ram).unwrap();
    conformance::shared(&ram, &ram.part(0, ram.size()).unwrap()).unwrap();
}

#[derive(Clone, Debug)]
enum Access {
    Read(u32, usize),
    Write(u32, Vec<u8>),
    Load(u32),
    Store(u32, u32),
}

/// Offsets around a region of 100 bytes, and some near the end of all offsets.
fn offsets() -> impl Strategy<Value = u32> {
    prop_oneof![
        8 => (0_u32..28).prop_map(|word| word * 4),
        1 => 0_u32..112,
        1 => (u32::MAX - 200)..=u32::MAX,
    ]
}

fn accesses() -> impl Strategy<Value = Access> {
    prop_oneof![
        (offsets(), 0_usize..40).prop_map(|(at, len)| Access::Read(at, len)),
        (offsets(), prop::collection::vec(any::<u8>(), 0..40))
            .prop_map(|(at, bytes)| Access::Write(at, bytes)),
        offsets().prop_map(Access::Load),
        (offsets(), any::<u32>()).prop_map(|(at, word)| Access::Store(at, word)),
    ]
}

/// The bytes that an access may touch, if it may.
fn span(at: u32, len: usize) -> Option<core::ops::Range<usize>> {
    let at = at as usize;
    (at.is_multiple_of(4) && at + len <= 100).then_some(at..at + len)
}

proptest! {
    #[test]
    fn a_region_behaves_like_an_array_of_bytes(
        program in prop::collection::vec(accesses(), 1..60),
    ) {
        let memory = Memory::filled(64, |_| 0xA5A5_A5A5);
        let ram = Region::users(&memory).unwrap().part(32, 100).unwrap();
        let mut model = [0xA5_u8; 100];
        for access in program {
            match access {
                Access::Read(at, len) => {
                    let mut into = vec![0x11; len];
                    let done = ram.read(at, &mut into);
                    if let Some(span) = span(at, len) {
                        prop_assert!(done.is_ok());
                        prop_assert_eq!(&into, &model[span]);
                    } else {
                        prop_assert!(done.is_err());
                        prop_assert!(into.iter().all(|byte| *byte == 0x11));
                    }
                }
                Access::Write(at, bytes) => {
                    let done = ram.write(at, &bytes);
                    let span = span(at, bytes.len());
                    prop_assert_eq!(done.is_ok(), span.is_some());
                    if let Some(span) = span {
                        model[span].copy_from_slice(&bytes);
                    }
                }
                Access::Load(at) => {
                    let expected = span(at, 4)
                        .map(|span| u32::from_le_bytes(model[span].try_into().unwrap()));
                    prop_assert_eq!(ram.word(at).ok(), expected);
                }
                Access::Store(at, word) => {
                    let span = span(at, 4);
                    prop_assert_eq!(ram.set_word(at, word).is_ok(), span.is_some());
                    if let Some(span) = span {
                        model[span].copy_from_slice(&word.to_le_bytes());
                    }
                }
            }
        }
        let mut around = vec![0; 256];
        memory.read(0, &mut around).unwrap();
        prop_assert_eq!(&around[96..196], &model[..]);
        prop_assert!(around[..96].iter().chain(&around[196..]).all(|byte| *byte == 0xA5));
    }
}
