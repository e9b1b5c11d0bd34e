//! Two buses as one.

use crate::bus::{Bus, BusAccessError, BusErrorKind, Width};

type Answer<T> = Result<T, BusAccessError>;

/// The answer of `next`, if `answer` is that the address is of another bus.
#[inline]
fn or_else<T>(answer: Answer<T>, next: impl FnOnce() -> Answer<T>) -> Answer<T> {
    match answer {
        Err(error) if error.kind == BusErrorKind::OutOfRange => next(),
        answer => answer,
    }
}

/// Combines two buses: an access that the first one refuses as
/// [`OutOfRange`](BusErrorKind::OutOfRange) goes to the second one. For more than two, nest pairs.
impl<A: Bus<Error = BusAccessError>, B: Bus<Error = BusAccessError>> Bus for (A, B) {
    type Error = BusAccessError;

    #[inline]
    fn read(&self, address: usize, width: Width) -> Answer<u32> {
        or_else(self.0.read(address, width), || self.1.read(address, width))
    }

    #[inline]
    fn write(&self, address: usize, width: Width, value: u32) -> Answer<()> {
        let answer = self.0.write(address, width, value);
        or_else(answer, || self.1.write(address, width, value))
    }

    fn read_block(&self, address: usize, into: &mut [u8]) -> Answer<()> {
        let answer = self.0.read_block(address, into);
        or_else(answer, || self.1.read_block(address, into))
    }

    fn write_block(&self, address: usize, from: &[u8]) -> Answer<()> {
        let answer = self.0.write_block(address, from);
        or_else(answer, || self.1.write_block(address, from))
    }

    fn answers(&self, address: usize, width: Width) -> bool {
        self.0.answers(address, width) || self.1.answers(address, width)
    }
}
