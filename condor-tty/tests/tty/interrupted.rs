//! A write that is interrupted, at each of its accesses in turn, by a loop that writes, too.
#![cfg(feature = "hostile")]

use std::cell::{Cell, RefCell};
use std::rc::{Rc, Weak};

use crate::support::{Board, HOST};
use condor_mbox::sim::SimWindow;
use condor_mbox::{AccessError, Allocator, Exclusion, LoadOrder, MemoryWindow, Region, StoreOrder};
use condor_tty::{Policy, Terminal, TerminalReader, TerminalSettings};

type Hand = Terminal<Interrupted, Masked, 8>;

/// When the interrupt comes: before which access that is not masked.
#[derive(Default)]
struct Line {
    accesses_left: Cell<Option<u32>>,
    masked: Cell<bool>,
    hand: RefCell<Weak<Hand>>,
    written: Cell<Option<usize>>,
    host: RefCell<Option<TerminalReader<SimWindow>>>,
}

impl Line {
    fn access(&self) {
        let Some(left) = self.accesses_left.get().filter(|_| !self.masked.get()) else {
            return;
        };
        self.accesses_left.set(left.checked_sub(1));
        if left == 0 {
            let hand = self.hand.borrow().upgrade().unwrap();
            let written = hand.poster(&Board::new()).post(b"INTER").unwrap();
            self.written.set(Some(written));
            // The host sees nothing of a write that has not ended.
            let mut bytes = [0; 64];
            let mut host = self.host.borrow_mut();
            let seen = host.as_mut().unwrap().fetch(&mut bytes).unwrap().len;
            let both = [OUTER, b"INTER"].concat();
            let whole = [b"", &b"INTER"[..], &both];
            assert!(whole.contains(&&bytes[..seen]), "{:?}", &bytes[..seen]);
        }
    }
}

#[derive(Clone)]
struct Interrupted(SimWindow, Rc<Line>);

impl MemoryWindow for Interrupted {
    type Error = AccessError;

    fn size(&self) -> u32 {
        self.0.size()
    }

    fn load(&self, offset: u32, order: LoadOrder) -> Result<u32, AccessError> {
        self.1.access();
        self.0.load(offset, order)
    }

    fn store(&self, offset: u32, value: u32, order: StoreOrder) -> Result<(), AccessError> {
        self.1.access();
        self.0.store(offset, value, order)
    }

    fn check(&self, offset: u32, len: usize) -> Result<(), AccessError> {
        self.0.check(offset, len)
    }
}

struct Masked(Rc<Line>);

impl Exclusion for Masked {
    fn with<R>(&self, body: impl FnOnce() -> R) -> R {
        let before = self.0.masked.replace(true);
        let result = body();
        self.0.masked.set(before);
        result
    }
}

const OUTER: &[u8] = b"abcdefghijklmnopqrstu";

/// Interrupts at access `at`, the ring having gone round to `begin`; says whether there was one.
fn interrupt(policy: Policy, begin: usize, at: u32) -> bool {
    let line = Rc::new(Line::default());
    let memory = SimWindow::new(256);
    let region = Region::whole(Interrupted(memory.clone(), Rc::clone(&line)));
    let mut allocator = Allocator::new(region.size());
    let hand = Terminal::new(region, &mut allocator, 32, Masked(Rc::clone(&line))).unwrap();
    let hand = Rc::new(hand);
    *line.hand.borrow_mut() = Rc::downgrade(&hand);
    hand.configure(&TerminalSettings::RAW).unwrap();
    hand.set_policy(policy).unwrap();
    let board = Board::new();
    let mut host = TerminalReader::attach(Region::whole(memory), 0, HOST).unwrap();
    let mut bytes = [0; 64];
    assert_eq!(hand.poster(&board).post(&vec![b'-'; begin]).unwrap(), begin);
    assert_eq!(host.fetch(&mut bytes).unwrap().len, begin);
    host.acknowledge(begin).unwrap();

    *line.host.borrow_mut() = Some(host);
    line.accesses_left.set(Some(at));
    let written = hand.poster(&board).post(OUTER).unwrap();
    line.accesses_left.set(None);
    let mut host = line.host.borrow_mut().take().unwrap();
    let fetched = host.fetch(&mut bytes).unwrap();
    let text = String::from_utf8(bytes[..fetched.len].to_vec()).unwrap();
    let came = line.written.get();
    assert_eq!(written, OUTER.len());
    assert_eq!(came.unwrap_or(5), 5);
    // Before it, or after it; never inside.
    let outer = std::str::from_utf8(OUTER).unwrap();
    match came {
        None => assert_eq!(text, outer),
        Some(_) => assert!(
            text == format!("{outer}INTER") || text == format!("INTER{outer}"),
            "{policy:?}, {begin}, {at}: {text}"
        ),
    }
    assert_eq!((hand.lost(), fetched.skipped), (0, 0));
    came.is_some()
}

#[test]
fn both_writes_are_whole_wherever_the_one_comes_into_the_other() {
    for policy in [Policy::DropNew, Policy::DropOld] {
        for begin in 0..32 {
            let came = (0..1000)
                .take_while(|at| interrupt(policy, begin, *at))
                .count();
            assert!(came > 4, "a write makes some accesses that are not masked");
        }
    }
}
