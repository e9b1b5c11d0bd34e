//! [`Board`]: words after the terminal by which the processor and who watches it agree, and what the
//! watcher sees of the terminal.

use condor_mbox::linux::LinuxWindow;
use condor_mbox::{AccessError, LoadOrder, MemoryWindow, Region, StoreOrder};
use condor_tty::layout::{BLOCK_BYTES, host, processor};

use super::CAPACITY;

/// Where the words are in the users' region of the processor, and how many bytes they have.
pub(crate) const AT: u32 = BLOCK_BYTES + CAPACITY;
pub(crate) const BYTES: u32 = 64;

const STOP: u32 = AT;
const DONE: u32 = AT + 4;
const WRITTEN: [u32; 2] = [AT + 8, AT + 12];

pub(crate) struct Board(pub(crate) Region<LinuxWindow>);

/// What a host has acknowledged, as it left it.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Acknowledged {
    pub(crate) tail: u32,
    pub(crate) overwritten: u32,
}

impl Board {
    fn load(&self, at: u32) -> Result<u32, AccessError> {
        self.0.load(at, LoadOrder::Acquire)
    }

    fn store(&self, at: u32, value: u32) -> Result<(), AccessError> {
        self.0.store(at, value, StoreOrder::Release)
    }

    pub(crate) fn stop(&self) -> Result<(), AccessError> {
        self.store(STOP, 1)
    }

    pub(crate) fn is_stopped(&self) -> Result<bool, AccessError> {
        Ok(self.load(STOP)? != 0)
    }

    pub(crate) fn done(&self, written: u64) -> Result<(), AccessError> {
        for (at, half) in WRITTEN.into_iter().zip([written, written >> 32]) {
            self.store(at, half as u32)?;
        }
        self.store(DONE, 1)
    }

    /// Bytes that the processor has written, once it has written all.
    pub(crate) fn written(&self) -> Result<Option<u64>, AccessError> {
        if self.load(DONE)? == 0 {
            return Ok(None);
        }
        let [low, high] = WRITTEN.map(|at| self.load(at).map(u64::from));
        Ok(Some(high? << 32 | low?))
    }

    /// Bytes that found no room.
    pub(crate) fn lost(&self) -> Result<u32, AccessError> {
        self.load(processor::LOST)
    }

    /// Cursors of hosts that were not believed.
    pub(crate) fn ignored(&self) -> Result<u32, AccessError> {
        self.load(processor::IGNORED)
    }

    pub(crate) fn head(&self) -> Result<u32, AccessError> {
        self.load(processor::HEAD)
    }

    /// What the hosts have acknowledged, by the words that a killed one left; as in WIRE.md.
    pub(crate) fn acknowledged(&self) -> Result<Acknowledged, AccessError> {
        if self.load(host::INCARNATION)? != self.load(processor::INCARNATION)? {
            return Ok(Acknowledged::default());
        }
        let mut found = Acknowledged {
            tail: self.load(host::TAIL)?,
            overwritten: 0,
        };
        for at in host::RECORDS {
            if self.load(at)? == found.tail {
                found.overwritten = self.load(at + 4)?;
            }
        }
        Ok(found)
    }
}
