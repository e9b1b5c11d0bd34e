//! The two windows of a processor.

/// The two objects of a processor that others can reach.
#[derive(Clone, Copy, Debug)]
pub struct Windows<W> {
    /// The memory that only its processor writes; peers may map it for reading only.
    pub mail: W,
    /// The memory that every processor writes.
    pub data: W,
}
