//! [`Board`]: one model, without allocation.

use super::Model;
use crate::bus::{AccessError, Bus, BusErrorKind, Width};
use crate::stdio::{Claim, Claimed};

/// A bus with one model on it, for programs without a heap; a pair of references to two boards is a bus
/// with both.
///
/// ```
/// use condor_dev::Bus;
/// use condor_dev::sim::{As5600Model, Board, Pca9685Model};
///
/// let (motor, sensor) = (
///     Board::new(0x4000, Pca9685Model::default()),
///     Board::new(0x3600, As5600Model::default()),
/// );
/// let bus = (&motor, &sensor);
/// if let Some(mut sensor) = sensor.model() {
///     sensor.angle = 0x123;
/// }
/// assert_eq!(bus.read8(0x360d), Ok(0x23));
/// assert!(bus.read8(0x3700).is_err());
/// ```
pub struct Board<M> {
    base: usize,
    model: Claim<M>,
}

impl<M: Model> Board<M> {
    /// Puts a model at the bus address `base`.
    #[must_use]
    pub const fn new(base: usize, model: M) -> Self {
        let model = Claim::new(model);
        Self { base, model }
    }

    /// Returns the model, for what is outside of the board; `None` while another context has it. The bus
    /// refuses accesses as [`Busy`](BusErrorKind::Busy) as long as it is held.
    pub fn model(&self) -> Option<Claimed<'_, M>> {
        self.model.claim()
    }

    fn access<R>(
        &self,
        address: usize,
        width: Width,
        access: impl FnOnce(&mut M, usize) -> Option<R>,
    ) -> Result<R, AccessError> {
        let error = |kind| AccessError { address, kind };
        width.check(address)?;
        let mut model = self.model().ok_or(error(BusErrorKind::Busy))?;
        let offset = address.wrapping_sub(self.base);
        if offset >= model.size() || width.bytes() > model.size() - offset {
            return Err(error(BusErrorKind::OutOfRange));
        }
        access(&mut model, offset).ok_or(error(BusErrorKind::NoAnswer))
    }
}

impl<M: Model> Bus for Board<M> {
    type Error = AccessError;

    fn read(&self, address: usize, width: Width) -> Result<u32, AccessError> {
        let value = self.access(address, width, |model, offset| model.read(offset, width))?;
        Ok(value & width.mask())
    }

    fn write(&self, address: usize, width: Width, value: u32) -> Result<(), AccessError> {
        self.access(address, width, |model, offset| {
            model.write(offset, width, value & width.mask())
        })
    }
}
