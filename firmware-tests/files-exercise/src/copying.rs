//! Copies between slices that need not be equally long.

/// Copies what both have room for; gives how many bytes that were.
pub(crate) fn copy(from: &[u8], into: &mut [u8]) -> usize {
    into.iter_mut()
        .zip(from)
        .map(|(place, byte)| *place = *byte)
        .count()
}
