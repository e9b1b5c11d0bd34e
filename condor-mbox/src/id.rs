//! The numbers of processors and vectors.

use core::fmt;

/// The number of a processor in a system of at most [`Processor::MAX_COUNT`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Processor(pub u8);

impl Processor {
    /// The greatest number of processors in one system.
    pub const MAX_COUNT: usize = 32;

    /// Returns the number as an index.
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

/// The number of a vector, which selects the handler of a message.
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

    /// Returns the number as an index.
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
