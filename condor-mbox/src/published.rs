//! [`Published`]: a latest value, polled without messages.

use core::fmt;
use core::marker::PhantomData;

use zerocopy::{FromBytes, Immutable, IntoBytes};

use crate::layout::LINE;
use crate::sync::Ordering;
use crate::sync::fence;
use crate::window::{AccessError, LoadOrder, MemoryWindow, StoreOrder, WindowError};

/// The offset of a latest-value cell in shared memory: a value of type `T` with one writer, any
/// number of readers, and no locks.
///
/// The writer never waits. A reader gets the value that was published last, consistent, with its
/// sequence number; it does not wait, and causes no work on the writer's processor. Loads and
/// stores suffice. If a writer stops, dies or is preempted in the middle of a publication, the
/// previous value stays readable, and a new writer continues there.
///
/// # In shared memory
///
/// The cell has two buffers. Each has a sequence word and the value, and takes a whole number of
/// cache lines; all zeros mean that nothing has been published. Publication *n* goes to buffer *n*
/// mod 2, whose sequence word is 2*n* + 1 while it is written and 2*n* when it is complete. Other
/// contents cause wrong values or errors, and the next publications repair them.
///
/// ```
/// # use condor_mbox::published::PublishedReadError;
/// # use condor_mbox::{MemoryWindow, Allocator, Published, Region, StaticMemory};
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// static MEMORY: StaticMemory<256> = StaticMemory::new();
/// let ram = Region::users(MEMORY.window())?;
/// let angles: Published<[f32; 4]> = Allocator::new(ram.size()).published()?;
///
/// let subscriber = angles.subscriber(&ram)?;
/// assert_eq!(subscriber.read(), Err(PublishedReadError::Unpublished));
///
/// let mut publisher = angles.publisher(&ram)?;
/// publisher.publish(&[0.1, 0.2, 0.3, 0.4])?;
/// let latest = subscriber.read()?;
/// assert_eq!(latest.value[3].to_bits(), 0.4_f32.to_bits());
/// assert_eq!(latest.sequence, 1);
/// # Ok(())
/// # }
/// ```
pub struct Published<T> {
    offset: u32,
    of: PhantomData<fn() -> T>,
}

impl<T> Published<T> {
    /// The size of the cell in shared memory, in bytes.
    pub const BYTES: u32 = {
        let bytes = 2 * buffer_bytes(size_of::<T>());
        assert!(bytes <= u32::MAX as usize, "no window is that large");
        bytes as u32
    };

    /// Returns the cell at `offset`, in bytes from the beginning of its window or region. The
    /// offset must be a multiple of four.
    #[must_use]
    pub const fn at(offset: u32) -> Self {
        Self {
            offset,
            of: PhantomData,
        }
    }

    /// Returns the cell's offset, in bytes from the beginning of its window or region. A message
    /// about the cell carries this number.
    #[must_use]
    pub const fn offset(self) -> u32 {
        self.offset
    }

    /// Makes the writer of the cell, which lies in `window`. The writer continues after the last
    /// complete publication.
    ///
    /// There must be no other writer at the same time; readers would get mixtures.
    ///
    /// # Errors
    /// [`AccessError`] if the cell is misaligned or not inside `window`, or if the memory is gone.
    pub fn publisher<W: MemoryWindow>(self, window: W) -> Result<Publisher<T, W>, AccessError> {
        let cell = Cell::new(self.offset, size_of::<T>(), window)?;
        let next = match newest(cell.sequences()?) {
            Some(last) => successor(last),
            None => FIRST,
        };
        Ok(Publisher {
            cell,
            next,
            of: PhantomData,
        })
    }

    /// Makes a reader of the cell, which lies in `window`. A cell may have any number of readers.
    ///
    /// # Errors
    /// [`AccessError`] if the cell is misaligned or not inside `window`.
    pub fn subscriber<W: MemoryWindow>(self, window: W) -> Result<Subscriber<T, W>, AccessError> {
        Ok(Subscriber {
            cell: Cell::new(self.offset, size_of::<T>(), window)?,
            attempts: ATTEMPTS,
            of: PhantomData,
        })
    }
}

impl<T> Clone for Published<T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<T> Copy for Published<T> {}

impl<T> fmt::Debug for Published<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Published").field(&self.offset).finish()
    }
}

/// The only writer of a [`Published`] cell. [`Published::publisher`] makes it.
#[derive(Debug)]
pub struct Publisher<T, W> {
    cell: Cell<W>,
    next: u32,
    of: PhantomData<fn(T)>,
}

impl<T: IntoBytes + Immutable, W: MemoryWindow> Publisher<T, W> {
    /// Publishes `value`, and returns the sequence number of this publication.
    ///
    /// # Errors
    /// [`AccessError`] if the window is read-only or its memory is gone; readers then still get the
    /// previous value.
    pub fn publish(&mut self, value: &T) -> Result<u32, AccessError> {
        let sequence = self.next;
        let buffer = sequence % 2;
        // A reader that copies any of the new words passes its fence after this one, so that
        // its second look at the sequence finds this mark or a later one.
        self.cell
            .set_sequence(buffer, writing(sequence), StoreOrder::Relaxed)?;
        fence(Ordering::Release);
        self.cell.write(buffer, value.as_bytes())?;
        // Pairs with the reader's first look at the sequence.
        self.cell
            .set_sequence(buffer, complete(sequence), StoreOrder::Release)?;
        self.next = successor(sequence);
        Ok(sequence)
    }
}

/// A reader of a [`Published`] cell. [`Published::subscriber`] makes it.
#[derive(Debug)]
pub struct Subscriber<T, W> {
    cell: Cell<W>,
    attempts: u32,
    of: PhantomData<fn() -> T>,
}

impl<T, W> Subscriber<T, W> {
    /// Sets how often a read tries before it returns [`Contended`](PublishedReadError::Contended).
    /// The default is 4.
    ///
    /// A try fails only if the writer overtakes it: the writer completes one publication and begins
    /// another one in the same buffer while the value is copied.
    #[must_use]
    pub fn with_attempts(self, attempts: u32) -> Self {
        Self { attempts, ..self }
    }
}

impl<T: FromBytes + IntoBytes, W: MemoryWindow> Subscriber<T, W> {
    /// Returns the value that was published last, with its sequence number. The call never waits.
    ///
    /// # Errors
    /// [`PublishedReadError::Unpublished`] if nothing was published, [`PublishedReadError::Contended`] if the writer
    /// was too fast, [`PublishedReadError::Access`] if the memory cannot be accessed.
    pub fn read(&self) -> Result<PublishedValue<T>, PublishedReadError> {
        let mut value = T::new_zeroed();
        let sequence = self.cell.latest(value.as_mut_bytes(), self.attempts)?;
        Ok(PublishedValue { value, sequence })
    }
}

/// Copies the value that was published last in the cell at `offset` bytes of `window` to `value`;
/// returns its sequence number. Use this if the type of the cell is known only at run time.
///
/// `value` must have as many bytes as the writer's type.
///
/// # Errors
/// [`PublishedReadError::Unpublished`] if nothing was published, [`PublishedReadError::Contended`] if the writer was
/// too fast, [`PublishedReadError::Access`] if `value` does not fit the window or the memory cannot be
/// accessed.
pub fn read_bytes<W: MemoryWindow>(
    window: W,
    offset: u32,
    value: &mut [u8],
) -> Result<u32, PublishedReadError> {
    Cell::new(offset, value.len(), window)?.latest(value, ATTEMPTS)
}

/// A value that was read from a [`Published`] cell, with its sequence number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PublishedValue<T> {
    /// The value, as the writer published it: never a mixture of two values.
    pub value: T,
    /// The sequence number of the publication of this value; it changes with each publication.
    ///
    /// The first one is 1; 2 follows after 2³¹ − 1. The numbers continue when the writer restarts,
    /// unless the memory was cleared.
    pub sequence: u32,
}

/// The reason why a reader of a [`Published`] cell got no value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PublishedReadError {
    /// Nothing has been published yet.
    #[error("nothing has been published yet")]
    Unpublished,
    /// The writer was faster than every attempt, or the cell holds garbage.
    #[error("the value changed during each of {attempts} attempts to read it")]
    Contended {
        /// The number of attempts.
        attempts: u32,
    },
    /// The memory could not be accessed.
    #[error(transparent)]
    Access(#[from] AccessError),
}

const ATTEMPTS: u32 = 4;
const FIRST: u32 = 1;
const SEQUENCE_BYTES: usize = 4;

/// The sequence word of a publication in progress.
const fn writing(sequence: u32) -> u32 {
    complete(sequence) | 1
}

/// The sequence word of a complete publication.
const fn complete(sequence: u32) -> u32 {
    sequence << 1
}

/// The sequence after `sequence`: 31 bits, never 0, always of the other buffer.
const fn successor(sequence: u32) -> u32 {
    if sequence >= u32::MAX >> 1 {
        2
    } else {
        sequence + 1
    }
}

/// The later of the complete publications that two sequence words tell of.
fn newest([even, odd]: [u32; 2]) -> Option<u32> {
    let even_complete = even != 0 && even % 4 == complete(0);
    let odd_complete = odd % 4 == complete(1);
    match (even_complete, odd_complete) {
        (true, true) if odd.wrapping_sub(even).cast_signed() < 0 => Some(even >> 1),
        (_, true) => Some(odd >> 1),
        (true, false) => Some(even >> 1),
        (false, false) => None,
    }
}

/// The shared words of a cell that is known to lie inside its window.
#[derive(Debug)]
struct Cell<W> {
    window: W,
    offset: u32,
    /// Bytes of a buffer.
    buffer: u32,
}

/// Bytes of a buffer of the cell of a value of so many bytes.
const fn buffer_bytes(value: usize) -> usize {
    value
        .saturating_add(SEQUENCE_BYTES)
        .div_ceil(LINE as usize)
        .saturating_mul(LINE as usize)
}

impl<W: MemoryWindow> Cell<W> {
    fn new(offset: u32, value: usize, window: W) -> Result<Self, AccessError> {
        let buffer = buffer_bytes(value);
        AccessError::check(&window, offset, buffer.saturating_mul(2))?;
        Ok(Self {
            window,
            offset,
            buffer: buffer as u32,
        })
    }

    /// Copies the latest value, of as many bytes as the cell was made for, and returns its sequence.
    fn latest(&self, value: &mut [u8], attempts: u32) -> Result<u32, PublishedReadError> {
        for _ in 0..attempts {
            let sequences = self.sequences()?;
            let Some(sequence) = newest(sequences) else {
                // The first was looked at before the second: not even publication 1 was
                // complete by then. Any other pair was caught in motion, or is garbage.
                if sequences[0] == 0 && (sequences[1] == 0 || sequences[1] == writing(FIRST)) {
                    return Err(PublishedReadError::Unpublished);
                }
                continue;
            };
            let buffer = sequence % 2;
            self.read(buffer, value)?;
            // Pairs with the writer's fence: if a word of a later publication was copied, its
            // mark is seen below.
            fence(Ordering::Acquire);
            if self.sequence(buffer, LoadOrder::Relaxed)? == complete(sequence) {
                return Ok(sequence);
            }
        }
        Err(PublishedReadError::Contended { attempts })
    }

    /// Offset of a buffer; inside the window, since the cell is.
    fn buffer(&self, buffer: u32) -> u32 {
        let within = if buffer == 0 { 0 } else { self.buffer };
        self.offset.wrapping_add(within)
    }

    /// The sequence words of buffers 0 and 1, looked at in this order.
    fn sequences(&self) -> Result<[u32; 2], AccessError> {
        // Each pairs with the writer's store of a complete sequence.
        Ok([
            self.sequence(0, LoadOrder::Acquire)?,
            self.sequence(1, LoadOrder::Acquire)?,
        ])
    }

    fn sequence(&self, buffer: u32, order: LoadOrder) -> Result<u32, AccessError> {
        let at = self.buffer(buffer);
        self.window
            .load(at, order)
            .map_err(|error| self.error(at, SEQUENCE_BYTES, &error))
    }

    fn set_sequence(&self, buffer: u32, word: u32, order: StoreOrder) -> Result<(), AccessError> {
        let at = self.buffer(buffer);
        self.window
            .store(at, word, order)
            .map_err(|error| self.error(at, SEQUENCE_BYTES, &error))
    }

    fn read(&self, buffer: u32, into: &mut [u8]) -> Result<(), AccessError> {
        let at = self.buffer(buffer).wrapping_add(SEQUENCE_BYTES as u32);
        self.window
            .read(at, into)
            .map_err(|error| self.error(at, into.len(), &error))
    }

    fn write(&self, buffer: u32, from: &[u8]) -> Result<(), AccessError> {
        let at = self.buffer(buffer).wrapping_add(SEQUENCE_BYTES as u32);
        self.window
            .write(at, from)
            .map_err(|error| self.error(at, from.len(), &error))
    }

    fn error(&self, offset: u32, len: usize, error: &W::Error) -> AccessError {
        AccessError::new(offset, len, self.window.size(), error.kind())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn newest_follows_successor_through_the_wrap() {
        let mut sequence = u32::MAX / 2 - 5;
        let mut words = [0, 0];
        for _ in 0..20 {
            words[(sequence % 2) as usize] = complete(sequence);
            assert_eq!(newest(words), Some(sequence));
            let next = successor(sequence);
            assert_ne!(next % 2, sequence % 2);
            words[(next % 2) as usize] = writing(next);
            assert_eq!(newest(words), Some(sequence));
            sequence = next;
        }
    }

    #[test]
    fn words_of_the_wrong_buffer_are_not_believed() {
        assert_eq!(newest([complete(1), 0]), None);
        assert_eq!(newest([0, complete(2)]), None);
        assert_eq!(newest([0, 0]), None);
        assert_eq!(newest([u32::MAX, u32::MAX]), None);
    }
}
