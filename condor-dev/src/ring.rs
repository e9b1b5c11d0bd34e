//! [`Ring`]: a queue of bytes between a driver's interrupt handler and its other calls.

use crate::sync::{AtomicBool, AtomicU8, AtomicU32, Ordering, masked};

/// A queue of `N` bytes with a writer and a reader, both claimed through `&self`. It is the buffer
/// between a driver's interrupt handler and its other calls. `N` is a power of two.
///
/// A context that has claimed the writer or the reader has it until it drops the [`RingWriter`] or
/// [`RingReader`]. Meanwhile a claim by another context, which interrupts the first one or runs
/// beside it, fails. So no context ever waits. The ring needs only loads and stores of atomics, and
/// a critical section of two accesses for a claim.
///
/// (`heapless::spsc` splits into its two ends by `&mut`, which a driver in a `static` does not
/// have.)
///
/// ```
/// use condor_dev::Ring;
///
/// static RECEIVED: Ring<64> = Ring::new();
///
/// // The handler of the interrupt:
/// RECEIVED.writer().expect("only the handler writes").push(b'!');
/// // The background:
/// let mut bytes = [0; 8];
/// let count = RECEIVED.reader().expect("only the background reads").read(&mut bytes);
/// assert_eq!(&bytes[..count], b"!");
/// ```
#[derive(Debug)]
pub struct Ring<const N: usize> {
    bytes: [AtomicU8; N],
    /// Bytes ever written, and bytes ever read, both wrapping; their difference is never above `N`.
    written: AtomicU32,
    read: AtomicU32,
    writing: AtomicBool,
    reading: AtomicBool,
}

impl<const N: usize> Ring<N> {
    const MASK: u32 = {
        assert!(
            N.is_power_of_two() && N <= 1 << 30,
            "a ring's size is a power of two"
        );
        N as u32 - 1
    };

    /// Makes an empty ring.
    #[cfg(not(condor_loom))]
    #[must_use]
    pub const fn new() -> Self {
        Self {
            bytes: [const { AtomicU8::new(0) }; N],
            written: AtomicU32::new(0),
            read: AtomicU32::new(0),
            writing: AtomicBool::new(false),
            reading: AtomicBool::new(false),
        }
    }

    /// Makes an empty ring.
    #[cfg(condor_loom)]
    #[must_use]
    pub fn new() -> Self {
        Self {
            bytes: core::array::from_fn(|_| AtomicU8::new(0)),
            written: AtomicU32::new(0),
            read: AtomicU32::new(0),
            writing: AtomicBool::new(false),
            reading: AtomicBool::new(false),
        }
    }

    /// Claims the writer, until the result is dropped; returns `None` while another context has it.
    #[inline]
    #[must_use]
    pub fn writer(&self) -> Option<RingWriter<'_, N>> {
        claim(&self.writing).then(|| RingWriter(self))
    }

    /// Claims the reader, until the result is dropped; returns `None` while another context has it.
    #[inline]
    #[must_use]
    pub fn reader(&self) -> Option<RingReader<'_, N>> {
        claim(&self.reading).then(|| RingReader(self))
    }

    /// Returns the number of bytes in the ring at this moment.
    #[inline]
    #[must_use]
    pub fn len(&self) -> usize {
        // In this order, and pairing with the stores of the ends: what was read had been written
        // before. What is written between the two loads may be more than there is room for.
        let read = self.read.load(Ordering::Acquire);
        let written = self.written.load(Ordering::Acquire);
        (written.wrapping_sub(read) as usize).min(N)
    }

    /// Returns true if the ring has no bytes to read at this moment.
    #[inline]
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns true if the ring has no room for another byte at this moment.
    #[inline]
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.len() == N
    }

    fn byte(&self, position: u32) -> Option<&AtomicU8> {
        self.bytes.get((position & Self::MASK) as usize)
    }
}

impl<const N: usize> Default for Ring<N> {
    fn default() -> Self {
        Self::new()
    }
}

/// Takes an end that is free.
fn claim(taken: &AtomicBool) -> bool {
    masked(|| {
        // Acquire: pairs with the Release store in the `drop` of the end; what its last holder did
        // to the ring comes before what this one does.
        let free = !taken.load(Ordering::Acquire);
        if free {
            // Relaxed: the critical section orders claims among themselves.
            taken.store(true, Ordering::Relaxed);
        }
        free
    })
}

/// The writing end of a [`Ring`], which [`Ring::writer`] returns; only one context at a time has
/// it. Dropping it ends the claim.
#[derive(Debug)]
pub struct RingWriter<'r, const N: usize>(&'r Ring<N>);

impl<const N: usize> RingWriter<'_, N> {
    /// Returns the number of bytes that can be written now.
    #[inline]
    #[must_use]
    pub fn room(&self) -> usize {
        N - self.0.len()
    }

    /// Writes a byte, and returns true; returns false if the ring is full, and writes nothing then.
    #[inline]
    pub fn push(&mut self, byte: u8) -> bool {
        self.write(&[byte]) == 1
    }

    /// Writes as many bytes as there is room for, and returns their number. All of them become
    /// readable at the same time.
    #[inline]
    pub fn write(&mut self, from: &[u8]) -> usize {
        let ring = self.0;
        // Relaxed: this end is the only one that stores it.
        let written = ring.written.load(Ordering::Relaxed);
        // Acquire: pairs with the Release store in `RingReader::advance`; the bytes there were taken out.
        let read = ring.read.load(Ordering::Acquire);
        let room = N.saturating_sub(written.wrapping_sub(read) as usize);
        let mut position = written;
        for &byte in from.iter().take(room) {
            if let Some(place) = ring.byte(position) {
                place.store(byte, Ordering::Relaxed);
            }
            position = position.wrapping_add(1);
        }
        // Release: pairs with the Acquire load in `RingReader`; the bytes are there.
        ring.written.store(position, Ordering::Release);
        position.wrapping_sub(written) as usize
    }
}

impl<const N: usize> Drop for RingWriter<'_, N> {
    fn drop(&mut self) {
        // Release: pairs with the Acquire load in `claim`.
        self.0.writing.store(false, Ordering::Release);
    }
}

/// The reading end of a [`Ring`], which [`Ring::reader`] returns; only one context at a time has
/// it. Dropping it ends the claim.
#[derive(Debug)]
pub struct RingReader<'r, const N: usize>(&'r Ring<N>);

impl<const N: usize> RingReader<'_, N> {
    /// Returns the oldest byte without taking it out; `None` if the ring is empty.
    #[inline]
    #[must_use]
    pub fn peek(&self) -> Option<u8> {
        let mut byte = [0];
        (self.copy(&mut byte) == 1).then_some(byte[0])
    }

    /// Discards the oldest byte, which [`peek`](Self::peek) returns; does nothing if the ring is
    /// empty.
    #[inline]
    pub fn skip(&mut self) {
        if !self.0.is_empty() {
            self.advance(1);
        }
    }

    /// Takes out as many bytes as the ring holds and `into` has room for, and returns their number.
    #[inline]
    pub fn read(&mut self, into: &mut [u8]) -> usize {
        let count = self.copy(into);
        self.advance(count as u32);
        count
    }

    /// Discards all bytes in the ring.
    pub fn clear(&mut self) {
        self.advance(self.0.len() as u32);
    }

    fn copy(&self, into: &mut [u8]) -> usize {
        let ring = self.0;
        // Relaxed: this end is the only one that stores it.
        let read = ring.read.load(Ordering::Relaxed);
        // Acquire: pairs with the Release store in `RingWriter::write`; the bytes are there.
        let written = ring.written.load(Ordering::Acquire);
        let count = (written.wrapping_sub(read) as usize).min(into.len());
        let mut position = read;
        for byte in into.iter_mut().take(count) {
            if let Some(place) = ring.byte(position) {
                *byte = place.load(Ordering::Relaxed);
            }
            position = position.wrapping_add(1);
        }
        count
    }

    fn advance(&mut self, count: u32) {
        let read = self.0.read.load(Ordering::Relaxed);
        // Release: pairs with the Acquire load in `RingWriter::write`; the bytes have been taken out.
        self.0
            .read
            .store(read.wrapping_add(count), Ordering::Release);
    }
}

impl<const N: usize> Drop for RingReader<'_, N> {
    fn drop(&mut self) {
        // Release: pairs with the Acquire load in `claim`.
        self.0.reading.store(false, Ordering::Release);
    }
}
