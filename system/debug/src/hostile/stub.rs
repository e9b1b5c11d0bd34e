//! A stub whose debug area has any words, which also change while it works.

use std::cell::{Cell, RefCell};

use crate::{AREA_BYTES, Arch, Stub, Trigger};
use condor_mbox::Region;
use condor_mbox::sim::SimWindow;

const MEMORY: usize = 64;
/// The offsets of the words of a command, and the action that ends every hold, as in README.md.
const COMMAND: u32 = 1024;
const ACTION: u32 = 1028;
const DONE: u32 = 1056;
const RELEASE: u32 = 3;

/// A processor with a peer that writes its area whenever it waits.
struct Haunted<'b> {
    area: Region<SimWindow>,
    memory: RefCell<[u32; MEMORY]>,
    bytes: Cell<&'b [u8]>,
}

impl Haunted<'_> {
    /// Writes words of the area; five bytes decide the place and the value of each.
    fn scribble(&self) {
        let (some, rest) = self.bytes.get().split_at(self.bytes.get().len().min(20));
        self.bytes.set(rest);
        for piece in some.chunks_exact(5) {
            let [place, value @ ..] = piece else { continue };
            // The words of commands and tables are behind the frame.
            let at = COMMAND + 4 * u32::from(*place);
            let value = value.try_into().map_or(0, u32::from_le_bytes);
            self.area.set_word(at, value).expect("inside of the area");
        }
        if some.is_empty() {
            let done = self.area.word(DONE).expect("inside of the area");
            let set = |at, value| self.area.set_word(at, value).expect("inside of the area");
            set(ACTION, RELEASE);
            set(COMMAND, done.wrapping_add(1));
        }
    }

    fn place(address: u64) -> Option<usize> {
        usize::try_from(address)
            .ok()
            .filter(|place| *place < MEMORY)
    }
}

impl Arch for Haunted<'_> {
    fn closed(&self) -> std::ops::Range<u64> {
        0..0
    }

    fn original(&self, address: u64) -> Option<u32> {
        Self::place(address).map(|place| self.memory.borrow()[place])
    }

    fn plant(&self, address: u64) {
        self.restore(address, u32::MAX);
    }

    fn restore(&self, address: u64, original: u32) {
        if let Some(place) = Self::place(address) {
            self.memory.borrow_mut()[place] = original;
        }
    }

    fn is_breakpoint(&self, address: u64) -> bool {
        Self::place(address).is_some_and(|place| self.memory.borrow()[place] == u32::MAX)
    }

    fn arm(&self, trigger: Trigger) -> bool {
        self.scribble();
        trigger.address.is_multiple_of(2)
    }

    fn disarm(&self, _: Trigger) {
        self.scribble();
    }

    fn synchronize(&self) {
        self.scribble();
    }

    fn wait(&self) {
        self.scribble();
    }
}

/// Calls the methods of a stub while another processor overwrites its debug area. The calls and the
/// words in the area are taken from `bytes`, the input of a fuzz target.
///
/// # Panics
/// Panics if the stub panics.
pub fn run(bytes: &[u8]) {
    let haunted = Haunted {
        area: Region::whole(SimWindow::new(AREA_BYTES)),
        memory: RefCell::new([0; MEMORY]),
        bytes: Cell::new(bytes),
    };
    let stub = Stub::new(haunted.area.clone());
    while !haunted.bytes.get().is_empty() {
        let kind = haunted.bytes.get()[0];
        haunted.scribble();
        match kind % 4 {
            0 => stub.obey(&haunted).expect("the area is there"),
            1 => {
                let breakpoint = Some(u64::from(kind) / 4);
                let _ = stub
                    .exception(&haunted, breakpoint)
                    .expect("the area is there");
            }
            2 => {
                let _ = stub.exception(&haunted, None).expect("the area is there");
            }
            _ => {
                stub.begin(&haunted).expect("the area is there");
                let _ = stub.start(&haunted).expect("the area is there");
            }
        }
    }
}
