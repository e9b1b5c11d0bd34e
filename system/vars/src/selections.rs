//! [`Selections`]: private memory of a program that its request handler and its loop share.

use core::ops::Range;

use crate::sync::{AtomicU32, Ordering, array_of, const_unless_loom};

/// The greatest number of programs that can watch one loop at a time.
pub const MOST_WATCHERS: usize = 4;

/// The memory through which the request handler of a program tells a loop which variables are selected.
/// [`open`](Self::open) makes the two users of this memory: a [`VariableServer`](crate::VariableServer) for the handler
/// and a [`Sampler`](crate::Sampler) for the loop.
///
/// Each loop has a `Selections` of its own. `N` is its capacity: at most `3 * N` blocks of
/// variables and parameters (a single one is a block), and at most `N` pieces in a selection. A
/// piece is a run of neighbouring variables of one block, or a run of neighbouring whole blocks.
/// The memory has `64 * N + 196` bytes and is private: no other processor can access it.
///
/// ```
/// use condor_vars::Selections;
///
/// static SERVO: Selections<16> = Selections::new();
/// assert_eq!(size_of_val(&SERVO), 64 * 16 + 196);
/// ```
#[derive(Debug)]
pub struct Selections<const N: usize> {
    /// 1 while a handler uses the slots, otherwise 0: handlers may interrupt each other.
    pub(crate) is_taken: AtomicU32,
    pub(crate) slots: [Slot<N>; MOST_WATCHERS],
}

/// A slot, as the table's owner knows it. The handler writes all fields except `taken`.
#[derive(Debug)]
pub(crate) struct Slot<const N: usize> {
    /// The number of the last claim.
    pub(crate) claim: AtomicU32,
    /// The processor that claimed it, and its incarnation; 0 when the slot is free.
    pub(crate) owner: AtomicU32,
    pub(crate) incarnation: AtomicU32,
    /// The number of the last selection, for the handler alone.
    last_selection: AtomicU32,
    /// The number of the last selection, for the loop; its plan is the one of its parity.
    pub(crate) asked: AtomicU32,
    /// The number of the selection that the loop has taken over. Only the loop writes it.
    pub(crate) taken: AtomicU32,
    pub(crate) plans: [Plan<N>; 2],
}

/// A selection that has been checked, as pieces of the loop's memory.
#[derive(Debug)]
pub(crate) struct Plan<const N: usize> {
    pub(crate) count: AtomicU32,
    /// The number of words of values in a row; 0 if nothing is selected.
    pub(crate) words: AtomicU32,
    /// The number of ticks from one row to the next.
    pub(crate) every: AtomicU32,
    /// For each piece, the first block and the end of its blocks, 16 bits each.
    pub(crate) blocks: [AtomicU32; N],
    /// For each piece, the first word and the end of its words in its only block, 16 bits each; for a piece of
    /// whole blocks, the number of their words, and 0.
    pub(crate) parts: [AtomicU32; N],
}

impl<const N: usize> Plan<N> {
    const_unless_loom! {
        fn new() -> Self {
            Self {
                count: AtomicU32::new(0),
                words: AtomicU32::new(0),
                every: AtomicU32::new(0),
                blocks: array_of!(AtomicU32::new(0); N),
                parts: array_of!(AtomicU32::new(0); N),
            }
        }
    }
}

/// The part of its blocks that a piece covers.
#[derive(Debug)]
pub(crate) enum Part {
    Whole {
        words: usize,
    },
    /// A range of the words of the only block.
    Words(Range<usize>),
}

impl<const N: usize> Plan<N> {
    /// Iterates over the pieces: the range of their blocks, and the part that each piece covers.
    pub(crate) fn pieces(&self) -> impl Iterator<Item = (Range<usize>, Part)> {
        let unpack = |range: u32| ((range & 0xffff) as usize, (range >> 16) as usize);
        let pieces = self.blocks.iter().zip(&self.parts);
        let count = self.count.load(Ordering::Relaxed) as usize;
        pieces.take(count).map(move |(blocks, part)| {
            let (first, end) = unpack(blocks.load(Ordering::Relaxed));
            let part = match unpack(part.load(Ordering::Relaxed)) {
                (words, 0) => Part::Whole { words },
                (first, end) => Part::Words(first..end),
            };
            (first..end, part)
        })
    }
}

impl<const N: usize> Slot<N> {
    const_unless_loom! {
        fn new() -> Self {
            Self {
                claim: AtomicU32::new(0),
                owner: AtomicU32::new(0),
                incarnation: AtomicU32::new(0),
                last_selection: AtomicU32::new(0),
                asked: AtomicU32::new(0),
                taken: AtomicU32::new(0),
                plans: array_of!(Plan::new(); 2),
            }
        }
    }

    /// Returns the plan of a selection.
    pub(crate) fn plan(&self, selection: u32) -> &Plan<N> {
        let [even, odd] = &self.plans;
        if selection.is_multiple_of(2) {
            even
        } else {
            odd
        }
    }

    /// Returns the number of the next selection, never 0; `None` while the loop has not taken over the
    /// last one, and may be reading the plan of the next.
    pub(crate) fn next_selection(&self) -> Option<u32> {
        let asked = self.last_selection.load(Ordering::Relaxed);
        // Pairs with the loop's fence after it has left the former plan. Loom cannot show that it is needed:
        // there no load of the loop returns a value that is stored later.
        let is_taken = self.taken.load(Ordering::Acquire) == asked;
        is_taken.then_some(asked.checked_add(1).unwrap_or(2))
    }

    /// Leaves a selection for the loop, after its plan.
    pub(crate) fn ask(&self, selection: u32) {
        self.last_selection.store(selection, Ordering::Relaxed);
        // Pairs with the loop's load of `asked`.
        self.asked.store(selection, Ordering::Release);
    }
}

impl<const N: usize> Selections<N> {
    const_unless_loom! {
        /// Makes the memory in a state in which no slot is claimed and nothing is selected.
        #[must_use]
        pub fn new() -> Self {
            Self {
                is_taken: AtomicU32::new(0),
                slots: array_of!(Slot::new(); MOST_WATCHERS),
            }
        }
    }
}

impl<const N: usize> Default for Selections<N> {
    fn default() -> Self {
        Self::new()
    }
}
