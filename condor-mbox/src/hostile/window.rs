//! The check of accesses to a window.

use crate::window::check_access;

/// Tests [`check_access`] with a size, an offset and a length from `bytes`: it must accept exactly
/// the accesses that are aligned and lie inside of the window.
///
/// # Panics
/// Panics if an access is accepted or refused wrongly.
pub fn bounds(bytes: &[u8]) {
    let mut words = bytes.chunks(4).map(|chunk| {
        let mut word = [0; 4];
        word[..chunk.len()].copy_from_slice(chunk);
        u32::from_le_bytes(word)
    });
    let mut word = || words.next().unwrap_or_default();
    let (size, offset, len) = (word(), word(), u64::from(word()) | u64::from(word()) << 32);
    let len = usize::try_from(len).unwrap_or(usize::MAX);
    let end = u128::from(offset) + len as u128;
    let inside = offset % 4 == 0 && end <= u128::from(size);
    assert_eq!(check_access(size, offset, len).is_ok(), inside);
}
