//! The checks of what a window must refuse.

use crate::window::{MemoryWindow, WindowErrorKind};

use super::outcome::{AccessOutcome, WindowFailure, check, done, expect, load, read, store, write};

/// The least size of a window that the checks accept, in bytes.
pub const LEAST_BYTES: u32 = 64;

/// The last aligned offset.
const TOP: u32 = !3;
pub(super) const OUT_OF_BOUNDS: AccessOutcome = Err(WindowErrorKind::OutOfBounds);
pub(super) const MISALIGNED: AccessOutcome = Err(WindowErrorKind::Misaligned);
pub(super) const READ_ONLY: AccessOutcome = Err(WindowErrorKind::ReadOnly);

pub(super) fn size<W: MemoryWindow>(window: &W) -> Result<(), WindowFailure> {
    let size = window.size();
    expect("the size is a multiple of four", 0, 0, Ok(size % 4), Ok(0))?;
    expect(
        "the window is large enough for the checks",
        0,
        0,
        Ok(size.min(LEAST_BYTES)),
        Ok(LEAST_BYTES),
    )?;
    expect("the size never changes", 0, 0, Ok(window.size()), Ok(size))
}

pub(super) fn bounds<W: MemoryWindow>(window: &W) -> Result<(), WindowFailure> {
    bounds_of_loads(window)?;
    let last = window.size().wrapping_sub(4);
    done("the last word is stored", last, 4, store(window, last, 0))?;
    for offset in outside(window.size()) {
        let found = store(window, offset, 0);
        expect(
            "a store outside is refused",
            offset,
            4,
            found,
            OUT_OF_BOUNDS,
        )?;
        let found = write(window, offset, &[0]);
        expect(
            "a write outside is refused",
            offset,
            1,
            found,
            OUT_OF_BOUNDS,
        )?;
    }
    done(
        "a write up to the end succeeds",
        last,
        4,
        write(window, last, &[0; 4]),
    )?;
    let found = write(window, last, &[0; 5]);
    expect(
        "a write across the end is refused",
        last,
        5,
        found,
        OUT_OF_BOUNDS,
    )
}

pub(super) fn bounds_of_loads<W: MemoryWindow>(window: &W) -> Result<(), WindowFailure> {
    let last = window.size().wrapping_sub(4);
    let found = load(window, last).map(|_| 0);
    expect("the last word is loaded", last, 4, found, Ok(0))?;
    for offset in outside(window.size()) {
        let found = load(window, offset);
        expect("a load outside is refused", offset, 4, found, OUT_OF_BOUNDS)?;
        let found = read(window, offset, &mut [0]);
        expect("a read outside is refused", offset, 1, found, OUT_OF_BOUNDS)?;
        let found = check(window, offset, 4);
        expect("a check outside fails", offset, 4, found, OUT_OF_BOUNDS)?;
    }
    let found = check(window, 0, window.size() as usize);
    expect(
        "a check of the whole window passes",
        0,
        window.size() as usize,
        found,
        Ok(0),
    )?;
    let found = check(window, 4, usize::MAX);
    expect(
        "a check of a range that overflows fails",
        4,
        usize::MAX,
        found,
        OUT_OF_BOUNDS,
    )?;
    done(
        "a read up to the end succeeds",
        last,
        4,
        read(window, last, &mut [0; 4]),
    )?;
    let found = read(window, last, &mut [0; 5]);
    expect(
        "a read across the end is refused",
        last,
        5,
        found,
        OUT_OF_BOUNDS,
    )
}

pub(super) fn alignment<W: MemoryWindow>(window: &W) -> Result<(), WindowFailure> {
    alignment_of_loads(window)?;
    for offset in [1, 2, 3, 5, 6, 7] {
        let found = store(window, offset, 0);
        expect(
            "a misaligned store is refused",
            offset,
            4,
            found,
            MISALIGNED,
        )?;
        for len in [0, 1, 4] {
            let found = write(window, offset, &[0; 4][..len]);
            expect(
                "a misaligned write is refused",
                offset,
                len,
                found,
                MISALIGNED,
            )?;
        }
    }
    Ok(())
}

pub(super) fn alignment_of_loads<W: MemoryWindow>(window: &W) -> Result<(), WindowFailure> {
    for offset in [1, 2, 3, 5, 6, 7] {
        let found = load(window, offset);
        expect("a misaligned load is refused", offset, 4, found, MISALIGNED)?;
        let found = check(window, offset, 4);
        expect("a misaligned check fails", offset, 4, found, MISALIGNED)?;
        for len in [0, 1, 4] {
            let found = read(window, offset, &mut [0; 4][..len]);
            expect(
                "a misaligned read is refused",
                offset,
                len,
                found,
                MISALIGNED,
            )?;
        }
    }
    Ok(())
}

pub(super) fn empty<W: MemoryWindow>(window: &W) -> Result<(), WindowFailure> {
    let size = window.size();
    for offset in [0, 4, size] {
        let found = read(window, offset, &mut []);
        expect(
            "an empty read up to the end succeeds",
            offset,
            0,
            found,
            Ok(0),
        )?;
        let found = write(window, offset, &[]);
        expect(
            "an empty write up to the end succeeds",
            offset,
            0,
            found,
            Ok(0),
        )?;
        let found = check(window, offset, 0);
        expect(
            "an empty check up to the end passes",
            offset,
            0,
            found,
            Ok(0),
        )?;
    }
    // A window that ends where offsets do has nothing beyond.
    for offset in [size.saturating_add(4) & !3, TOP] {
        if offset > size {
            let found = read(window, offset, &mut []);
            expect(
                "an empty read beyond the end is refused",
                offset,
                0,
                found,
                OUT_OF_BOUNDS,
            )?;
            let found = write(window, offset, &[]);
            expect(
                "an empty write beyond the end is refused",
                offset,
                0,
                found,
                OUT_OF_BOUNDS,
            )?;
        }
    }
    Ok(())
}

pub(super) fn refused_copies<W: MemoryWindow>(window: &W) -> Result<(), WindowFailure> {
    let last = window.size().wrapping_sub(4);
    done(
        "a store succeeds",
        last,
        4,
        store(window, last, 0x1234_5678),
    )?;
    let found = write(window, last, &[0; 8]);
    expect(
        "a write across the end is refused",
        last,
        8,
        found,
        OUT_OF_BOUNDS,
    )?;
    let found = load(window, last);
    expect(
        "a refused write copies nothing",
        last,
        8,
        found,
        Ok(0x1234_5678),
    )?;
    let mut into = [0xEE; 8];
    let found = read(window, last, &mut into);
    expect(
        "a read across the end is refused",
        last,
        8,
        found,
        OUT_OF_BOUNDS,
    )?;
    for byte in into {
        let found = Ok(u32::from(byte));
        expect("a refused read copies nothing", last, 8, found, Ok(0xEE))?;
    }
    Ok(())
}

/// Aligned offsets at which no word is inside.
pub(super) fn outside(size: u32) -> impl Iterator<Item = u32> {
    [size, size.saturating_add(4) & !3, 0x8000_0000, TOP - 4, TOP]
        .into_iter()
        .filter(move |offset| *offset >= size)
}
