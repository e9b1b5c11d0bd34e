//! Memory that stops at an access, a mailbox that only counts, and a clock that only waits move.

use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::time::Duration;

use condor_mbox::sim::SimWindow;
use condor_mbox::window::WindowErrorKind;
use condor_mbox::{
    AccessError, Instant, LoadOrder, MailboxError, MemoryWindow, MessageTicket, Messenger,
    PendingReply, Processor, StoreOrder, Vector,
};

pub const HOST: Processor = Processor(0);
pub const HAND: Processor = Processor(1);

/// A window on memory whose accesses all fail after some number of them, as if the program had been killed.
#[derive(Clone)]
pub struct Mortal {
    memory: SimWindow,
    left: Rc<Cell<u32>>,
}

impl Mortal {
    pub fn new(memory: &SimWindow) -> Self {
        Self {
            memory: memory.clone(),
            left: Rc::new(Cell::new(u32::MAX)),
        }
    }

    /// Lets the next `accesses` accesses succeed; all later ones fail, as if the program had been killed.
    pub fn lives_for(&self, accesses: u32) {
        self.left.set(accesses);
    }

    pub fn is_dead(&self) -> bool {
        self.left.get() == 0
    }

    fn live(&self, offset: u32) -> Result<(), AccessError> {
        match self.left.get().checked_sub(1) {
            Some(left) => {
                self.left.set(left);
                Ok(())
            }
            None => Err(AccessError {
                offset,
                len: 4,
                size: self.memory.size(),
                kind: WindowErrorKind::Lost,
            }),
        }
    }
}

impl MemoryWindow for Mortal {
    type Error = AccessError;

    fn size(&self) -> u32 {
        self.memory.size()
    }

    fn load(&self, offset: u32, order: LoadOrder) -> Result<u32, AccessError> {
        self.live(offset)?;
        self.memory.load(offset, order)
    }

    fn store(&self, offset: u32, value: u32, order: StoreOrder) -> Result<(), AccessError> {
        self.live(offset)?;
        self.memory.store(offset, value, order)
    }

    fn check(&self, offset: u32, len: usize) -> Result<(), AccessError> {
        self.memory.check(offset, len)
    }
}

/// A [`Messenger`] for tests that counts the messages it sends, and runs a simulated host while it waits.
pub struct Board<'h> {
    now: Cell<u64>,
    pub rings: Cell<u32>,
    pub pauses: Cell<u32>,
    while_paused: RefCell<Box<dyn FnMut() + 'h>>,
}

impl<'h> Board<'h> {
    pub fn new() -> Self {
        Self::with(|| ())
    }

    /// Makes a mailbox that calls `host` once in each wait.
    pub fn with(host: impl FnMut() + 'h) -> Self {
        Self {
            now: Cell::new(0),
            rings: Cell::new(0),
            pauses: Cell::new(0),
            while_paused: RefCell::new(Box::new(host)),
        }
    }

    pub fn now_ns(&self) -> u64 {
        self.now.get()
    }
}

const NOT_SENT: MailboxError = MailboxError::NotConnected { to: HOST };

impl Messenger for Board<'_> {
    fn number(&self) -> Processor {
        HAND
    }

    fn now(&self) -> Instant {
        Instant::from_ns(self.now.get())
    }

    fn send(
        &self,
        _: Processor,
        vector: Vector,
        _: u32,
        timeout: Duration,
    ) -> Result<(), MailboxError> {
        // The receiver may be any processor that the host's words name.
        assert_eq!((vector, timeout), (Vector(56), Duration::ZERO));
        self.rings.set(self.rings.get() + 1);
        // Nothing is lost if the ring of messages is full.
        Err(NOT_SENT)
    }

    fn send_with_reply(
        &self,
        _: Processor,
        _: Vector,
        _: u32,
        _: Duration,
    ) -> Result<u32, MailboxError> {
        Err(NOT_SENT)
    }

    fn begin(
        &self,
        _: Processor,
        _: Vector,
        _: u32,
        _: Duration,
    ) -> Result<MessageTicket<'_>, MailboxError> {
        Err(NOT_SENT)
    }

    fn serve(&self, timeout: Duration) -> Result<usize, MailboxError> {
        self.pauses.set(self.pauses.get() + 1);
        self.now
            .set(self.now.get() + u64::try_from(timeout.as_nanos()).unwrap());
        (self.while_paused.borrow_mut())();
        Ok(0)
    }

    fn poll_pending(&self, _: &PendingReply) -> Result<Option<u32>, MailboxError> {
        Err(NOT_SENT)
    }

    fn wait_pending(&self, _: &PendingReply, _: Duration) -> Result<u32, MailboxError> {
        Err(NOT_SENT)
    }

    fn abandon(&self, _: &PendingReply) {}
}
