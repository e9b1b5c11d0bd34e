//! The numbers of processors and vectors.

use core::fmt;

/// The number of a processor in its system. Numbers begin with 0; a system has at most
/// [`Processor::MAX_COUNT`] processors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Processor(pub u8);

impl Processor {
    /// The greatest number of processors in one system.
    pub const MAX_COUNT: usize = 32;

    /// Returns the processor's number as an index of an array.
    #[must_use]
    #[inline]
    pub const fn index(self) -> usize {
        self.0 as usize
    }
}

impl fmt::Display for Processor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "processor {}", self.0)
    }
}

/// The number of a vector, from 0 to 63: it says what a message is about, and selects the
/// receiver's handler.
///
/// ```
/// use condor_mbox::{Processor, Vector};
///
/// const SERVO: Processor = Processor(1);
/// const SET_GAINS: Vector = Vector(20);
/// println!("{SERVO}, vector {}", SET_GAINS.0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Vector(pub u8);

impl Vector {
    /// The number of vectors of a processor; they are numbered from 0.
    pub const COUNT: usize = crate::layout::VECTORS;

    /// Returns the vector's number as an index of an array.
    #[must_use]
    #[inline]
    pub const fn index(self) -> usize {
        self.0 as usize
    }
}

impl fmt::Display for Vector {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "vector {}", self.0)
    }
}
