//! [`Nothing`]: a bus at which no board answers. Terminals and files are behind none.

use condor_dev::{Bus, BusErrorKind, Width};

#[derive(Clone, Copy)]
pub(crate) struct Nothing;

impl Bus for Nothing {
    type Error = BusErrorKind;

    fn read(&self, _: usize, _: Width) -> Result<u32, BusErrorKind> {
        Err(BusErrorKind::NoAnswer)
    }

    fn write(&self, _: usize, _: Width, _: u32) -> Result<(), BusErrorKind> {
        Err(BusErrorKind::NoAnswer)
    }
}
