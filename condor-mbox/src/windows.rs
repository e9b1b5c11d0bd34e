//! The two windows of a processor.

/// The two pieces of a processor's memory that other processors can access, as windows.
#[derive(Clone, Copy, Debug)]
pub struct Windows<W> {
    /// The memory that only the processor itself writes; peers may map it for reading only.
    pub mail: W,
    /// The memory that every processor writes.
    pub data: W,
}
