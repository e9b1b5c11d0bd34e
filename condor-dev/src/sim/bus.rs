//! [`SimBus`]: models at addresses, with injected faults.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::Model;
use crate::bus::{self, BusAccessError, BusErrorKind, Width};

/// A simulated [`Bus`](crate::Bus) for tests, on which models of boards answer. Clones share one
/// bus.
#[derive(Clone, Default)]
pub struct SimBus {
    inside: Arc<Mutex<Inside>>,
}

#[derive(Default)]
struct Inside {
    /// By base address.
    boards: BTreeMap<usize, Arc<Mutex<dyn Model>>>,
    /// Accesses until one fails, for each coming fault.
    faults: Vec<u64>,
    accesses: u64,
}

impl Inside {
    /// The board that answers at an address, and the offset there.
    fn at(&self, address: usize, width: Width) -> Option<(usize, Arc<Mutex<dyn Model>>)> {
        if let Some((base, model)) = self.boards.range(..=address).next_back()
            && address - base + width.bytes() <= lock(model).size()
        {
            return Some((address - base, model.clone()));
        }
        let mut models = self.boards.values();
        models.find_map(|model| Some((lock(model).also_at(address)?, model.clone())))
    }
}

impl SimBus {
    /// Makes a bus without boards: every access fails with [`BusErrorKind::NoAnswer`].
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Puts a board at the bus address `base`, and removes a board that was there before. Returns a
    /// handle by which a test can read and change the model, for example the angle of a sensor.
    pub fn insert<M: Model + 'static>(&self, base: usize, model: M) -> Arc<Mutex<M>> {
        let model = Arc::new(Mutex::new(model));
        self.inside().boards.insert(base, model.clone());
        model
    }

    /// Removes the board at the bus address `base`; accesses to it fail from now on.
    pub fn remove(&self, base: usize) {
        self.inside().boards.remove(&base);
    }

    /// Makes one access fail although a board is there: the one that follows the next `accesses`
    /// accesses. So 0 means the very next access.
    pub fn fail_after(&self, accesses: u64) {
        let mut inside = self.inside();
        let at = inside.accesses + accesses;
        inside.faults.push(at);
    }

    /// Returns the number of accesses to the bus since it was made, including those that failed
    /// because no board answered.
    #[must_use]
    pub fn accesses(&self) -> u64 {
        self.inside().accesses
    }

    fn inside(&self) -> MutexGuard<'_, Inside> {
        lock(&self.inside)
    }

    fn access<R>(
        &self,
        address: usize,
        width: Width,
        access: impl FnOnce(&mut dyn Model, usize) -> Option<R>,
    ) -> Result<R, BusAccessError> {
        let error = |kind| BusAccessError { address, kind };
        width.check(address)?;
        let board = {
            let mut inside = self.inside();
            let now = inside.accesses;
            inside.accesses += 1;
            let before = inside.faults.len();
            inside.faults.retain(|&fault| fault != now);
            if inside.faults.len() != before {
                return Err(error(BusErrorKind::NoAnswer));
            }
            inside.at(address, width)
        };
        let Some((offset, model)) = board else {
            return Err(error(BusErrorKind::NoAnswer));
        };
        access(&mut *lock(&model), offset).ok_or(error(BusErrorKind::NoAnswer))
    }
}

/// A model that panicked in a test is as good as before.
pub(crate) fn lock<T: ?Sized>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl bus::Bus for SimBus {
    type Error = BusAccessError;

    fn read(&self, address: usize, width: Width) -> Result<u32, BusAccessError> {
        self.access(address, width, |model, offset| model.read(offset, width))
            .map(|value| value & width.mask())
    }

    fn write(&self, address: usize, width: Width, value: u32) -> Result<(), BusAccessError> {
        self.access(address, width, |model, offset| {
            model.write(offset, width, value & width.mask())
        })
    }

    fn read_block(&self, mut address: usize, into: &mut [u8]) -> Result<(), BusAccessError> {
        into.iter_mut().try_for_each(|byte| {
            address = self.access(address, Width::Bits8, |model, offset| {
                *byte = model.read(offset, Width::Bits8)? as u8;
                Some(address - offset + model.next(offset))
            })?;
            Ok(())
        })
    }

    fn write_block(&self, mut address: usize, from: &[u8]) -> Result<(), BusAccessError> {
        from.iter().try_for_each(|&byte| {
            address = self.access(address, Width::Bits8, |model, offset| {
                model.write(offset, Width::Bits8, byte.into())?;
                Some(address - offset + model.next(offset))
            })?;
            Ok(())
        })
    }
}
