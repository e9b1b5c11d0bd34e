//! The checks of [`MemoryWindow`] and [`CompareExchange`].

use core::sync::atomic::AtomicU32;

use crate::window::{CompareExchange, LoadOrder, MemoryWindow, StoreOrder, WindowError};

use super::limits::{
    MISALIGNED, OUT_OF_BOUNDS, READ_ONLY, alignment, alignment_of_loads, bounds, bounds_of_loads,
    empty, outside, refused_copies, size,
};
use super::outcome::{WindowFailure, done, expect, load, read, store, write, write_words};

/// Checks that `window`, which can be read and written, keeps the rules of [`MemoryWindow`]. No
/// other context may touch it during the check.
///
/// The contents of the window are overwritten. It must have at least
/// [`LEAST_BYTES`](super::LEAST_BYTES) bytes.
///
/// # Errors
/// [`WindowFailure`] for the first check that fails.
///
/// ```
/// # use condor_mbox::{StaticMemory, conformance};
/// static MEMORY: StaticMemory<64> = StaticMemory::new();
/// conformance::window(&MEMORY.window()).unwrap();
/// ```
pub fn window<W: MemoryWindow>(window: &W) -> Result<(), WindowFailure> {
    size(window)?;
    bounds(window)?;
    alignment(window)?;
    empty(window)?;
    words(window)?;
    orders(window)?;
    all_words(window)?;
    bytes(window)?;
    slices(window)?;
    refused_copies(window)
}

/// Checks that `window`, which is mapped for reading only, keeps the rules of [`MemoryWindow`]: it
/// must refuse every store.
///
/// # Errors
/// [`WindowFailure`] for the first check that fails.
pub fn read_only<W: MemoryWindow>(window: &W) -> Result<(), WindowFailure> {
    size(window)?;
    alignment_of_loads(window)?;
    bounds_of_loads(window)?;
    let last = window.size().wrapping_sub(4);
    for offset in [0, last] {
        let before = load(window, offset);
        expect(
            "a word that may only be read is read",
            offset,
            4,
            before.map(|_| 0),
            Ok(0),
        )?;
        let found = store(window, offset, before.map_or(0, |word| !word));
        expect("a store is refused", offset, 4, found, READ_ONLY)?;
        let found = write(window, offset, &[0xA5; 4]);
        expect("a write is refused", offset, 4, found, READ_ONLY)?;
        let found = load(window, offset);
        expect("a refused store changes nothing", offset, 4, found, before)?;
        let found = read(window, offset, &mut [0; 4]);
        expect(
            "bytes that may only be read are read",
            offset,
            4,
            found,
            Ok(0),
        )?;
    }
    let found = write(window, 0, &[]);
    expect(
        "an empty write to a read-only window succeeds",
        0,
        0,
        found,
        Ok(0),
    )
}

/// Checks that `a` and `b`, two windows of the same size, access the same memory. Some words of it
/// are overwritten.
///
/// # Errors
/// [`WindowFailure`] for the first check that fails.
pub fn shared<A: MemoryWindow, B: MemoryWindow>(a: &A, b: &B) -> Result<(), WindowFailure> {
    expect(
        "both windows have the same size",
        0,
        0,
        Ok(b.size()),
        Ok(a.size()),
    )?;
    for offset in some_offsets(a.size()) {
        let word = pattern(offset);
        done("a store succeeds", offset, 4, store(a, offset, word))?;
        let found = load(b, offset);
        expect(
            "the second window loads the word that the first stored",
            offset,
            4,
            found,
            Ok(word),
        )?;
        done("a store succeeds", offset, 4, store(b, offset, !word))?;
        let found = load(a, offset);
        expect(
            "the first window loads the word that the second stored",
            offset,
            4,
            found,
            Ok(!word),
        )?;
        done(
            "a write succeeds",
            offset,
            4,
            write(a, offset, &word.to_le_bytes()),
        )?;
        let mut bytes = [0; 4];
        done("a read succeeds", offset, 4, read(b, offset, &mut bytes))?;
        let found = Ok(u32::from_le_bytes(bytes));
        expect(
            "the second window reads the bytes that the first wrote",
            offset,
            4,
            found,
            Ok(word),
        )?;
    }
    Ok(())
}

/// Checks that the compare-and-swap of `window` keeps the rules of [`CompareExchange`]. No other
/// context may touch the window during the check. Some words of it are overwritten.
///
/// One processor cannot check that the operation is indivisible for every other processor.
///
/// # Errors
/// [`WindowFailure`] for the first check that fails.
pub fn compare_exchange<W: CompareExchange>(window: &W) -> Result<(), WindowFailure> {
    let swap = |offset, current, new| {
        window
            .compare_exchange(offset, current, new)
            .map_err(|error| error.kind())
    };
    for offset in some_offsets(window.size()) {
        let word = pattern(offset);
        done("a store succeeds", offset, 4, store(window, offset, word))?;
        let found = swap(offset, !word, 0);
        expect(
            "a swap returns the previous word",
            offset,
            4,
            found,
            Ok(word),
        )?;
        let found = load(window, offset);
        expect(
            "a swap that expects another word changes nothing",
            offset,
            4,
            found,
            Ok(word),
        )?;
        let found = swap(offset, word, !word);
        expect(
            "a swap that expects the present word returns it",
            offset,
            4,
            found,
            Ok(word),
        )?;
        let found = load(window, offset);
        expect(
            "a swap that expects the present word writes the new one",
            offset,
            4,
            found,
            Ok(!word),
        )?;
    }
    for offset in outside(window.size()) {
        let found = swap(offset, 0, 0);
        expect("a swap outside is refused", offset, 4, found, OUT_OF_BOUNDS)?;
    }
    for offset in [1, 2, 3] {
        let found = swap(offset, 0, 0);
        expect("a misaligned swap is refused", offset, 4, found, MISALIGNED)?;
    }
    Ok(())
}

fn words<W: MemoryWindow>(window: &W) -> Result<(), WindowFailure> {
    let patterns = [
        0,
        u32::MAX,
        0x8000_0000,
        1,
        0x5555_5555,
        0xAAAA_AAAA,
        0x0123_4567,
    ];
    for word in patterns.into_iter().chain((0..32).map(|bit| 1 << bit)) {
        done("a store succeeds", 4, 4, store(window, 4, word))?;
        expect(
            "a word holds every bit pattern",
            4,
            4,
            load(window, 4),
            Ok(word),
        )?;
    }
    let all = || (0..window.size()).step_by(4);
    for offset in all() {
        done(
            "a store succeeds",
            offset,
            4,
            store(window, offset, pattern(offset)),
        )?;
    }
    for offset in all() {
        let found = load(window, offset);
        expect(
            "every word is stored separately",
            offset,
            4,
            found,
            Ok(pattern(offset)),
        )?;
    }
    Ok(())
}

fn orders<W: MemoryWindow>(window: &W) -> Result<(), WindowFailure> {
    for (word, stored) in [(1, StoreOrder::Relaxed), (2, StoreOrder::Release)] {
        for loaded in [LoadOrder::Relaxed, LoadOrder::Acquire] {
            let found = window
                .store(0, word, stored)
                .and_then(|()| window.load(0, loaded))
                .map_err(|error| error.kind());
            expect("every memory ordering is accepted", 0, 4, found, Ok(word))?;
        }
    }
    Ok(())
}

fn all_words<W: MemoryWindow>(window: &W) -> Result<(), WindowFailure> {
    for offset in [0, window.size().wrapping_sub(4)] {
        done(
            "a store succeeds",
            offset,
            4,
            store(window, offset, pattern(offset)),
        )?;
        window.clean(offset, 4);
        window.invalidate(offset, 4);
        let found = load(window, offset);
        expect(
            "a load returns the word that was cleaned",
            offset,
            4,
            found,
            Ok(pattern(offset)),
        )?;
        if let Some(words) = window.words() {
            let coherent = Ok(u32::from(window.is_coherent()));
            expect(
                "only coherent memory has `words`",
                offset,
                4,
                coherent,
                Ok(1),
            )?;
            let word = words.get().get((offset / 4) as usize);
            let found = Ok(word.map_or(0, |word| word.load(LoadOrder::Acquire.into())));
            expect(
                "`words` has the words that loads return",
                offset,
                4,
                found,
                Ok(pattern(offset)),
            )?;
        }
    }
    if let Some(words) = window.words() {
        let bytes = Ok(u32::try_from(4 * words.get().len()).unwrap_or(u32::MAX));
        expect(
            "`words` has as many words as the size says",
            0,
            0,
            bytes,
            Ok(window.size()),
        )?;
    }
    // Outside there is nothing to clean.
    for offset in [window.size(), !3, 2, u32::MAX] {
        window.clean(offset, 4);
        window.invalidate(offset, 4);
    }
    Ok(())
}

fn bytes<W: MemoryWindow>(window: &W) -> Result<(), WindowFailure> {
    const LEFT: u32 = 0x0302_0100;
    done("a store succeeds", 0, 4, store(window, 0, LEFT))?;
    let mut found = [0; 4];
    done("a read succeeds", 0, 4, read(window, 0, &mut found))?;
    let found = Ok(u32::from_le_bytes(found));
    expect(
        "a word is read as little-endian bytes",
        0,
        4,
        found,
        Ok(LEFT),
    )?;

    for len in 0..=16_u8 {
        let span = usize::from(len);
        for offset in (0..32).step_by(4) {
            done(
                "a store succeeds",
                offset,
                4,
                store(window, offset, u32::MAX),
            )?;
        }
        let from: [u8; 16] = core::array::from_fn(|at| (at as u8) ^ len);
        done("a write succeeds", 4, span, write(window, 4, &from[..span]))?;
        let mut into = [0xEE; 20];
        done(
            "a read succeeds",
            4,
            span,
            read(window, 4, &mut into[..span]),
        )?;
        for at in 0..20_usize {
            let expected = if at < span { from[at] } else { 0xEE };
            let found = Ok(u32::from(into[at]));
            expect(
                "a read returns the bytes that were written",
                4,
                span,
                found,
                Ok(u32::from(expected)),
            )?;
        }
        for offset in (0..32_u32).step_by(4) {
            let expected = core::array::from_fn(|at| {
                (offset as usize + at)
                    .checked_sub(4)
                    .filter(|at| *at < span)
                    .map_or(0xFF, |at| from[at])
            });
            let expected = Ok(u32::from_le_bytes(expected));
            let found = load(window, offset);
            expect(
                "a write changes only its own bytes",
                offset,
                span,
                found,
                expected,
            )?;
        }
    }
    Ok(())
}

fn slices<W: MemoryWindow>(window: &W) -> Result<(), WindowFailure> {
    let words: [AtomicU32; 6] = core::array::from_fn(|at| AtomicU32::new(at as u32));
    let (first, rest) = words.split_at(1);
    let (second, third) = rest.split_at(2);
    for len in (0..=28).step_by(4) {
        for offset in (0..36).step_by(4) {
            let stored = store(window, offset, u32::MAX);
            done("a store succeeds", offset, 4, stored)?;
        }
        let from = [first, second, &[], third];
        let written = write_words(window, 4, len, &from);
        done("a write of words succeeds", 4, len, written)?;
        for offset in (0..36_u32).step_by(4) {
            let at = (offset / 4).wrapping_sub(1);
            let is_written = at < words.len() as u32 && 4 * at < len as u32;
            let expected = Ok(if is_written { at } else { u32::MAX });
            let found = load(window, offset);
            let check = "a write of words copies one slice after the other";
            expect(check, offset, len, found, expected)?;
        }
    }
    Ok(())
}

/// Both ends and the middle.
fn some_offsets(size: u32) -> [u32; 4] {
    [0, 4, (size / 2) & !3, size.wrapping_sub(4)]
}

/// A word that differs between offsets.
fn pattern(offset: u32) -> u32 {
    offset.wrapping_mul(0x9E37_79B1) ^ 0x00C0_FFEE
}
