//! The two windows of a processor.

/// The two objects of a processor that others can reach.
#[derive(Clone, Copy, Debug)]
pub struct Windows<W> {
    /// Written by its processor alone; peers may map it for reading only.
    pub mail: W,
    /// Written by everybody.
    pub data: W,
}
