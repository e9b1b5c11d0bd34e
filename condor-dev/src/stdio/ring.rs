//! [`Ring`]: what has been printed and not yet written.

use core::cell::RefCell;

use critical_section::Mutex;
use heapless::Deque;

/// Bytes that one critical section moves at most, so that interrupts wait for some ten
/// instructions each.
const PIECE: usize = 16;

/// Up to `N` bytes in order, for all contexts at once, and how many found no room.
///
/// Not the [`Ring`](crate::Ring) of drivers: whoever interrupts the holder of its end to write finds
/// it taken, and a print would be lost there; and drivers cannot mask interrupts for each 16 bytes.
pub(super) struct Ring<const N: usize>(Mutex<RefCell<Inside<N>>>);

struct Inside<const N: usize> {
    bytes: Deque<u8, N>,
    lost: u32,
}

impl<const N: usize> Ring<N> {
    pub(super) const fn new() -> Self {
        Self(Mutex::new(RefCell::new(Inside {
            bytes: Deque::new(),
            lost: 0,
        })))
    }

    /// Bytes inside.
    pub(super) fn held(&self) -> usize {
        self.with(|inside| inside.bytes.len())
    }

    /// Bytes that were given up; the count wraps.
    pub(super) fn lost(&self) -> u32 {
        self.with(|inside| inside.lost)
    }

    /// Puts in as much as there is room for, and says how much that was.
    pub(super) fn push(&self, bytes: &[u8]) -> usize {
        let mut pushed = 0;
        for piece in bytes.chunks(PIECE) {
            let some = self.with(|inside| inside.push(piece));
            pushed += some;
            if some < piece.len() {
                break;
            }
        }
        pushed
    }

    /// Puts in what there is room for, and counts the rest as lost.
    pub(super) fn push_or_lose(&self, bytes: &[u8]) {
        for piece in bytes.chunks(PIECE) {
            self.with(|inside| {
                let some = inside.push(piece);
                inside.lost = inside.lost.wrapping_add((piece.len() - some) as u32);
            });
        }
    }

    /// Copies the first bytes, and says how many; they stay.
    pub(super) fn peek(&self, into: &mut [u8]) -> usize {
        let mut peeked = 0;
        for piece in into.chunks_mut(PIECE) {
            let some = self.with(|inside| inside.peek(peeked, piece));
            peeked += some;
            if some < piece.len() {
                break;
            }
        }
        peeked
    }

    /// Takes out the first `count` bytes.
    pub(super) fn consume(&self, count: usize) {
        for begin in (0..count).step_by(PIECE) {
            self.with(|inside| {
                for _ in begin..count.min(begin + PIECE) {
                    inside.bytes.pop_front();
                }
            });
        }
    }

    fn with<R: Default>(&self, f: impl FnOnce(&mut Inside<N>) -> R) -> R {
        critical_section::with(|section| {
            // Nothing that is called inside comes back here, so it never is borrowed.
            let inside = self.0.borrow(section).try_borrow_mut();
            inside.map_or_else(|_| R::default(), |mut inside| f(&mut inside))
        })
    }
}

impl<const N: usize> Inside<N> {
    fn push(&mut self, piece: &[u8]) -> usize {
        let pushed = piece
            .iter()
            .take_while(|byte| self.bytes.push_back(**byte).is_ok());
        pushed.count()
    }

    fn peek(&self, skipped: usize, into: &mut [u8]) -> usize {
        let (first, second) = self.bytes.as_slices();
        let skipped_of_second = skipped.saturating_sub(first.len());
        let first = first.get(skipped..).unwrap_or_default();
        let second = second.get(skipped_of_second..).unwrap_or_default();
        let places = into.iter_mut().zip(first.iter().chain(second));
        places.map(|(place, byte)| *place = *byte).count()
    }
}

#[cfg(test)]
#[path = "../../tests/inside/printed.rs"]
mod tests;
