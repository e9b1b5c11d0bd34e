//! [`Disk`]: files and directories of the host, in memory.

use condor_fs::wire::{Evidence, open as flag};
use condor_fs::{Errno, Status};

use crate::copying::copy;
use crate::text::Text;

/// How many files and directories there can be.
const NODES: usize = 10;
/// How many bytes a file can have.
const ROOM: usize = 128;
/// Of what a disk's device is the number.
const DEVICE: u64 = 0x0001_0000_0803;
/// When everything was made and written.
const BORN_S: u64 = 1_800_000_000;

/// What has a path, relative to the tree.
pub(crate) type Path = Text<32>;

#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    File,
    Directory,
    Link,
}

impl Kind {
    /// The type bits of its mode.
    pub(crate) const fn bits(self) -> u32 {
        match self {
            Self::Directory => 4,
            Self::File => 8,
            Self::Link => 10,
        }
    }
}

#[derive(Clone, Copy)]
pub(crate) struct Node {
    /// `None` for what has been unlinked, and is still open.
    pub(crate) path: Option<Path>,
    pub(crate) kind: Kind,
    inode: u64,
    size: usize,
    data: [u8; ROOM],
}

impl Node {
    pub(crate) fn evidence(&self) -> Evidence {
        Evidence {
            device: DEVICE,
            inode: self.inode,
            born_s: BORN_S,
            born_ns: self.inode as u32,
        }
    }

    pub(crate) fn status(&self) -> Status {
        Status {
            size: self.size as u64,
            modified_s: BORN_S,
            modified_ns: 1,
            mode: self.kind.bits() << 12 | 0o644,
            links: u32::from(self.path.is_some()),
        }
    }

    pub(crate) fn read(&self, position: u64, len: u32) -> &[u8] {
        let begin = usize::try_from(position).map_or(self.size, |it| it.min(self.size));
        let end = begin.saturating_add(len as usize).min(self.size);
        self.data.get(begin..end).unwrap_or_default()
    }

    /// Writes all of it, or nothing.
    pub(crate) fn write(&mut self, position: u64, from: &[u8]) -> Result<usize, Errno> {
        let begin = usize::try_from(position).map_err(|_| Errno::FBIG)?;
        let end = begin.saturating_add(from.len());
        let into = self.data.get_mut(begin..end).ok_or(Errno::NOSPC)?;
        copy(from, into);
        self.size = self.size.max(end);
        Ok(from.len())
    }

    pub(crate) fn truncate(&mut self, size: u64) -> Result<(), Errno> {
        let size = usize::try_from(size).map_err(|_| Errno::FBIG)?;
        let gone = self.data.get_mut(size..).ok_or(Errno::FBIG)?;
        gone.fill(0);
        self.size = size;
        Ok(())
    }
}

pub(crate) struct Disk {
    nodes: [Option<Node>; NODES],
    /// The latest inode.
    inodes: u64,
}

impl Disk {
    pub(crate) const fn new() -> Self {
        Self {
            nodes: [const { None }; NODES],
            inodes: 0,
        }
    }

    pub(crate) fn node(&mut self, index: usize) -> Result<&mut Node, Errno> {
        let node = self.nodes.get_mut(index).and_then(Option::as_mut);
        node.ok_or(Errno::STALE)
    }

    pub(crate) fn find(&self, path: &[u8]) -> Result<usize, Errno> {
        self.position(|node| node.path.is_some_and(|its| its.bytes() == path))
            .ok_or(Errno::NOENT)
    }

    pub(crate) fn find_inode(&self, evidence: &Evidence) -> Option<usize> {
        self.position(|node| node.evidence() == *evidence)
    }

    fn position(&self, is: impl Fn(&Node) -> bool) -> Option<usize> {
        let is = |node: &Option<Node>| node.as_ref().is_some_and(&is);
        self.nodes.iter().position(is)
    }

    /// Makes something that does not exist.
    pub(crate) fn make(&mut self, path: &[u8], kind: Kind) -> Result<usize, Errno> {
        if path == b"." || self.find(path).is_ok() {
            return Err(Errno::EXIST);
        }
        self.check_parent(path)?;
        let index = self.nodes.iter().position(Option::is_none);
        let index = index.ok_or(Errno::NOSPC)?;
        let place = self.nodes.get_mut(index).ok_or(Errno::NOSPC)?;
        self.inodes = self.inodes.saturating_add(1);
        *place = Some(Node {
            path: Some(path_of(path)),
            kind,
            inode: self.inodes,
            size: 0,
            data: [0; ROOM],
        });
        Ok(index)
    }

    fn check_parent(&self, path: &[u8]) -> Result<(), Errno> {
        let Some(slash) = path.iter().rposition(|byte| *byte == b'/') else {
            return Ok(());
        };
        let parent = self.find(path.get(..slash).unwrap_or_default())?;
        match self.nodes.get(parent) {
            Some(Some(node)) if node.kind == Kind::Directory => Ok(()),
            _ => Err(Errno::NOTDIR),
        }
    }

    /// What an open of `path` finds, or makes.
    pub(crate) fn open(&mut self, path: &[u8], flags: u32) -> Result<usize, Errno> {
        let asked = |bits: u32| flags & bits == bits;
        let index = match self.find(path) {
            Ok(_) if asked(flag::CREATE | flag::EXCLUSIVE) => return Err(Errno::EXIST),
            Err(Errno::NOENT) if asked(flag::CREATE | flag::WRITE) => {
                self.make(path, Kind::File)?
            }
            found => found?,
        };
        let node = self.node(index)?;
        match node.kind {
            Kind::Link => return Err(Errno::LOOP),
            Kind::Directory if !asked(flag::DIRECTORY) => return Err(Errno::ISDIR),
            Kind::File if asked(flag::DIRECTORY) => return Err(Errno::NOTDIR),
            Kind::File | Kind::Directory => {}
        }
        if asked(flag::TRUNCATE | flag::WRITE) {
            node.truncate(0)?;
        }
        Ok(index)
    }

    /// Takes the name of something away; it is gone unless it is `kept`.
    pub(crate) fn remove(&mut self, index: usize, kept: bool) -> Result<(), Errno> {
        self.node(index)?.path = None;
        if !kept {
            self.forget(index);
        }
        Ok(())
    }

    pub(crate) fn forget(&mut self, index: usize) {
        if let Some(place) = self.nodes.get_mut(index) {
            *place = None;
        }
    }

    /// The first entry of the directory `path` at or after `from`: its place, name and kind.
    pub(crate) fn entry(&self, path: &[u8], from: usize) -> Option<(usize, &[u8], Kind)> {
        let entries = self.nodes.iter().enumerate().skip(from);
        entries
            .filter_map(|(index, node)| Some((index, node.as_ref()?)))
            .find_map(|(index, node)| {
                let name = below(node.path.as_ref()?.bytes(), path)?;
                (!name.contains(&b'/')).then_some((index, name, node.kind))
            })
    }

    /// Gives another name to what is at `index`, and to all below it.
    pub(crate) fn rename(&mut self, index: usize, to: &[u8]) -> Result<(), Errno> {
        self.check_parent(to)?;
        let from = self.node(index)?.path.ok_or(Errno::NOENT)?;
        for node in self.nodes.iter_mut().flatten() {
            let Some(path) = &node.path else {
                continue;
            };
            let mut renamed = path_of(to);
            if let Some(rest) = below(path.bytes(), from.bytes()) {
                renamed.push(b"/");
                renamed.push(rest);
            } else if path != &from {
                continue;
            }
            node.path = Some(renamed);
        }
        Ok(())
    }
}

fn path_of(bytes: &[u8]) -> Path {
    let mut path = Path::new();
    path.push(bytes);
    path
}

/// What follows `directory` in `path`, if it is below it; the tree itself is ".".
fn below<'p>(path: &'p [u8], directory: &[u8]) -> Option<&'p [u8]> {
    if directory == b"." {
        return Some(path);
    }
    path.strip_prefix(directory)?.strip_prefix(b"/")
}
