//! A receiver that begins a new incarnation in the middle of a send to it.

use std::cell::Cell;
use std::rc::Rc;
use std::time::Duration;

use condor_mbox::error::ProtocolWord;
use condor_mbox::layout::{self, JOINING, header};
use condor_mbox::sim::{SimSystem, SimWindow};
use condor_mbox::{
    AccessError, Call, CriticalSection, LoadOrder, Mailbox, MailboxError, MemoryWindow, Messenger,
    Processor, StoreOrder, Vector, Windows,
};

const A: Processor = Processor(0);
const B: Processor = Processor(1);
const V: Vector = Vector(12);
/// Where `B` counts what it took from `A`.
const TAKEN: u32 = layout::taken(2, 0);

/// A window in which `B` stores `before_taken` just before `A` loads its count.
#[derive(Clone)]
struct Raced {
    window: SimWindow,
    peer: SimWindow,
    before_taken: Rc<Cell<&'static [(u32, u32)]>>,
}

impl MemoryWindow for Raced {
    type Error = AccessError;

    fn size(&self) -> u32 {
        self.window.size()
    }

    fn load(&self, offset: u32, order: LoadOrder) -> Result<u32, AccessError> {
        if offset == TAKEN {
            for &(at, value) in self.before_taken.take() {
                self.peer.store(at, value, StoreOrder::Release)?;
            }
        }
        self.window.load(offset, order)
    }

    fn store(&self, offset: u32, value: u32, order: StoreOrder) -> Result<(), AccessError> {
        self.window.store(offset, value, order)
    }

    fn check(&self, offset: u32, len: usize) -> Result<(), AccessError> {
        self.window.check(offset, len)
    }
}

fn ignore(_: &Call<'_>) -> u32 {
    0
}

/// What a send ends with if `B` stores `before_taken` while it looks for a slot.
fn send_while(before_taken: &'static [(u32, u32)]) -> Result<(), MailboxError> {
    let system = SimSystem::<2>::in_virtual_time(64);
    let writes = Rc::new(Cell::new(Default::default()));
    let peer = &system.windows(B)[1].mail;
    let raced = |window| Raced {
        window,
        peer: peer.clone(),
        before_taken: Rc::clone(&writes),
    };
    let windows = system.windows(A).map(|Windows { mail, data }| Windows {
        mail: raced(mail),
        data: raced(data),
    });
    let bell = system.doorbell(A);
    let mut a = Mailbox::<(_, _, _), 2>::new(A, windows, bell, CriticalSection).unwrap();
    let mut b = system.mailbox(B).unwrap();
    b.set_vector(V, &ignore, "ignores").unwrap();
    a.join().unwrap();
    b.join().unwrap();
    b.serve(Duration::ZERO).unwrap();
    // So many that a count of zero is further behind than a ring is long.
    for _ in 0..2 {
        for data in 0..layout::SLOTS {
            a.send(B, V, data, Duration::ZERO).unwrap();
        }
        b.serve(Duration::ZERO).unwrap();
    }
    writes.set(before_taken);
    a.send(B, V, 0, Duration::ZERO)
}

#[test]
fn a_count_that_a_new_incarnation_set_back_is_no_broken_protocol() {
    assert_eq!(
        send_while(&[(header::INCARNATION, JOINING), (TAKEN, 0)]),
        Err(MailboxError::NotConnected { to: B })
    );
}

#[test]
fn a_count_that_the_same_incarnation_set_back_is_one() {
    assert_eq!(
        send_while(&[(TAKEN, 0)]),
        Err(MailboxError::Protocol {
            peer: B,
            word: ProtocolWord::Taken,
            found: 0
        })
    );
}
