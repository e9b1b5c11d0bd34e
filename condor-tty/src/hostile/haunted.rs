//! [`Haunted`]: memory in which the other end rewrites words between any two accesses of this one.

use std::cell::RefCell;
use std::ops::Range;
use std::rc::Rc;

use condor_mbox::sim::SimWindow;
use condor_mbox::{AccessError, LoadOrder, MemoryWindow, StoreOrder};

use super::script::Script;

/// The least byte of a script with which the other end acts.
const ACTS: u8 = 0xe8;

pub(crate) struct Haunted<'b> {
    memory: SimWindow,
    script: Rc<Script<'b>>,
    /// The block and its ring, where the other end writes.
    terminal: Range<u32>,
    /// The words that this end must not write.
    others: Rc<RefCell<Range<u32>>>,
}

impl Clone for Haunted<'_> {
    fn clone(&self) -> Self {
        Self {
            memory: self.memory.clone(),
            script: Rc::clone(&self.script),
            terminal: self.terminal.clone(),
            others: Rc::clone(&self.others),
        }
    }
}

impl<'b> Haunted<'b> {
    /// Makes the memory of the terminal at `terminal` of `memory`, which `script` rewrites.
    pub(crate) fn new(memory: &SimWindow, script: &Rc<Script<'b>>, terminal: Range<u32>) -> Self {
        Self {
            memory: memory.clone(),
            script: Rc::clone(script),
            terminal,
            others: Rc::new(RefCell::new(0..0)),
        }
    }

    /// Makes a write of this end into `others`, or out of the terminal, a fault from now on.
    pub(crate) fn forbid(&self, others: Range<u32>) {
        *self.others.borrow_mut() = others;
    }

    /// Writes a word as the other end.
    pub(crate) fn rewrite(&self) {
        let words = (self.terminal.end - self.terminal.start) as usize / 4;
        let at = |word: usize| self.terminal.start + 4 * word as u32;
        let place = at(self.script.below(words));
        // Most faults need a value that is near to another cursor.
        let other = at(self.script.below(32));
        let present = self.memory.load(other, LoadOrder::Relaxed).unwrap();
        let value = self.script.near(present);
        self.memory
            .store(place, value, StoreOrder::Relaxed)
            .unwrap();
    }

    fn haunt(&self) {
        if !self.script.is_over() && self.script.byte() >= ACTS {
            self.rewrite();
        }
    }
}

impl MemoryWindow for Haunted<'_> {
    type Error = AccessError;

    fn size(&self) -> u32 {
        self.memory.size()
    }

    fn load(&self, offset: u32, order: LoadOrder) -> Result<u32, AccessError> {
        self.haunt();
        self.memory.load(offset, order)
    }

    fn store(&self, offset: u32, value: u32, order: StoreOrder) -> Result<(), AccessError> {
        self.haunt();
        assert!(
            self.terminal.contains(&offset) && !self.others.borrow().contains(&offset),
            "a write to {offset:#x}, which is not this end's"
        );
        self.memory.store(offset, value, order)
    }

    fn check(&self, offset: u32, len: usize) -> Result<(), AccessError> {
        self.memory.check(offset, len)
    }
}
