//! Access to one `mail` object by the words of the [layout](crate::layout).

use core::sync::atomic::{AtomicU32, Ordering};

use crate::error::{Error, LayoutField, Object};
use crate::id::{Processor, Vector};
use crate::layout::{self, entry, header};
use crate::window::{LoadOrder, MemoryWindow, StoreOrder, WindowError};

/// The `mail` of `owner` in a system of `N` processors.
///
/// There are two kinds of access. [`load`](Self::load) and [`store`](Self::store) say what is wrong.
/// [`look`](Self::look), [`set`](Self::set), [`get`](Self::get) and [`put`](Self::put) are for the
/// rings, and report no error. Memory that is gone reads as 0. That is never a valid incarnation, epoch or
/// sequence number, so nothing is taken from it.
pub(crate) struct Mail<'w, W, const N: usize> {
    window: &'w W,
    /// The words of the layout, if they can be reached without a call for each of them.
    words: Option<&'w [AtomicU32]>,
    /// Looked at only when something is wrong.
    owner: &'w Processor,
}

impl<W, const N: usize> Clone for Mail<'_, W, N> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<W, const N: usize> Copy for Mail<'_, W, N> {}

/// A slot or a reply cell, read once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Entry {
    pub(crate) value: u32,
    pub(crate) epoch: u32,
    pub(crate) kind: u32,
}

impl<'w, W: MemoryWindow, const N: usize> Mail<'w, W, N> {
    const PROCESSORS: u32 = N as u32;
    const WORDS: usize = layout::mail_bytes(Self::PROCESSORS) as usize / 4;

    #[inline(always)]
    pub(crate) fn new(window: &'w W, owner: &'w Processor) -> Self {
        Self {
            window,
            // One look at the size for many accesses: the compiler knows of all words whose offset it
            // knows that they are inside.
            words: window.words().and_then(|words| words.get(..Self::WORDS)),
            owner,
        }
    }

    #[inline(always)]
    pub(crate) fn load(&self, offset: u32, order: LoadOrder) -> Result<u32, Error> {
        self.window
            .load(offset, order)
            .map_err(|error| self.refused(&error))
    }

    #[inline(always)]
    pub(crate) fn store(&self, offset: u32, value: u32, order: StoreOrder) -> Result<(), Error> {
        self.window
            .store(offset, value, order)
            .map_err(|error| self.refused(&error))
    }

    #[cold]
    fn refused(&self, error: &W::Error) -> Error {
        Error::Window {
            processor: *self.owner,
            object: Object::Mail,
            kind: error.kind(),
        }
    }

    /// The word at `offset`; 0 if it is not there.
    #[inline(always)]
    pub(crate) fn look(&self, offset: u32, order: LoadOrder) -> u32 {
        match self.words {
            Some(words) => words
                .get((offset / 4) as usize)
                .map_or(0, |word| word.load(order.into())),
            None => self.window.load(offset, order).unwrap_or(0),
        }
    }

    /// Whose it is.
    #[inline(always)]
    pub(crate) fn owner(&self) -> Processor {
        *self.owner
    }

    /// The owner's present incarnation, by its own word; 0 also if the memory is gone.
    #[inline(always)]
    pub(crate) fn present(&self) -> u32 {
        // Acquire: pairs with the Release store of the incarnation in `join`.
        self.look(header::INCARNATION, LoadOrder::Acquire)
    }

    /// Writes a word of the own `mail`, after all that was written before.
    #[inline(always)]
    pub(crate) fn set(&self, offset: u32, value: u32) {
        match self.words {
            Some(words) => {
                if let Some(word) = words.get((offset / 4) as usize) {
                    word.store(value, Ordering::Release);
                }
            }
            None => drop(self.window.store(offset, value, StoreOrder::Release)),
        }
    }

    /// Adds one to a statistics word of the own `mail`.
    #[inline(always)]
    pub(crate) fn count(&self, offset: u32) {
        self.set(
            offset,
            self.look(offset, LoadOrder::Relaxed).wrapping_add(1),
        );
    }

    /// The words of the entry at `at`, a multiple of its size.
    #[inline(always)]
    fn entry(&self, at: u32) -> Option<&'w [AtomicU32; 4]> {
        let entries = self.words?.as_chunks().0;
        entries.get((at / entry::BYTES) as usize)
    }

    /// Where the pair with `peer` begins: the incarnation of `peer` that the owner acknowledges.
    pub(crate) const fn pair(peer: Processor) -> u32 {
        layout::acknowledged(Self::PROCESSORS, peer.0 as u32)
    }

    /// A word of the entry of `vector`, which the caller has found to be one.
    #[inline(always)]
    pub(crate) fn vector(vector: Vector, field: u32) -> u32 {
        let vector = vector.index() % layout::VECTORS;
        layout::vector_entry(Self::PROCESSORS, vector as u32) + field
    }

    /// Whether the entry at `at` carries `sequence`: one load, for waiting.
    #[inline(always)]
    pub(crate) fn carries(&self, at: u32, sequence: u32) -> bool {
        // Acquire: pairs with the Release store of the sequence number in `write`.
        self.look(at + entry::SEQUENCE, LoadOrder::Acquire) == sequence
    }

    /// Reads the entry at `at` if it carries `sequence`, and the same epoch, before and after. Who
    /// waits for it asks first whether it [`carries`](Self::carries) that.
    ///
    /// The sequence number alone does not tell one entry from another: in the next epoch it comes
    /// again.
    #[inline(always)]
    pub(crate) fn get(&self, at: u32, sequence: u32) -> Option<Entry> {
        match self.entry(at) {
            Some(entry) => read(sequence, |word, order| {
                Some(entry[(word / 4 % 4) as usize].load(order.into()))
            }),
            // Memory that calls say is gone may be there again for the next word: no 0 may stand for it.
            None => read(sequence, |word, order| {
                self.window.load(at + word, order).ok()
            }),
        }
    }

    /// Writes the entry at `at` of the own `mail`; whoever finds `sequence` there finds the whole
    /// entry.
    #[inline(always)]
    pub(crate) fn put(&self, at: u32, sequence: u32, new: Entry) {
        match self.entry(at) {
            Some(entry) => write(sequence, new, |word, value, order| {
                entry[(word / 4 % 4) as usize].store(value, order.into());
            }),
            None => write(sequence, new, |word, value, order| {
                drop(self.window.store(at + word, value, order));
            }),
        }
    }

    /// Whether this `mail` is laid out as this build expects.
    pub(crate) fn check_layout(&self, data_bytes: u32) -> Result<(), Error> {
        let expected = [
            (LayoutField::Magic, header::MAGIC, layout::MAGIC),
            (LayoutField::Version, header::VERSION, layout::VERSION),
            (
                LayoutField::Processors,
                header::PROCESSORS,
                Self::PROCESSORS,
            ),
            (LayoutField::Number, header::NUMBER, u32::from(self.owner.0)),
            (LayoutField::Slots, header::SLOTS, layout::SLOTS),
            (
                LayoutField::Vectors,
                header::VECTORS,
                layout::VECTORS as u32,
            ),
            (LayoutField::DataSize, header::DATA_SIZE, data_bytes),
        ];
        for (field, offset, expected) in expected {
            // Acquire, for the first: pairs with the Release store of the magic number in `format`.
            let found = self.load(offset, LoadOrder::Acquire)?;
            if found != expected {
                return Err(self.disagrees(Object::Mail, field, found, expected));
            }
        }
        Ok(())
    }

    /// Checks the sizes of both objects, before anything is read.
    pub(crate) fn check_sizes(&self, data_bytes: u32) -> Result<(), Error> {
        let (found, expected) = (self.window.size(), layout::mail_bytes(Self::PROCESSORS));
        if found < expected {
            return Err(self.disagrees(Object::Mail, LayoutField::MailSize, found, expected));
        }
        if data_bytes < layout::BELL_BYTES {
            let expected = layout::BELL_BYTES;
            return Err(self.disagrees(Object::Data, LayoutField::DataSize, data_bytes, expected));
        }
        Ok(())
    }

    fn disagrees(&self, object: Object, field: LayoutField, found: u32, expected: u32) -> Error {
        Error::Layout {
            processor: *self.owner,
            object,
            field,
            found,
            expected,
        }
    }

    /// Writes everything of the header that does not change, the magic number last.
    pub(crate) fn format(&self, data_bytes: u32) -> Result<(), Error> {
        for (offset, value) in [
            (header::VERSION, layout::VERSION),
            (header::PROCESSORS, Self::PROCESSORS),
            (header::NUMBER, u32::from(self.owner.0)),
            (header::SLOTS, layout::SLOTS),
            (header::VECTORS, layout::VECTORS as u32),
            (header::DATA_SIZE, data_bytes),
        ] {
            self.store(offset, value, StoreOrder::Relaxed)?;
        }
        // Release: whoever is killed before leaves a file without a magic number, which the next
        // one formats anew.
        self.store(header::MAGIC, layout::MAGIC, StoreOrder::Release)
    }
}

/// Reads an entry that carries `sequence` by `load`, whole or not at all.
#[inline(always)]
fn read(sequence: u32, load: impl Fn(u32, LoadOrder) -> Option<u32>) -> Option<Entry> {
    let word = |word| load(word, LoadOrder::Acquire);
    // Pairs with the store of the epoch in `write`, so that the sequence number below is not that
    // of an entry of a former epoch.
    let epoch = word(entry::EPOCH)?;
    // Pairs with the store of the sequence number in `write`.
    if word(entry::SEQUENCE)? != sequence {
        return None;
    }
    // Pair with the stores of these words in `write`: if a word of a later entry is read here, the
    // loads below find the epoch and the sequence number that `write` had stored before it. If it
    // is the same number of a still later epoch, its load lets that epoch be seen.
    let (value, kind) = (word(entry::VALUE)?, word(entry::KIND)?);
    let same =
        word(entry::SEQUENCE)? == sequence && load(entry::EPOCH, LoadOrder::Relaxed)? == epoch;
    same.then_some(Entry { value, epoch, kind })
}

/// Writes an entry by `store`, so that whoever finds `sequence` finds the whole entry.
#[inline(always)]
fn write(sequence: u32, new: Entry, store: impl Fn(u32, u32, StoreOrder)) {
    let set = |word, value| store(word, value, StoreOrder::Release);
    // The number before `sequence` belongs to another slot, so nobody looks for it here.
    store(
        entry::SEQUENCE,
        sequence.wrapping_sub(1),
        StoreOrder::Relaxed,
    );
    // Each pairs with the load of the same word in `read`.
    set(entry::EPOCH, new.epoch);
    set(entry::VALUE, new.value);
    set(entry::KIND, new.kind);
    // This one also with that in `carries`.
    set(entry::SEQUENCE, sequence);
}

#[cfg(all(test, condor_loom))]
mod loom_models;

#[cfg(all(test, not(condor_loom)))]
mod tests {
    use core::cell::{Cell, RefCell};
    use std::collections::VecDeque;
    use std::vec::Vec;

    use super::{Entry, Mail, entry};
    use crate::id::Processor;
    use crate::window::{LoadOrder, MemoryWindow, StoreOrder, WindowError, WindowErrorKind};

    /// One entry, in which another processor's stores happen between the loads of this one.
    #[derive(Default)]
    struct Raced {
        words: [Cell<u32>; 4],
        /// What the writer stores, one after the other.
        writes: RefCell<VecDeque<(u32, u32)>>,
        /// How many of them happen before each load.
        schedule: RefCell<VecDeque<usize>>,
        /// Keeps stores in `writes` instead of making them.
        records: Cell<bool>,
    }

    #[derive(Debug)]
    struct Never;

    impl WindowError for Never {
        fn kind(&self) -> WindowErrorKind {
            WindowErrorKind::OutOfBounds
        }
    }

    impl MemoryWindow for Raced {
        type Error = Never;

        fn size(&self) -> u32 {
            16
        }

        fn load(&self, offset: u32, _: LoadOrder) -> Result<u32, Never> {
            for _ in 0..self.schedule.borrow_mut().pop_front().unwrap_or(0) {
                if let Some((at, value)) = self.writes.borrow_mut().pop_front() {
                    self.words[at as usize / 4].set(value);
                }
            }
            Ok(self.words[offset as usize / 4].get())
        }

        fn store(&self, offset: u32, value: u32, _: StoreOrder) -> Result<(), Never> {
            if self.records.get() {
                self.writes.borrow_mut().push_back((offset, value));
            } else {
                self.words[offset as usize / 4].set(value);
            }
            Ok(())
        }

        fn check(&self, _: u32, _: usize) -> Result<(), Never> {
            Ok(())
        }
    }

    /// All ways to spread at most `writes` stores over `loads` loads.
    fn schedules(loads: usize, writes: usize) -> Vec<Vec<usize>> {
        if loads == 0 {
            return vec![Vec::new()];
        }
        let rest = |first: usize| {
            schedules(loads - 1, writes - first)
                .into_iter()
                .map(move |rest| [vec![first], rest].concat())
        };
        (0..=writes).flat_map(rest).collect()
    }

    #[test]
    fn an_entry_is_of_one_epoch_though_its_sequence_comes_again_in_the_next() {
        let entry_of = |epoch| Entry {
            value: epoch * 10,
            epoch,
            kind: epoch * 100,
        };
        assert_eq!(entry::SEQUENCE, 12, "an entry has four words");
        for schedule in schedules(6, 5) {
            let window = Raced::default();
            let mail = Mail::<_, 2>::new(&window, &Processor(0));
            mail.put(0, 1, entry_of(1));
            window.records.set(true);
            mail.put(0, 1, entry_of(2));
            *window.schedule.borrow_mut() = schedule.clone().into();
            if let Some(found) = mail.get(0, 1) {
                assert_eq!(found, entry_of(found.epoch), "{schedule:?}");
            }
        }
    }
}
