//! [`Nodes`]: the numbers by which the kernel knows files, and the paths by which condor-fs does.

use std::collections::HashMap;

/// The number of the tree's own directory.
pub(crate) const ROOT: u64 = 1;

/// The files that the kernel knows, or knew: no number is used twice.
pub(crate) struct Nodes {
    /// `None` once it was unlinked.
    paths: HashMap<u64, Option<Vec<u8>>>,
    numbers: HashMap<Vec<u8>, u64>,
    last: u64,
}

impl Nodes {
    pub(crate) fn new() -> Self {
        Self {
            paths: HashMap::from([(ROOT, Some(b".".to_vec()))]),
            numbers: HashMap::from([(b".".to_vec(), ROOT)]),
            last: ROOT,
        }
    }

    /// Returns the path of a node, if it has one.
    pub(crate) fn path(&self, number: u64) -> Option<&[u8]> {
        self.paths.get(&number)?.as_deref()
    }

    /// Returns the path of an entry of a directory.
    pub(crate) fn child(&self, parent: u64, name: &[u8]) -> Option<Vec<u8>> {
        if parent == ROOT {
            return Some(name.to_vec());
        }
        Some([self.path(parent)?, name].join(&b'/'))
    }

    /// Returns the number of the node at `path`, which the kernel is told.
    pub(crate) fn look_up(&mut self, path: Vec<u8>) -> u64 {
        *self.numbers.entry(path).or_insert_with_key(|path| {
            self.last += 1;
            self.paths.insert(self.last, Some(path.clone()));
            self.last
        })
    }

    /// Removes a path: the node that had it has none any more.
    pub(crate) fn remove(&mut self, path: &[u8]) {
        if let Some(number) = self.numbers.remove(path) {
            self.paths.insert(number, None);
        }
    }

    /// Moves the node at `from`, and all below it, to `to`.
    pub(crate) fn rename(&mut self, from: &[u8], to: &[u8]) {
        self.remove(to);
        self.move_all(|path| moved(path, from, to));
    }

    /// Exchanges the nodes at the two paths, with all below them.
    pub(crate) fn exchange(&mut self, one: &[u8], other: &[u8]) {
        self.move_all(|path| moved(path, one, other).or_else(|| moved(path, other, one)));
    }

    /// Changes the paths for which there is a new one.
    fn move_all(&mut self, new: impl Fn(&[u8]) -> Option<Vec<u8>>) {
        let mut all = Vec::new();
        for (number, path) in &mut self.paths {
            let Some(path) = path else { continue };
            if let Some(moved) = new(path) {
                self.numbers.remove(path);
                all.push((moved.clone(), *number));
                *path = moved;
            }
        }
        // Only now: a new path may be the old one of another.
        self.numbers.extend(all);
    }
}

/// Returns the new path of the node at `path` if it was at `from`, or below it, and that has come to `to`.
fn moved(path: &[u8], from: &[u8], to: &[u8]) -> Option<Vec<u8>> {
    let rest = path.strip_prefix(from)?;
    (rest.is_empty() || rest.starts_with(b"/")).then(|| [to, rest].concat())
}
