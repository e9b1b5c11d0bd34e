//! Long copies between words that peers may access and memory of the caller's own.
//!
//! To peers every copy is one relaxed access of each word. The compiler keeps relaxed accesses one
//! by one, four bytes at a time, which is a fraction of what the processor can copy.
//!
//! On `x86_64` blocks are therefore copied by aligned moves of 16 bytes. On processors with AVX these
//! are indivisible (Intel, *Software Developer's Manual*, volume 3A, "Guaranteed Atomic Operations";
//! AMD, *Programmer's Manual*, volume 2, "Access Atomicity"). So each does to memory what relaxed
//! accesses of its four words can do, and accesses of Rust's atomics keep one size. Two words that are alone
//! are one move of 8 bytes.

use core::sync::atomic::{AtomicU32, Ordering};

/// Copies words out; `into` has four bytes for each of them.
pub(super) fn read(words: &[AtomicU32], into: &mut [u8]) {
    let (head, words) = words.split_at(unaligned(words));
    let (bytes, into) = into.split_at_mut(4 * head.len());
    read_words(head, bytes);
    let done = blocks::read(words, into);
    read_words(&words[done..], &mut into[4 * done..]);
}

/// Copies words in; `from` has four bytes for each of them.
pub(super) fn write(words: &[AtomicU32], from: &[u8]) {
    let (head, words) = words.split_at(unaligned(words));
    let (bytes, from) = from.split_at(4 * head.len());
    write_words(head, bytes);
    let done = blocks::write(words, from);
    write_words(&words[done..], &from[4 * done..]);
}

/// Copies words in that other contexts of this program may write meanwhile, slice after slice; as many as
/// both have.
pub(super) fn gather(mut words: &[AtomicU32], mut from: &[&[AtomicU32]]) {
    while let [first, rest @ ..] = from {
        let len = first.len().min(words.len());
        let count = match len {
            1 => short::<1>(words, from, |to, from| copy_words(to, from)),
            2 if words.as_ptr().addr().is_multiple_of(8) => short(words, from, blocks::pair),
            2 => short::<2>(words, from, |to, from| copy_words(to, from)),
            _ => 0,
        };
        if count == 0 {
            copy(&words[..len], first);
            (words, from) = (&words[len..], rest);
        } else {
            (words, from) = (&words[count * len..], &from[count..]);
        }
    }
}

/// Copies the slices in front that have `N` words, each by `copy`; returns how many those are.
#[inline(always)]
fn short<const N: usize>(
    words: &[AtomicU32],
    from: &[&[AtomicU32]],
    copy: impl Fn(&[AtomicU32; N], &[AtomicU32; N]),
) -> usize {
    let pairs = words.as_chunks::<N>().0.iter().zip(from);
    let pairs = pairs.map_while(|(to, from)| Some((to, (*from).try_into().ok()?)));
    pairs.map(|(to, from)| copy(to, from)).count()
}

fn copy(words: &[AtomicU32], from: &[AtomicU32]) {
    let (head, words) = words.split_at(unaligned(words));
    let (first, from) = from.split_at(head.len());
    copy_words(head, first);
    let done = blocks::write(words, from);
    copy_words(&words[done..], &from[done..]);
}

/// Returns the number of words before the first that is aligned to 16 bytes.
fn unaligned(words: &[AtomicU32]) -> usize {
    words.as_ptr().align_offset(16).min(words.len())
}

fn read_words(words: &[AtomicU32], into: &mut [u8]) {
    for (word, bytes) in words.iter().zip(into.as_chunks_mut::<4>().0) {
        *bytes = word.load(Ordering::Relaxed).to_ne_bytes();
    }
}

fn write_words(words: &[AtomicU32], from: &[u8]) {
    for (word, bytes) in words.iter().zip(from.as_chunks::<4>().0) {
        word.store(u32::from_ne_bytes(*bytes), Ordering::Relaxed);
    }
}

fn copy_words(words: &[AtomicU32], from: &[AtomicU32]) {
    for (word, from) in words.iter().zip(from) {
        word.store(from.load(Ordering::Relaxed), Ordering::Relaxed);
    }
}

#[cfg(all(target_arch = "x86_64", not(miri)))]
mod blocks {
    use core::arch::asm;
    use core::sync::atomic::AtomicU32;

    /// Words of a move.
    const WORDS: usize = 4;

    /// Returns the number of moves that can be made, each of `bytes` for its words.
    fn count(words: &[AtomicU32], bytes: usize) -> usize {
        let count = words.len().min(bytes / 4) / WORDS;
        let aligned = words.as_ptr().addr().is_multiple_of(16);
        if count > 0 && aligned && std::arch::is_x86_feature_detected!("avx") {
            count
        } else {
            0
        }
    }

    /// Moves so many times 16 bytes: four at a time, then one by one.
    macro_rules! moves {
        ($load:literal, $store:literal, $count:ident, $from:expr, $to:expr) => {
            asm!(
                "sub {count}, 4",
                "jb 3f",
                "2:",
                concat!($load, " {a}, [{from}]"),
                concat!($load, " {b}, [{from} + 16]"),
                concat!($load, " {c}, [{from} + 32]"),
                concat!($load, " {d}, [{from} + 48]"),
                concat!($store, " [{to}], {a}"),
                concat!($store, " [{to} + 16], {b}"),
                concat!($store, " [{to} + 32], {c}"),
                concat!($store, " [{to} + 48], {d}"),
                "add {from}, 64",
                "add {to}, 64",
                "sub {count}, 4",
                "jae 2b",
                "3:",
                "add {count}, 4",
                "jz 5f",
                "4:",
                concat!($load, " {a}, [{from}]"),
                concat!($store, " [{to}], {a}"),
                "add {from}, 16",
                "add {to}, 16",
                "dec {count}",
                "jnz 4b",
                "5:",
                from = inout(reg) $from => _,
                to = inout(reg) $to => _,
                count = inout(reg) $count => _,
                a = out(xmm_reg) _,
                b = out(xmm_reg) _,
                c = out(xmm_reg) _,
                d = out(xmm_reg) _,
                options(nostack)
            )
        };
    }

    /// Copies words out, but for up to three; returns how many.
    pub(super) fn read(words: &[AtomicU32], into: &mut [u8]) -> usize {
        let count = count(words, into.len());
        if count == 0 {
            return 0;
        }
        // SAFETY: reads so many times 16 bytes of `words`, which may be read atomically, by indivisible
        // aligned moves, and writes as many of `into`: `count` found that both have them. Memory that
        // vanishes is the handler's of `fault`, after which a move is tried again.
        unsafe { moves!("movdqa", "movdqu", count, words.as_ptr(), into.as_mut_ptr()) };
        count * WORDS
    }

    /// Copies bytes or atomics in, but for up to three words; returns how many words.
    pub(super) fn write<T>(words: &[AtomicU32], from: &[T]) -> usize {
        let count = count(words, size_of_val(from));
        if count == 0 {
            return 0;
        }
        // SAFETY: as in `read`, the other way; the words are atomics, which may be written through a
        // shared reference. Where `from` are atomics that change meanwhile, each word is old or new: no
        // move divides one.
        unsafe { moves!("movdqu", "movdqa", count, from.as_ptr(), words.as_ptr()) };
        count * WORDS
    }

    /// Copies two words by one move; `to` is aligned to 8 bytes.
    #[inline(always)]
    pub(super) fn pair(to: &[AtomicU32; 2], from: &[AtomicU32; 2]) {
        // SAFETY: reads and writes eight bytes that both have, and atomics may be written through a shared
        // reference. The store is aligned, so indivisible; the load is, or is divided between the words.
        unsafe {
            asm!(
                "mov {both}, [{from}]",
                "mov [{to}], {both}",
                from = in(reg) from.as_ptr(),
                to = in(reg) to.as_ptr(),
                both = out(reg) _,
                options(nostack, preserves_flags)
            );
        }
    }
}

#[cfg(not(all(target_arch = "x86_64", not(miri))))]
mod blocks {
    use core::sync::atomic::AtomicU32;

    pub(super) const fn read(_: &[AtomicU32], _: &mut [u8]) -> usize {
        0
    }

    pub(super) const fn write<T>(_: &[AtomicU32], _: &[T]) -> usize {
        0
    }

    pub(super) fn pair(to: &[AtomicU32; 2], from: &[AtomicU32; 2]) {
        super::copy_words(to, from);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Words around what is copied.
    const MARGIN: usize = 5;

    /// Copies of every length come whole, at every alignment of either side, and touch nothing else.
    #[test]
    fn every_word_is_copied_and_no_other() {
        for count in (0..70).chain([128, 1000]) {
            for (skip, unaligned, width) in
                [(0, 0, 1), (0, 1, 2), (1, 3, 2), (2, 8, 40), (3, 1, 1000)]
            {
                let words: Vec<AtomicU32> = (0..count + 2 * MARGIN)
                    .map(|_| AtomicU32::new(u32::MAX))
                    .collect();
                let from: Vec<u8> = (0..4 * count + unaligned).map(|at| at as u8).collect();
                let (from, start) = (&from[unaligned..], MARGIN - skip);
                write(&words[start..start + count], from);
                let found: Vec<u8> = words
                    .iter()
                    .flat_map(|word| word.load(Ordering::Relaxed).to_ne_bytes())
                    .collect();
                let (before, rest) = found.split_at(4 * start);
                let (inside, after) = rest.split_at(4 * count);
                assert_eq!(inside, from, "{count} words, {skip}");
                assert!(before.iter().chain(after).all(|byte| *byte == 0xff));

                let atomics: Vec<AtomicU32> = (0..count as u32).map(AtomicU32::new).collect();
                let slices: Vec<_> = atomics.chunks(width).collect();
                gather(&words[start..start + count], &slices);
                let found = words.iter().map(|word| word.load(Ordering::Relaxed));
                let margin = |len| std::iter::repeat_n(u32::MAX, len);
                let after = 2 * MARGIN - start;
                assert!(found.eq(margin(start).chain(0..count as u32).chain(margin(after))));
                write(&words[start..start + count], from);

                let mut into = vec![0; 4 * count + unaligned];
                read(&words[start..start + count], &mut into[unaligned..]);
                assert_eq!(&into[unaligned..], from, "{count} words, {skip}");
            }
        }
    }
}
