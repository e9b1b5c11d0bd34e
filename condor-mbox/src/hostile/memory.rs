//! The window and the doorbell through which an honest processor accesses the world.

use std::rc::Rc;

use crate::error::MemoryObject;
use crate::sim::SimWindow;
use crate::window::{AccessError, CompareExchange, WindowError, WindowErrorKind};
use crate::{Clock, Doorbell, Evidence, Instant, LoadOrder, MemoryWindow, Processor, StoreOrder};

use super::world::World;

/// The window of `user` on one of the two objects of `owner`.
#[derive(Clone)]
pub(super) struct Watched {
    pub(super) world: Rc<World>,
    pub(super) user: usize,
    pub(super) owner: usize,
    pub(super) object: MemoryObject,
    pub(super) inner: SimWindow,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Refused(WindowErrorKind);

impl WindowError for Refused {
    fn kind(&self) -> WindowErrorKind {
        self.0
    }
}

fn refused(error: AccessError) -> Refused {
    Refused(error.kind())
}

impl Watched {
    /// Lets the hostile processor move, and returns an error if it took the memory away.
    fn reach(&self) -> Result<(), Refused> {
        self.world.step();
        if self.world.is_lost(self.owner, self.object) {
            Err(Refused(WindowErrorKind::Lost))
        } else {
            Ok(())
        }
    }
}

impl MemoryWindow for Watched {
    type Error = Refused;

    fn size(&self) -> u32 {
        self.inner.size()
    }

    fn load(&self, offset: u32, order: LoadOrder) -> Result<u32, Refused> {
        self.reach()?;
        let value = self.inner.load(offset, order).map_err(refused)?;
        if self.object == MemoryObject::Mail {
            let mut model = self.world.model.borrow_mut();
            model.loaded(self.user, self.owner, offset, value);
        }
        Ok(value)
    }

    fn store(&self, offset: u32, value: u32, order: StoreOrder) -> Result<(), Refused> {
        self.reach()?;
        self.inner.store(offset, value, order).map_err(refused)?;
        if self.object == MemoryObject::Mail {
            self.world.stored(self.owner, offset, value, order);
        }
        Ok(())
    }

    fn check(&self, offset: u32, len: usize) -> Result<(), Refused> {
        self.inner.check(offset, len).map_err(refused)
    }
}

impl CompareExchange for Watched {
    fn compare_exchange(&self, offset: u32, current: u32, new: u32) -> Result<u32, Refused> {
        self.reach()?;
        self.inner
            .compare_exchange(offset, current, new)
            .map_err(refused)
    }
}

/// The doorbell of `user`: while it sleeps, the other honest processors run.
#[derive(Clone)]
pub(super) struct Bell {
    pub(super) world: Rc<World>,
    pub(super) user: usize,
}

impl Clock for Bell {
    fn now(&self) -> Instant {
        self.world.tick(self.user)
    }
}

impl Doorbell for Bell {
    type Seen = u64;

    fn ring(&self, processor: Processor) {
        self.world.ring(processor.index());
    }

    fn prepare(&self) -> u64 {
        self.world.rings(self.user)
    }

    fn wait(&self, seen: u64, until: Instant, _: Option<Processor>) {
        self.world.sleep(self.user, seen, until);
    }

    fn evidence(&self, _: Processor) -> Evidence {
        // The hostile program runs, whatever it does to its memory.
        Evidence::Alive
    }
}
