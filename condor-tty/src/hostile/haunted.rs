//! [`Haunted`]: memory in which the other end rewrites words between any two accesses of this one.

use std::cell::RefCell;
use std::ops::Range;
use std::rc::Rc;

use condor_mbox::sim::{SimWindow, SimWindowError};
use condor_mbox::{LoadOrder, MemoryWindow, StoreOrder};

use super::script::Script;

/// Bytes of a script from which on the other end acts.
const ACTS: u8 = 0xe8;

pub(crate) struct Haunted<'b> {
    memory: SimWindow,
    script: Rc<Script<'b>>,
    /// The block and its ring, where the other end writes.
    terminal: Range<u32>,
    /// Where this end must not write.
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
    /// The terminal at `terminal` of `memory`, acted upon as `script` says.
    pub(crate) fn new(memory: &SimWindow, script: &Rc<Script<'b>>, terminal: Range<u32>) -> Self {
        Self {
            memory: memory.clone(),
            script: Rc::clone(script),
            terminal,
            others: Rc::new(RefCell::new(0..0)),
        }
    }

    /// From now on a write of this end into `others`, or out of the terminal, is a fault.
    pub(crate) fn forbid(&self, others: Range<u32>) {
        *self.others.borrow_mut() = others;
    }

    /// The other end writes a word.
    pub(crate) fn rewrite(&self) {
        let words = (self.terminal.end - self.terminal.start) as usize / 4;
        let at = |word: usize| self.terminal.start + 4 * word as u32;
        let place = at(self.script.below(words));
        // What is near to another cursor is what matters.
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
    type Error = SimWindowError;

    fn size(&self) -> u32 {
        self.memory.size()
    }

    fn load(&self, offset: u32, order: LoadOrder) -> Result<u32, SimWindowError> {
        self.haunt();
        self.memory.load(offset, order)
    }

    fn store(&self, offset: u32, value: u32, order: StoreOrder) -> Result<(), SimWindowError> {
        self.haunt();
        assert!(
            self.terminal.contains(&offset) && !self.others.borrow().contains(&offset),
            "a write to {offset:#x}, which is not this end's"
        );
        self.memory.store(offset, value, order)
    }

    fn check(&self, offset: u32, len: usize) -> Result<(), SimWindowError> {
        self.memory.check(offset, len)
    }
}
