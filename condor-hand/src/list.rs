//! [`list`]: collects items without code that panics.

use heapless::Vec;

/// Collects items; those for which there is no room are left out.
pub(crate) fn list<T, const N: usize>(items: impl IntoIterator<Item = T>) -> Vec<T, N> {
    let mut list = Vec::new();
    for item in items {
        if list.push(item).is_err() {
            break;
        }
    }
    list
}
