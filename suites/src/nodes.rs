//! [`Nodes`]: the numbers by which the kernel knows files, and the paths by which condor-fs does.

use std::collections::HashMap;

/// The number of the tree's own directory.
pub(crate) const ROOT: u64 = 1;

struct Node {
    /// `None` once it was unlinked.
    path: Option<Vec<u8>>,
    /// How often the kernel was told its number.
    lookups: u64,
}

/// The files that the kernel knows.
pub(crate) struct Nodes {
    known: HashMap<u64, Node>,
    numbers: HashMap<Vec<u8>, u64>,
    last: u64,
}

impl Nodes {
    pub(crate) fn new() -> Self {
        let root = Node {
            path: Some(b".".to_vec()),
            lookups: 1,
        };
        Self {
            known: HashMap::from([(ROOT, root)]),
            numbers: HashMap::from([(b".".to_vec(), ROOT)]),
            last: ROOT,
        }
    }

    /// The path of a node, if it has one.
    pub(crate) fn path(&self, number: u64) -> Option<&[u8]> {
        self.known.get(&number)?.path.as_deref()
    }

    /// The path of an entry of a directory.
    pub(crate) fn child(&self, parent: u64, name: &[u8]) -> Option<Vec<u8>> {
        if parent == ROOT {
            return Some(name.to_vec());
        }
        Some([self.path(parent)?, name].join(&b'/'))
    }

    /// The number of what is at `path`, of which the kernel is told.
    pub(crate) fn look_up(&mut self, path: Vec<u8>) -> u64 {
        let number = *self.numbers.entry(path).or_insert_with_key(|path| {
            self.last += 1;
            let path = Some(path.clone());
            self.known.insert(self.last, Node { path, lookups: 0 });
            self.last
        });
        if let Some(node) = self.known.get_mut(&number) {
            node.lookups += 1;
        }
        number
    }

    /// The kernel has forgotten a number so many times.
    pub(crate) fn forget(&mut self, number: u64, times: u64) {
        if let Some(node) = self.known.get_mut(&number) {
            node.lookups = node.lookups.saturating_sub(times);
            if node.lookups == 0 && number != ROOT {
                let path = self.known.remove(&number).and_then(|node| node.path);
                path.map(|path| self.numbers.remove(&path));
            }
        }
    }

    /// Nothing has this path any more.
    pub(crate) fn remove(&mut self, path: &[u8]) {
        if let Some(number) = self.numbers.remove(path)
            && let Some(node) = self.known.get_mut(&number)
        {
            node.path = None;
        }
    }

    /// What was at `from`, and all below it, is at `to`.
    pub(crate) fn rename(&mut self, from: &[u8], to: &[u8]) {
        self.remove(to);
        for (number, node) in &mut self.known {
            let Some(path) = &mut node.path else { continue };
            let Some(rest) = path.strip_prefix(from) else {
                continue;
            };
            if rest.is_empty() || rest.starts_with(b"/") {
                let moved = [to, rest].concat();
                self.numbers.remove(path);
                self.numbers.insert(moved.clone(), *number);
                *path = moved;
            }
        }
    }
}
