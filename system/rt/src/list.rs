//! [`List`]: what a program lends to its setup.

use heapless::Vec;

/// Up to `N` things, and nothing to do when they go.
///
/// A list that drops its items, such as that of `heapless`, would have to outlive them: closures that
/// are temporaries of the statement which sets a program up are refused then (E0716).
#[derive(Debug)]
pub(crate) struct List<T, const N: usize> {
    items: [Option<T>; N],
    len: usize,
}

impl<T, const N: usize> List<T, N> {
    pub(crate) const fn new() -> Self {
        Self {
            items: [const { None }; N],
            len: 0,
        }
    }

    /// Adds an item; returns it as the error if there is no room.
    pub(crate) fn push(&mut self, item: T) -> Result<(), T> {
        match self.items.get_mut(self.len) {
            Some(place) => {
                *place = Some(item);
                self.len += 1;
                Ok(())
            }
            None => Err(item),
        }
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = &T> + Clone {
        self.items.iter().flatten()
    }

    pub(crate) fn iter_mut(&mut self) -> impl Iterator<Item = &mut T> {
        self.items.iter_mut().flatten()
    }
}

/// The items, of which there are at most `N`; others are left out. Collecting into a `heapless` list
/// panics where this ends.
pub(crate) fn fitting<T, const N: usize>(items: impl Iterator<Item = T>) -> Vec<T, N> {
    let mut all = Vec::new();
    for item in items {
        if all.push(item).is_err() {
            break;
        }
    }
    all
}
