//! Several buses as one.

use crate::bus::{AccessError, Bus, BusErrorKind, Width};

/// Whether the next bus is to be asked.
fn is_elsewhere<T>(answer: &Result<T, AccessError>) -> bool {
    matches!(answer, Err(error) if error.kind == BusErrorKind::OutOfRange)
}

/// Two buses as one: the second one has the addresses that the first one refuses as
/// [`OutOfRange`](BusErrorKind::OutOfRange). For more than two, nest pairs.
impl<A: Bus<Error = AccessError>, B: Bus<Error = AccessError>> Bus for (A, B) {
    type Error = AccessError;

    #[inline]
    fn read(&self, address: usize, width: Width) -> Result<u32, AccessError> {
        let answer = self.0.read(address, width);
        if is_elsewhere(&answer) {
            return self.1.read(address, width);
        }
        answer
    }

    #[inline]
    fn write(&self, address: usize, width: Width, value: u32) -> Result<(), AccessError> {
        let answer = self.0.write(address, width, value);
        if is_elsewhere(&answer) {
            return self.1.write(address, width, value);
        }
        answer
    }

    fn read_block(&self, address: usize, into: &mut [u8]) -> Result<(), AccessError> {
        let answer = self.0.read_block(address, into);
        if is_elsewhere(&answer) {
            return self.1.read_block(address, into);
        }
        answer
    }

    fn write_block(&self, address: usize, from: &[u8]) -> Result<(), AccessError> {
        let answer = self.0.write_block(address, from);
        if is_elsewhere(&answer) {
            return self.1.write_block(address, from);
        }
        answer
    }

    fn answers(&self, address: usize, width: Width) -> bool {
        self.0.answers(address, width) || self.1.answers(address, width)
    }
}

/// Several buses of one type as one: each address is that of the first one that does not refuse it
/// as [`OutOfRange`](BusErrorKind::OutOfRange).
impl<B: Bus<Error = AccessError>, const N: usize> Bus for [B; N] {
    type Error = AccessError;

    fn read(&self, address: usize, width: Width) -> Result<u32, AccessError> {
        let mut answers = self.iter().map(|bus| bus.read(address, width));
        let answer = answers.find(|answer| !is_elsewhere(answer));
        answer.unwrap_or(Err(nowhere(address)))
    }

    fn write(&self, address: usize, width: Width, value: u32) -> Result<(), AccessError> {
        let mut answers = self.iter().map(|bus| bus.write(address, width, value));
        let answer = answers.find(|answer| !is_elsewhere(answer));
        answer.unwrap_or(Err(nowhere(address)))
    }

    fn read_block(&self, address: usize, into: &mut [u8]) -> Result<(), AccessError> {
        let mut answers = self.iter().map(|bus| bus.read_block(address, into));
        let answer = answers.find(|answer| !is_elsewhere(answer));
        answer.unwrap_or(Err(nowhere(address)))
    }

    fn write_block(&self, address: usize, from: &[u8]) -> Result<(), AccessError> {
        let mut answers = self.iter().map(|bus| bus.write_block(address, from));
        let answer = answers.find(|answer| !is_elsewhere(answer));
        answer.unwrap_or(Err(nowhere(address)))
    }
}

fn nowhere(address: usize) -> AccessError {
    let kind = BusErrorKind::OutOfRange;
    AccessError { address, kind }
}
