//! [`Latest`]: the latest value of one loop, for another loop.

use crate::sync::{AtomicBool, AtomicU8, Ordering, UnsafeCell, const_unless_loom};

/// Set beside the index in `middle` while the reader has not taken that buffer.
const FRESH: u8 = 4;
const INDEX: u8 = 3;

/// A place for values that one context writes and another context reads; both are contexts of one
/// processor, or threads. The reader gets the latest complete value, and neither ever waits for the
/// other.
///
/// There are three buffers. The writer and the reader own one each. The writer exchanges its buffer
/// for the third one when its value is complete, and the reader does so when the third one is newer
/// than its own. So a value is never copied, and may be of any size and any type that is `Send`. A
/// value that the reader does not take in time is overwritten.
///
/// Indices of buffers are exchanged atomically, or, on processors that cannot, within a critical
/// section of a few instructions.
///
/// ```
/// use condor_mos::Latest;
///
/// static TORQUES: Latest<[f32; 3]> = Latest::new([0.0; 3]);
///
/// let (mut writer, mut reader) = TORQUES.split().expect("split once");
/// writer.write([0.1, 0.2, 0.3]);
/// writer.write([0.4, 0.5, 0.6]);
/// assert!(reader.is_fresh());
/// assert_eq!(*reader.read(), [0.4, 0.5, 0.6]);
/// ```
pub struct Latest<T> {
    buffers: [UnsafeCell<T>; 3],
    /// The buffer that nobody uses, and whether it is newer than the reader's.
    middle: AtomicU8,
    /// The writer's buffer, and the reader's.
    ends: [UnsafeCell<u8>; 2],
    split: AtomicBool,
}

// SAFETY: each buffer is reached by the one end that holds its index, and each index of `ends` by
// its end; there is one `LatestWriter` and one `LatestReader`, as `split` and `split_mut` see to.
unsafe impl<T: Send> Sync for Latest<T> {}

impl<T> Latest<T> {
    const_unless_loom! {
        /// Makes a place for values that can be copied. The reader gets `initial` until a value is
        /// written.
        #[must_use]
        pub const fn new(initial: T) -> Self
        where
            T: Copy,
        {
            Self::with_buffers(initial, initial, initial)
        }
    }

    const_unless_loom! {
        /// Makes a place for values that cannot be copied. The reader gets `initial` until a value
        /// is written. `second` and `third` fill the other two buffers; the reader never gets them,
        /// but [`LatestWriter::buffer`] returns them to be overwritten.
        #[must_use]
        pub const fn with_buffers(initial: T, second: T, third: T) -> Self {
            Self {
                buffers: [
                    UnsafeCell::new(initial),
                    UnsafeCell::new(second),
                    UnsafeCell::new(third),
                ],
                middle: AtomicU8::new(1),
                ends: [UnsafeCell::new(2), UnsafeCell::new(0)],
                split: AtomicBool::new(false),
            }
        }
    }

    /// Returns the writer and the reader, the first time that it is called; returns `None`
    /// afterwards.
    pub fn split(&self) -> Option<(LatestWriter<'_, T>, LatestReader<'_, T>)> {
        // Relaxed: pairs with itself only; what the ends share begins with their first exchange.
        if self.split.swap(true, Ordering::Relaxed) {
            return None;
        }
        Some((LatestWriter { cell: self }, LatestReader { cell: self }))
    }

    /// Returns the writer and the reader, for as long as `self` is borrowed. It can be called again
    /// after that; the latest value is kept.
    pub fn split_mut(&mut self) -> (LatestWriter<'_, T>, LatestReader<'_, T>) {
        // `&mut self`: the ends of former calls are gone, and their indices are kept in the cell.
        (LatestWriter { cell: self }, LatestReader { cell: self })
    }

    fn buffer(&self, index: u8) -> &UnsafeCell<T> {
        let [first, second, third] = &self.buffers;
        match index & INDEX {
            0 => first,
            1 => second,
            _ => third,
        }
    }
}

/// The writing end of a [`Latest`]. One context or thread uses it.
pub struct LatestWriter<'l, T> {
    cell: &'l Latest<T>,
}

impl<T> LatestWriter<'_, T> {
    /// Makes `value` the latest value, which the reader gets next.
    pub fn write(&mut self, value: T) {
        *self.buffer() = value;
        self.publish();
    }

    /// Returns the value that [`publish`](Self::publish) will make the latest, so that it can be
    /// changed in place without a copy. After each `publish` it is one of the older values, not
    /// necessarily the last one.
    pub fn buffer(&mut self) -> &mut T {
        let [back, _] = &self.cell.ends;
        // SAFETY: the index is the writer's, and so is the buffer until it is published.
        let index = back.with(|back| unsafe { *back });
        // SAFETY: as before; `&mut self` keeps it from being published meanwhile.
        self.cell
            .buffer(index)
            .with_mut(|value| unsafe { &mut *value })
    }

    /// Makes the contents of [`buffer`](Self::buffer) the latest value.
    pub fn publish(&mut self) {
        let [back, _] = &self.cell.ends;
        let middle = &self.cell.middle;
        back.with_mut(|back| {
            // SAFETY: the index is the writer's.
            let back = unsafe { &mut *back };
            // Release: pairs with the reader's exchange, which takes the value. Acquire: pairs with
            // the reader's exchange, which hands in the buffer that it has finished reading.
            *back = middle.swap(*back | FRESH, Ordering::AcqRel) & INDEX;
        });
    }
}

/// The reading end of a [`Latest`]. One context or thread uses it.
pub struct LatestReader<'l, T> {
    cell: &'l Latest<T>,
}

impl<T> LatestReader<'_, T> {
    /// Returns the latest value. The reference stays valid, and the value unchanged, until the next
    /// call.
    pub fn read(&mut self) -> &T {
        let [_, front] = &self.cell.ends;
        let middle = &self.cell.middle;
        let fresh = self.is_fresh();
        let index = front.with_mut(|front| {
            // SAFETY: the index is the reader's.
            let front = unsafe { &mut *front };
            if fresh {
                // Acquire: pairs with the writer's exchange, which has published the value.
                // Release: pairs with the writer's exchange, which takes the buffer to overwrite it.
                *front = middle.swap(*front, Ordering::AcqRel) & INDEX;
            }
            *front
        });
        // SAFETY: the buffer is the reader's until it is handed in, which takes `&mut self`.
        self.cell.buffer(index).with(|value| unsafe { &*value })
    }

    /// Returns true if [`read`](Self::read) will return a value that it has not returned before.
    #[must_use]
    pub fn is_fresh(&self) -> bool {
        // Relaxed: only advises; the exchange that follows is what takes the value. The writer never
        // takes a fresh mark back.
        self.cell.middle.load(Ordering::Relaxed) & FRESH != 0
    }
}
