//! Access to one `mail` object by the words of the [layout](crate::layout).

use core::sync::atomic::{AtomicU32, Ordering};

use crate::error::{LayoutField, MailboxError, MemoryObject};
use crate::id::{Processor, Vector};
use crate::layout::{self, entry, header};
use crate::window::{LoadOrder, MemoryWindow, StoreOrder, WindowError, WindowWords};

/// The number of a word of a `mail` in a system of `N`: one of them.
#[derive(Clone, Copy)]
pub(crate) struct At<const N: usize>(usize);

impl<const N: usize> At<N> {
    /// A word of the [header](header).
    pub(crate) const fn header(offset: u32) -> Self {
        Self::of(offset % layout::listen(0))
    }

    /// A word of the [entry](layout::vector) of `vector`.
    #[inline(always)]
    pub(crate) const fn vector(vector: Vector, field: u32) -> Self {
        let vector = (vector.index() % layout::VECTORS) as u32;
        Self::of(layout::vector_entry(N as u32, vector) + field % layout::VECTOR_BYTES)
    }

    /// The epoch that the owner hears of `sender`.
    pub(crate) const fn heard_epoch(sender: Processor) -> Self {
        Self::of(layout::listen(sender.0 as u32 % N as u32))
    }

    /// The number of its requests that the owner has heard.
    pub(crate) const fn heard_count(sender: Processor) -> Self {
        Self(Self::heard_epoch(sender).0 + 1)
    }

    /// The word at an offset inside.
    #[inline(always)]
    const fn of(offset: u32) -> Self {
        Self((offset / 4) as usize)
    }

    #[inline(always)]
    const fn offset(self) -> u32 {
        self.0 as u32 * 4
    }
}

/// The number of the first word of a slot or a cell, likewise.
#[derive(Clone, Copy)]
pub(crate) struct EntryAt<const N: usize>(usize);

impl<const N: usize> EntryAt<N> {
    /// A word of [it](entry).
    #[inline(always)]
    pub(crate) const fn word(self, word: u32) -> At<N> {
        At(self.0 + (word % entry::BYTES / 4) as usize)
    }
}

const ENTRY_WORDS: usize = entry::BYTES as usize / 4;
/// Words of a pair before its slots, and before its cells.
const SLOTS_AT: usize = layout::slot_in(0, 0) as usize / 4;
const CELLS_AT: usize = layout::cell_in(0, 0) as usize / 4;

/// The number of the first word of what a `mail` keeps for a peer, likewise.
#[derive(Clone, Copy)]
pub(crate) struct Pair<const N: usize>(usize);

impl<const N: usize> Pair<N> {
    /// That of `peer`.
    pub(crate) const fn of(peer: Processor) -> Self {
        Self(At::<N>::of(layout::acknowledged(N as u32, peer.0 as u32 % N as u32)).0)
    }

    /// The incarnation of the peer that is acknowledged.
    #[inline(always)]
    pub(crate) const fn acknowledged(self) -> At<N> {
        At(self.0)
    }

    /// The number of its requests that have been taken.
    #[inline(always)]
    pub(crate) const fn taken(self) -> At<N> {
        At(self.0 + At::<N>::of(layout::taken_in(0)).0)
    }

    /// The slot of a request to it.
    #[inline(always)]
    pub(crate) const fn slot(self, sequence: u32) -> EntryAt<N> {
        EntryAt(self.0 + SLOTS_AT + (sequence % layout::SLOTS) as usize * ENTRY_WORDS)
    }

    /// The cell of a reply to it.
    #[inline(always)]
    pub(crate) const fn cell(self, cell: u32) -> EntryAt<N> {
        EntryAt(self.0 + CELLS_AT + (cell % layout::SLOTS) as usize * ENTRY_WORDS)
    }
}

/// The `mail` of `owner` in a system of `N` processors.
///
/// There are two kinds of access. [`load`](Self::load) and [`store`](Self::store) say what is wrong.
/// [`look`](Self::look), [`set`](Self::set), [`get`](Self::get) and [`put`](Self::put) are for the
/// rings, and report no error. Memory that is gone reads as 0. That is never a valid incarnation, epoch or
/// sequence number, so nothing is taken from it.
pub(crate) struct Mail<'w, W, const N: usize> {
    window: &'w W,
    /// All words of the layout, and maybe more, if they can be reached without a call for each of them.
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
    const BYTES: u32 = layout::mail_bytes(Self::PROCESSORS);

    /// In a window of whatever size.
    pub(crate) fn new(window: &'w W, owner: &'w Processor) -> Self {
        let words = window.words().map(WindowWords::get);
        Self {
            window,
            words: words.filter(|words| words.len() >= Self::BYTES as usize / 4),
            owner,
        }
    }

    /// In a window that is large enough.
    ///
    /// # Safety
    /// [`check_size`](Self::check_size) has found that.
    #[inline(always)]
    pub(crate) unsafe fn large_enough(window: &'w W, owner: &'w Processor) -> Self {
        Self {
            window,
            words: window.words().map(WindowWords::get),
            owner,
        }
    }

    #[inline(always)]
    pub(crate) fn load(&self, at: At<N>, order: LoadOrder) -> Result<u32, MailboxError> {
        self.window
            .load(at.offset(), order)
            .map_err(|error| self.refused(&error))
    }

    #[inline(always)]
    pub(crate) fn store(
        &self,
        at: At<N>,
        value: u32,
        order: StoreOrder,
    ) -> Result<(), MailboxError> {
        self.window
            .store(at.offset(), value, order)
            .map_err(|error| self.refused(&error))
    }

    #[cold]
    fn refused(&self, error: &W::Error) -> MailboxError {
        MailboxError::Window {
            processor: *self.owner,
            object: MemoryObject::Mail,
            kind: error.kind(),
        }
    }

    /// The word at `at`.
    #[inline(always)]
    fn word(words: &[AtomicU32], at: At<N>) -> &AtomicU32 {
        debug_assert!(at.offset() < Self::BYTES && words.len() >= Self::BYTES as usize / 4);
        // SAFETY: there are all words of the layout, as `new` and `large_enough` saw, and all that make
        // an `At` make one of them.
        unsafe { words.get_unchecked(at.0) }
    }

    /// The word at `at`; 0 if it is not there.
    #[inline(always)]
    pub(crate) fn look(&self, at: At<N>, order: LoadOrder) -> u32 {
        match self.words {
            Some(words) => Self::word(words, at).load(order.into()),
            None => self.window.load(at.offset(), order).unwrap_or(0),
        }
    }

    /// Returns the processor whose `mail` this is.
    #[inline(always)]
    pub(crate) fn owner(&self) -> Processor {
        *self.owner
    }

    /// The owner's present incarnation, by its own word; 0 also if the memory is gone.
    #[inline(always)]
    pub(crate) fn present(&self) -> u32 {
        // Acquire: pairs with the Release store of the incarnation in `join`.
        self.look(At::header(header::INCARNATION), LoadOrder::Acquire)
    }

    /// Writes a word of the processor's own `mail`, after all that was written before.
    #[inline(always)]
    pub(crate) fn set(&self, at: At<N>, value: u32) {
        match self.words {
            Some(words) => Self::word(words, at).store(value, Ordering::Release),
            None => drop(self.window.store(at.offset(), value, StoreOrder::Release)),
        }
    }

    /// Adds one to a statistics word of the processor's own `mail`.
    #[inline(always)]
    pub(crate) fn count(&self, at: At<N>) {
        self.set(at, self.look(at, LoadOrder::Relaxed).wrapping_add(1));
    }

    /// Returns true if the entry at `at` carries `sequence`: one load, for waiting.
    #[inline(always)]
    pub(crate) fn carries(&self, at: EntryAt<N>, sequence: u32) -> bool {
        // Acquire: pairs with the Release store of the sequence number in `write`.
        self.look(at.word(entry::SEQUENCE), LoadOrder::Acquire) == sequence
    }

    /// Reads the entry at `at`, if it carries `sequence` and the same epoch before and after the
    /// read. A caller that waits for the entry first checks whether it [`carries`](Self::carries)
    /// the number.
    ///
    /// The sequence number alone does not tell one entry from another: in the next epoch it comes
    /// again.
    #[inline(always)]
    pub(crate) fn get(&self, at: EntryAt<N>, sequence: u32) -> Option<Entry> {
        match self.words {
            Some(words) => read(sequence, |word, order| {
                Some(Self::word(words, at.word(word)).load(order.into()))
            }),
            // Memory that calls say is gone may be there again for the next word: no 0 may stand for it.
            None => read(sequence, |word, order| {
                self.window.load(at.word(word).offset(), order).ok()
            }),
        }
    }

    /// Writes the entry at `at` of the processor's own `mail`. A reader that finds `sequence` there finds the
    /// whole entry.
    #[inline(always)]
    pub(crate) fn put(&self, at: EntryAt<N>, sequence: u32, new: Entry) {
        match self.words {
            Some(words) => write(sequence, new, |word, value, order| {
                Self::word(words, at.word(word)).store(value, order.into());
            }),
            None => write(sequence, new, |word, value, order| {
                drop(self.window.store(at.word(word).offset(), value, order));
            }),
        }
    }

    /// Checks that this `mail` is laid out as this build expects.
    pub(crate) fn check_layout(&self, data_bytes: u32) -> Result<(), MailboxError> {
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
            let found = self.load(At::header(offset), LoadOrder::Acquire)?;
            if found != expected {
                return Err(self.disagrees(MemoryObject::Mail, field, found, expected));
            }
        }
        Ok(())
    }

    /// Checks that the window is large enough, before anything is read.
    pub(crate) fn check_size(&self) -> Result<(), MailboxError> {
        let found = self.window.size();
        if found < Self::BYTES {
            return Err(self.disagrees(
                MemoryObject::Mail,
                LayoutField::MailSize,
                found,
                Self::BYTES,
            ));
        }
        Ok(())
    }

    /// Checks the sizes of both objects.
    pub(crate) fn check_sizes(&self, data_bytes: u32) -> Result<(), MailboxError> {
        self.check_size()?;
        if data_bytes < layout::BELL_BYTES {
            let expected = layout::BELL_BYTES;
            return Err(self.disagrees(
                MemoryObject::Data,
                LayoutField::DataSize,
                data_bytes,
                expected,
            ));
        }
        Ok(())
    }

    fn disagrees(
        &self,
        object: MemoryObject,
        field: LayoutField,
        found: u32,
        expected: u32,
    ) -> MailboxError {
        MailboxError::Layout {
            processor: *self.owner,
            object,
            field,
            found,
            expected,
        }
    }

    /// Writes everything of the header that does not change, the magic number last.
    pub(crate) fn format(&self, data_bytes: u32) -> Result<(), MailboxError> {
        for (offset, value) in [
            (header::VERSION, layout::VERSION),
            (header::PROCESSORS, Self::PROCESSORS),
            (header::NUMBER, u32::from(self.owner.0)),
            (header::SLOTS, layout::SLOTS),
            (header::VECTORS, layout::VECTORS as u32),
            (header::DATA_SIZE, data_bytes),
        ] {
            self.store(At::header(offset), value, StoreOrder::Relaxed)?;
        }
        // Release: whoever is killed before leaves a file without a magic number, which the next
        // one formats anew.
        self.store(
            At::header(header::MAGIC),
            layout::MAGIC,
            StoreOrder::Release,
        )
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

/// Writes an entry by `store`, so that a reader that finds `sequence` finds the whole entry.
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

    use super::{Entry, EntryAt, Mail, entry};
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
            mail.put(EntryAt(0), 1, entry_of(1));
            window.records.set(true);
            mail.put(EntryAt(0), 1, entry_of(2));
            *window.schedule.borrow_mut() = schedule.clone().into();
            if let Some(found) = mail.get(EntryAt(0), 1) {
                assert_eq!(found, entry_of(found.epoch), "{schedule:?}");
            }
        }
    }
}
